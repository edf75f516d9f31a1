"""The procedure put to the test: families of effects whose truth is known, drawn as seeds and scenes cross.

Chance is either a variant's own: its measured effects, less their means, of seeds and scenes drawn anew (a bootstrap of
rows and columns; Owen, 2007), with whatever skew and ties they have. Or it is stylised: mean + seed's chance + scene's
chance + the pair's, with the standard deviations of a regime in which a single source rules, or both matter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.causal.statistics import LEVEL, VERDICTS, estimate, holm, mean_squares, verdict, with_rare_scenes

AT_ONCE = 100  # families in memory

Draw = Callable[[np.random.Generator, int], Float[Array, "family cell seed scene"]]  # so many without any effect


@dataclass(frozen=True)
class Regime:
    """Standard deviations of the three sources of chance."""

    by_seed: float
    by_scene: float
    rest: float
    skewed: bool = False  # seeds and scenes exponentially distributed instead of normally
    seldom: float = 0.0  # share of the scenes in which the scenes' chance lies, then the same in each; 0: in all


def observed(effects: Float[Array, "cell seed scene"]) -> Regime:
    """The regime of measured effects: variance components by the method of moments, mean over cells."""
    seeds, scenes = effects.shape[-2:]
    by_seed, by_scene, rest = (m.mean() for m in mean_squares(effects))
    seed_variance, scene_variance = max(by_seed - rest, 0.0) / scenes, max(by_scene - rest, 0.0) / seeds
    return Regime(float(np.sqrt(seed_variance)), float(np.sqrt(scene_variance)), float(np.sqrt(rest)))


def stylised(regime: Regime, cells: int, seeds: int, scenes: int) -> Draw:
    """Families whose cells know nothing of one another, with a regime's chance."""

    def draw(rng: np.random.Generator, families: int) -> Float[Array, "family cell seed scene"]:
        def chance(*shape: int) -> Array:
            return rng.exponential(size=shape) - 1 if regime.skewed else rng.standard_normal(shape)

        def of_scenes(*shape: int) -> Array:
            share = regime.seldom
            if not share:
                return chance(*shape)
            return (share - (rng.random(shape) < share)) / np.sqrt(share * (1 - share))

        return (
            regime.by_seed * chance(families, cells, seeds, 1)
            + regime.by_scene * of_scenes(families, cells, 1, scenes)
            + regime.rest * rng.standard_normal((families, cells, seeds, scenes))
        )

    return draw


def resampled(effects: Float[Array, "cell seed scene"]) -> Draw:
    """Families with measured effects' chance; the cells of one share its seeds and scenes, as the measured ones do."""
    chance = effects - effects.mean((1, 2), keepdims=True)
    _, seeds, scenes = effects.shape

    def draw(rng: np.random.Generator, families: int) -> Float[Array, "family cell seed scene"]:
        seed = rng.integers(seeds, size=(families, seeds, 1))
        scene = rng.integers(scenes, size=(families, 1, scenes))
        return np.moveaxis(chance[:, seed, scene], 1, 0)

    return draw


def check(rng: np.random.Generator, draw: Draw, families: int, cells: int, effects: Sequence[float]) -> dict:
    """What the procedure makes of `families` null families, and of an effect in one cell of each, in turn.

    cells: those that Holm corrects for; where fewer are drawn, the others' effects are zero without any chance.
    family_wise_error: share of null families in which Holm rejects something; false_causes: in which a verdict is
    "effect"; coverage: of the 95 % intervals; power: by effect, the share of each verdict on the cell that has it.
    """
    rejected, named, covered = [], [], []
    said: dict[float, dict[str, int]] = {effect: dict.fromkeys(VERDICTS, 0) for effect in effects}
    for start in range(0, families, AT_ONCE):
        some = min(AT_ONCE, families - start)
        null = with_rare_scenes(draw(rng, some))
        drawn = null.shape[1]
        e = estimate(null.reshape(-1, *null.shape[2:]))
        p = np.ones((some, cells))
        p[:, :drawn] = e.p.reshape(some, drawn)
        adjusted = holm(p)
        rejected.append((adjusted < LEVEL).any(1))
        verdicts = map(verdict, e.effect, adjusted[:, :drawn].ravel(), e.ci90_low, e.ci90_high)
        named.append((np.array(list(verdicts)) == "effect").reshape(some, drawn).any(1))
        covered.append((e.ci_low <= 0) & (e.ci_high >= 0))
        one = np.arange(some), np.arange(start, start + some) % drawn
        for effect in effects:
            moved = estimate(null[one] + effect)
            with_effect = p.copy()
            with_effect[one] = moved.p
            p_holm = holm(with_effect)[one]
            for found in map(verdict, moved.effect, p_holm, moved.ci90_low, moved.ci90_high):
                said[effect][found] += 1
    return {
        "family_wise_error": float(np.concatenate(rejected).mean()),
        "false_causes": float(np.concatenate(named).mean()),
        "coverage": float(np.concatenate(covered).mean()),
        "power": {str(effect): {v: count / families for v, count in by.items()} for effect, by in said.items()},
    }
