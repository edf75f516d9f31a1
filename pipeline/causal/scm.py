"""The structural causal model the questions are asked of, with its exogenous noises in plain sight.

The paper (Section "ValidityModel Model Differences") takes X = {Z_theta, Z_I, S, V} and gives each node
all the others as parents. Taken literally that is a cycle: there is no order to evaluate the nodes in, and
no distribution that the model entails. We commit to the acyclic graph its figure suggests, the items O and
the image I made explicit:

    O -> I -> Z_I -> V,    Z_theta -> V,    S -> V

- Z_theta has no parent. A demonstrator looks at the table while moving, so in the demonstrations O and S
  do cause Z_theta; but the paths we ask about are drawn at random, the same for every user and table: no
  arrow is left.
- S has V as its only child. Each user has a model, and so an encoder, of its own; Z_I is what all of them
  keep of the image, and C_s reads its own part. Another user is another judge of the same table.
- V := 1[N_V < C_s(Z_I, Z_theta)] with N_V uniform: the same draw decides before and after an intervention,
  and E[V | Z_I, Z_theta, S = s] is C_s itself.

A counterfactual holds the noises (Pearl, 2009, Theorem 7.1.7). Every cause of V is on record (the items, the path,
the user, and the look of the picture by its render seed), so N_V alone has to be abduced, and V = v says where it lies.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.world.bezier import random_z_theta

PARENTS = {
    "S": (),
    "O": (),
    "Z_theta": (),
    "I": ("O",),
    "Z_I": ("I",),
    "V": ("S", "Z_I", "Z_theta"),
}
Values = dict[str, Any]  # node -> its value in every unit (first axis: unit)
Draw = Callable[[np.random.Generator, int], Any]  # generator, units -> noise of every unit
Abduce = Callable[..., Any]  # generator, value, *parents -> noise of every unit, drawn given what was seen


@dataclass(frozen=True)
class Node:
    """X_j := f_j(PA_j, N_j): its parents' names, `mechanism(noise, *parents)` and how its noise is drawn.

    `abduce(rng, value, *parents)` draws the noise given the node's value; None: it cannot be told from the value.
    """

    parents: tuple[str, ...]
    mechanism: Callable[..., Any]
    noise: Draw
    abduce: Abduce | None = None


def no_noise(rng: np.random.Generator, units: int) -> Float[Array, " unit"]:
    """For a node that its parents determine."""
    return np.zeros(units)


@dataclass(frozen=True)
class SCM:
    """Structural assignments over an acyclic graph; ValueError if there is a cycle or an unknown parent."""

    nodes: Mapping[str, Node]

    def __post_init__(self) -> None:
        for name, node in self.nodes.items():
            unknown = set(node.parents) - set(self.nodes)
            if unknown:
                raise ValueError(f"parents {sorted(unknown)} of {name} are no nodes: add them or drop the arrows")
        _ = self.order

    @property
    def order(self) -> tuple[str, ...]:
        """The nodes, every one after its parents."""
        graph = {name: sorted(node.parents) for name, node in sorted(self.nodes.items())}
        try:
            return tuple(TopologicalSorter(graph).static_order())
        except CycleError as error:
            cycle = " -> ".join(reversed(error.args[1]))
            raise ValueError(f"the graph has the cycle {cycle}: a causal model is evaluated in order") from error

    def noise(self, rng: np.random.Generator, units: int) -> Values:
        """N of every node, from a stream of its own, so that one node's draws never move another's."""
        names = sorted(self.nodes)
        return {n: self.nodes[n].noise(r, units) for n, r in zip(names, rng.spawn(len(names)), strict=True)}

    def entail(self, noise: Values) -> Values:
        """Every node's value in the units with these noises."""
        values: Values = {}
        for name in self.order:
            node = self.nodes[name]
            values[name] = node.mechanism(noise[name], *(values[p] for p in node.parents))
        return values

    def sample(self, rng: np.random.Generator, units: int) -> Values:
        """Draw units from the entailed distribution."""
        return self.entail(self.noise(rng, units))

    def do(self, **values: Any) -> "SCM":
        """The model with each named node set, its arrows from its parents cut: do(X := value).

        A number or a string goes to every unit; anything else holds one value a unit along its first axis.
        """
        unknown = set(values) - set(self.nodes)
        if unknown:
            raise ValueError(f"do() on {sorted(unknown)}: expected nodes among {', '.join(sorted(self.nodes))}")
        cut = {n: replace(self.nodes[n], parents=(), mechanism=_constant(v), abduce=None) for n, v in values.items()}
        return SCM({**self.nodes, **cut})

    def counterfactual(self, rng: np.random.Generator, recorded: Values, seen: Values, **action: Any) -> Values:
        """Every node's value under do(action) in the very units in which `seen` was seen.

        `recorded` holds the noises that are known, `seen` the values of the nodes whose noises are not.
        """
        noise = self.abduction(rng, recorded, seen)  # 1. abduction
        acted = self.do(**action)  # 2. action
        return acted.entail(noise)  # 3. prediction

    def abduction(self, rng: np.random.Generator, recorded: Values, seen: Values) -> Values:
        """N of every node given what is known: a noise not on record is drawn given its node's value.

        Noises are independent and every node's value follows, so each depends on its own node and parents alone.
        ValueError unless every node is either on record or seen, and its noise can be told from its value.
        """
        if set(recorded) & set(seen) or set(recorded) | set(seen) != set(self.nodes):
            raise ValueError(
                f"noises of {sorted(recorded)} on record, {sorted(seen)} seen: expected each of "
                f"{', '.join(sorted(self.nodes))} in one of the two"
            )
        noise, values = dict(recorded), {}
        streams = dict(zip(sorted(seen), rng.spawn(len(seen)), strict=True))
        for name in self.order:
            node = self.nodes[name]
            parents = [values[p] for p in node.parents]
            if name in seen:
                if node.abduce is None:
                    raise ValueError(f"{name} was seen, but its noise cannot be told from its value: put it on record")
                noise[name] = node.abduce(streams[name], seen[name], *parents)
            values[name] = node.mechanism(noise[name], *parents)
        return noise


def _constant(value: Any) -> Callable[[Any], Any]:
    if np.ndim(value) == 0 and isinstance(value, str | int | float | np.generic):
        return lambda noise: np.full(len(noise), value)
    return lambda noise: value


def abduce_threshold(
    rng: np.random.Generator, v: Bool[Array, " unit"], c: Float[Array, " unit"]
) -> Float[Array, " unit"]:
    """N given 1[N < c] = v for N uniform on [0, 1): uniform on [0, c) where v, on [c, 1) elsewhere.

    ValueError where no N gives v: c = 0 and v, or c = 1 and not v.
    """
    c = np.asarray(c, dtype=np.float64)
    low, high = np.where(v, 0.0, c), np.where(v, c, 1.0)
    if (low >= high).any():
        raise ValueError(
            f"{(low >= high).sum()} units show what has probability 0: expected V = 1 only where C > 0 "
            "and V = 0 only where C < 1"
        )
    return np.minimum(low + (high - low) * rng.random(len(c)), np.nextafter(high, low))


def chance_of_change(v: bool, before: Float[Array, "*#b"], after: Float[Array, "*#b"]) -> Float[Array, "*b_all"]:
    """P(V_{C := after} != v | V = v, C = before) for V := 1[N_V < C], the noise held; NaN where V = v cannot be.

    max(0, after - before) / (1 - before) for v = 0, max(0, before - after) / before for v = 1: the least chance that
    any joint law of the two answers allows (Tian and Pearl, 2000), since what makes a path likelier invalidates none.
    """
    before, after = (np.asarray(c, dtype=np.float64) for c in (before, after))
    seen, lost = (before, before - after) if v else (1 - before, after - before)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(seen > 0, np.maximum(lost, 0.0) / seen, np.nan)


def specification_scm(
    users: Sequence[str],
    draw_items: Draw,
    draw_look: Draw,
    render: Callable[[Any, Any], Any],
    encode: Callable[[Any], Any],
    classify: Callable[[Any, Any, Any], Float[Array, " unit"]],
) -> SCM:
    """The committed graph with these mechanisms.

    `draw_items` and `draw_look` draw the items on each table and each picture's light and noise;
    `render(look, items)` is the image, `encode(image)` what the users' models keep of it, and
    `classify(s, z_image, z_theta)` the probability C_s that each path [m] is valid.
    """
    mechanisms = {
        "S": (lambda n: np.asarray(users)[n], lambda rng, units: rng.integers(len(users), size=units)),
        "O": (lambda n: n, draw_items),
        "Z_theta": (lambda n: n, random_z_theta),
        "I": (render, draw_look),
        "Z_I": (lambda _, image: encode(image), no_noise),
        "V": (
            lambda n, s, z_image, z_theta: n < classify(s, z_image, z_theta),
            lambda rng, units: rng.random(units),
        ),
    }
    nodes = {name: Node(PARENTS[name], f, noise) for name, (f, noise) in mechanisms.items()}
    nodes["V"] = replace(nodes["V"], abduce=lambda rng, v, *parents: abduce_threshold(rng, v, classify(*parents)))
    return SCM(nodes)
