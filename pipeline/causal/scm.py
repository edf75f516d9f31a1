"""The structural causal model of all questions: its graph, mechanisms and exogenous noises.

The paper (Section "Specification Model Differences") takes X = {Z_theta, Z_I, S, V} and gives each node all others as
parents. This is a cycle, which entails no distribution. We use the acyclic graph suggested by the paper's figure, and
add the contents of the image I explicitly: the items O on the table top T.

    O -> I <- T,    I -> Z_I -> V,    Z_theta -> V,    S -> V

- Z_theta has no parent: the simulated demonstrations, too, are of random paths, whatever the table and the user. People
  would look at the table. The paths of our questions are drawn at random, the same for every user and scene.
- S has V as its only child. Z_I holds the percepts of all users' models, and C_s reads those of its own.
- V := 1[N_V < C_s(Z_I, Z_theta)] with N_V uniform. So E[V | Z_I, Z_theta, S = s] is C_s itself (`SCM.expectation`).

A counterfactual holds the noises fixed (Pearl, 2009, Theorem 7.1.7). All causes of V are recorded (items, table top,
render seed, path, user), so abduction concerns N_V alone: the observation V = v restricts it to an interval.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.world.bezier import random_z_theta

PARENTS = {"S": (), "O": (), "T": (), "Z_theta": (), "I": ("O", "T"), "Z_I": ("I",), "V": ("S", "Z_I", "Z_theta")}
Values = dict[str, Any]  # node -> its value in every unit (first axis: unit)
Draw = Callable[[np.random.Generator, int], Any]  # generator, number of units -> noise of every unit
Abduce = Callable[..., Any]  # generator, value, *parents -> noise of every unit, drawn given the node's value


@dataclass(frozen=True)
class Node:
    """X_j := f_j(PA_j, N_j): the parents' names, `mechanism(noise, *parents)` and the distribution of the noise.

    noise: None if the noise is always recorded. abduce(rng, value, *parents): draw the noise given the node's value;
    None if that distribution is unknown. expectation(*parents): E[X_j | PA_j]; None if it has no closed form.
    """

    parents: tuple[str, ...]
    mechanism: Callable[..., Any]
    noise: Draw | None
    abduce: Abduce | None = None
    expectation: Callable[..., Any] | None = None


def no_noise(rng: np.random.Generator, units: int) -> Float[Array, " unit"]:
    """Return zeros: the noise of a node that its parents determine."""
    return np.zeros(units)


@dataclass(frozen=True)
class SCM:
    """Structural assignments over an acyclic graph; ValueError for a cycle or an unknown parent."""

    nodes: Mapping[str, Node]

    def __post_init__(self) -> None:
        for name, node in self.nodes.items():
            unknown = set(node.parents) - set(self.nodes)
            if unknown:
                raise ValueError(f"parents {sorted(unknown)} of {name} are no nodes: add them or drop the arrows")
        _ = self.order

    @property
    def order(self) -> tuple[str, ...]:
        """Return the nodes in topological order."""
        graph = {name: sorted(node.parents) for name, node in sorted(self.nodes.items())}
        try:
            return tuple(TopologicalSorter(graph).static_order())
        except CycleError as error:
            cycle = " -> ".join(reversed(error.args[1]))
            raise ValueError(f"the graph has the cycle {cycle}: a causal model is evaluated in order") from error

    def noise(self, rng: np.random.Generator, units: int) -> Values:
        """Draw N of every node, each from its own random stream, so that no node's draws affect another's."""
        names = sorted(self.nodes)
        noise: Values = {}
        for name, stream in zip(names, rng.spawn(len(names)), strict=True):
            draw = self.nodes[name].noise
            if draw is None:
                raise ValueError(f"the noise of {name} is on record only: give its node a `noise` to draw from")
            noise[name] = draw(stream, units)
        return noise

    def entail(self, noise: Values, *only: str) -> Values:
        """Return every node's value given the noises; with `only`, the values of those nodes and their ancestors."""
        wanted = set(only or self.nodes)
        for name in reversed(self.order):
            wanted |= set(self.nodes[name].parents) if name in wanted else set()
        values: Values = {}
        for name in self.order:
            if name in wanted:
                node = self.nodes[name]
                values[name] = node.mechanism(noise[name], *(values[p] for p in node.parents))
        return values

    def expectation(self, name: str, noise: Values) -> Any:
        """Return E[X | N of all other nodes] of a node in every unit: the closed-form mean over its own noise.

        ValueError if the node has no `expectation`.
        """
        node = self.nodes[name]
        if node.expectation is None:
            raise ValueError(f"{name} has no expectation in closed form: give its node one, or average `entail`")
        values = self.entail(noise, *node.parents) if node.parents else {}
        return node.expectation(*(values[p] for p in node.parents))

    def sample(self, rng: np.random.Generator, units: int) -> Values:
        """Draw units from the entailed distribution."""
        return self.entail(self.noise(rng, units))

    def do(self, **values: Any) -> "SCM":
        """Return the model under do(X := value): each named node is set, and the arrows from its parents are removed.

        A number or string applies to every unit; any other value holds one entry per unit on its first axis. ValueError
        for an unknown node.
        """
        unknown = set(values) - set(self.nodes)
        if unknown:
            raise ValueError(f"do() on {sorted(unknown)}: expected nodes among {', '.join(sorted(self.nodes))}")
        cut = {
            name: replace(self.nodes[name], parents=(), mechanism=_constant(value), abduce=None, expectation=None)
            for name, value in values.items()
        }
        return SCM({**self.nodes, **cut})

    def counterfactual(self, rng: np.random.Generator, recorded: Values, observed: Values, **action: Any) -> Values:
        """Draw every node's value under do(action) in the units with the values `observed`.

        `recorded` holds the known noises, `observed` the observed values of nodes whose noises are unknown.
        """
        noise = self.abduction(rng, recorded, observed)  # 1. abduction
        acted = self.do(**action)  # 2. action
        return acted.entail(noise)  # 3. prediction

    def probability_of_change(self, recorded: Values, v: bool, **action: Any) -> Float[Array, "*b"]:
        """Return P(V_action != v | V = v) in every unit, given all noises but N_V; NaN where V = v is impossible.

        The three steps of `counterfactual` for the node V, with a closed-form mean over the abduced N_V.
        """
        factual, acted = (model.expectation("V", recorded) for model in (self, self.do(**action)))
        return chance_of_change(v, factual, acted)

    def abduction(self, rng: np.random.Generator, recorded: Values, observed: Values) -> Values:
        """Draw N of every node given the observations: recorded noises are kept, others drawn given the node's value.

        Noises are independent and every node's value is entailed, so each noise depends only on its own node and its
        parents.
        ValueError unless every node is either recorded or observed, and each observed node has `abduce`.
        """
        if set(recorded) & set(observed) or set(recorded) | set(observed) != set(self.nodes):
            raise ValueError(
                f"noises of {sorted(recorded)} on record, {sorted(observed)} observed: expected each of "
                f"{', '.join(sorted(self.nodes))} in one of the two"
            )
        noise, values = dict(recorded), {}
        streams = dict(zip(sorted(observed), rng.spawn(len(observed)), strict=True))
        for name in self.order:
            node = self.nodes[name]
            parents = [values[p] for p in node.parents]
            if name in observed:
                if node.abduce is None:
                    raise ValueError(f"{name} was observed, but its noise is unknown given its value: put it on record")
                noise[name] = node.abduce(streams[name], observed[name], *parents)
            values[name] = node.mechanism(noise[name], *parents)
        return noise


def _constant(value: Any) -> Callable[[Any], Any]:
    if isinstance(value, str | int | float | np.generic):
        return lambda noise: np.full(len(noise), value)
    return lambda noise: value


def abduce_threshold(
    rng: np.random.Generator, v: Bool[Array, "*unit"], c: Float[Array, "*unit"]
) -> Float[Array, "*unit"]:
    """Draw N, uniform on [0, 1), given 1[N < c] = v: uniform on [0, c) where v is true, on [c, 1) elsewhere.

    ValueError where no N gives v: c = 0 and v true, or c = 1 and v false.
    """
    c = np.asarray(c, dtype=np.float64)
    low, high = np.where(v, 0.0, c), np.where(v, c, 1.0)
    if (low >= high).any():
        raise ValueError(
            f"{(low >= high).sum()} units show what has probability 0: expected V = 1 only where C > 0 "
            "and V = 0 only where C < 1"
        )
    return np.minimum(low + (high - low) * rng.random(c.shape), np.nextafter(high, low))


def chance_of_change(v: bool, before: Float[Array, "*#b"], after: Float[Array, "*#b"]) -> Float[Array, "*b_all"]:
    """Return P(V_{C := after} != v | V = v, C = before) for V := 1[N_V < C], N_V held; NaN where V = v is impossible.

    max(0, after - before) / (1 - before) for v = 0, max(0, before - after) / before for v = 1. This is the smallest
    probability that any joint distribution of both answers allows (Tian and Pearl, 2000): a higher C turns no V from 1
    to 0.
    """
    before, after = (np.asarray(c, dtype=np.float64) for c in (before, after))
    observed, lost = (before, before - after) if v else (1 - before, after - before)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(observed > 0, np.maximum(lost, 0.0) / observed, np.nan)


def specification_scm(
    users: Sequence[str],
    render: Callable[[Any, Any, Any], Any],
    encode: Callable[[Any], Any],
    classify: Callable[[Any, Any, Any], Array],
    draw_items: Draw | None = None,
    draw_table_top: Draw | None = None,
    draw_render_seed: Draw | None = None,
) -> SCM:
    """Return the graph of this module with the given mechanisms.

    `render(render_seed, items, table_top)` gives the image and `encode(image)` the percepts of the users' models.
    `classify(s, z_image, z_theta)` gives the probability C_s that each path [m] is valid. The draws give each unit's
    items, table top and render seed; without them, these noises must be recorded.
    """

    def v(noise: Any, *parents: Any) -> Any:
        return noise < classify(*parents)

    def abduce_v(rng: np.random.Generator, value: Any, *parents: Any) -> Any:
        return abduce_threshold(rng, value, classify(*parents))

    return SCM(
        {
            "S": Node((), lambda n: np.asarray(users)[n], lambda rng, units: rng.integers(len(users), size=units)),
            "O": Node((), lambda n: n, draw_items),
            "T": Node((), lambda n: n, draw_table_top),
            "Z_theta": Node((), lambda n: n, random_z_theta),
            "I": Node(PARENTS["I"], render, draw_render_seed),
            "Z_I": Node(PARENTS["Z_I"], lambda _, image: encode(image), no_noise),
            "V": Node(PARENTS["V"], v, lambda rng, units: rng.random(units), abduce_v, classify),
        }
    )
