"""The structural causal model of all questions: its graph, mechanisms and exogenous noises.

The paper (Section "Specification Model Differences") takes X = {Z_theta, Z_I, S, V} and gives each node all others as
parents. This is a cycle, which entails no distribution. We use the acyclic graph suggested by the paper's figure, and
add the contents of the image I explicitly: the items O on the table top T.

    O -> I <- T,    I -> Z_I -> V,    Z_theta -> V,    S -> V

- Z_theta has no parent: the simulated demonstrations, too, are of random paths, whatever the table and the user. People
  would look at the table. The paths of our questions are drawn at random, the same for every user and scene.
- S has V as its only child. Z_I holds the percepts of all users' models, and C_s reads those of its own.
- V := 1[N_V < C_s(Z_I, Z_theta)] with N_V uniform. So E[V | Z_I, Z_theta, S = s] is C_s itself (`SCM.expectation`).

All causes of V are recorded (items, table top, render seed, path, user): their noises are given, and N_V alone is
averaged, in closed form: over all of its values by `SCM.expectation`, over those that explain an observed V by
`chance_of_change`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

PARENTS = {"S": (), "O": (), "T": (), "Z_theta": (), "I": ("O", "T"), "Z_I": ("I",), "V": ("S", "Z_I", "Z_theta")}
Values = dict[str, Any]  # node -> its value in every unit (first axis: unit)


@dataclass(frozen=True)
class Node:
    """X_j := f_j(PA_j, N_j): the parents' names and `mechanism(noise, *parents)`.

    expectation(*parents): E[X_j | PA_j]; None if it has no closed form.
    """

    parents: tuple[str, ...]
    mechanism: Callable[..., Any]
    expectation: Callable[..., Any] | None = None


@dataclass(frozen=True)
class SCM:
    """Structural assignments over an acyclic graph."""

    nodes: Mapping[str, Node]

    def entail(self, noise: Values, *only: str) -> Values:
        """Return every node's value given the noises; with `only`, the values of those nodes and their ancestors."""
        values: Values = {}

        def assign(name: str) -> Any:
            if name not in values:
                node = self.nodes[name]
                values[name] = node.mechanism(noise[name], *map(assign, node.parents))
            return values[name]

        for name in only or self.nodes:
            assign(name)
        return values

    def expectation(self, name: str, noise: Values) -> Any:
        """Return E[X | N of all other nodes] of a node in every unit: the closed-form mean over its own noise."""
        node = self.nodes[name]
        assert node.expectation, f"{name} has no expectation in closed form: average `entail`"
        values = self.entail(noise, *node.parents)
        return node.expectation(*(values[p] for p in node.parents))

    def do(self, **values: Any) -> "SCM":
        """Return the model under do(X := value): each named node is set, and the arrows from its parents are removed.

        A number or string applies to every unit; any other value holds one entry per unit on its first axis.
        """

        def constant(value: Any) -> Node:
            one = isinstance(value, str | int | float | np.generic)
            return Node((), lambda noise: np.full(len(noise), value) if one else value)

        return SCM({**self.nodes, **{name: constant(value) for name, value in values.items()}})


def chance_of_change(v: bool, before: Float[Array, "*#b"], after: Float[Array, "*#b"]) -> Float[Array, "*b_all"]:
    """Return the counterfactual P(V_{C := after} != v | V = v, C = before); NaN where V = v is impossible.

    V := 1[N_V < C] in both worlds, with the same noise (Pearl, 2009, Theorem 7.1.7). max(0, after - before) /
    (1 - before) for v = 0, max(0, before - after) / before for v = 1. This is the smallest probability that any joint
    distribution of both answers allows (Tian and Pearl, 2000): a higher C turns no V from 1 to 0.
    """
    before, after = (np.asarray(c, dtype=np.float64) for c in (before, after))
    observed = before if v else 1 - before  # 1. abduction: N_V is uniform on an interval of this length
    changed = before - after if v else after - before  # 2. action C := after: the part of it that gives another V
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(observed > 0, np.maximum(changed, 0.0) / observed, np.nan)  # 3. prediction


def specification_scm(users: Sequence[str], render: Callable, encode: Callable, classify: Callable) -> SCM:
    """Return the graph of this module with the given mechanisms.

    `render(render_seed, items, table_top)` gives the image and `encode(image)` the percepts of the users' models.
    `classify(s, z_image, z_theta)` gives the probability C_s that each path [m] is valid. The noise of S is an index
    into `users`; those of O, T and Z_theta are their values.
    """
    nodes = {name: Node(PARENTS[name], lambda noise: noise) for name in ("O", "T", "Z_theta")}
    nodes["S"] = Node(PARENTS["S"], lambda noise: np.asarray(users)[noise])
    nodes["I"] = Node(PARENTS["I"], render)
    nodes["Z_I"] = Node(PARENTS["Z_I"], lambda _, image: encode(image))
    nodes["V"] = Node(PARENTS["V"], lambda noise, *parents: noise < classify(*parents), expectation=classify)
    return SCM(nodes)
