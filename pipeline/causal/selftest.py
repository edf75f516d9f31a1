"""The procedure put to the test: families of effects whose truth is known, drawn as seeds and scenes cross.

An effect is mean + seed's chance + scene's chance + the pair's, with the standard deviations of a regime: those that
a variant's own effects show, or one in which a single source rules.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.causal.statistics import LEVEL, VERDICTS, estimate, holm, mean_squares, verdict

AT_ONCE = 100  # families in memory


@dataclass(frozen=True)
class Regime:
    """Standard deviations of the three sources of chance."""

    by_seed: float
    by_scene: float
    rest: float
    skewed: bool = False  # seeds and scenes exponentially distributed instead of normally


def observed(effects: Float[Array, "cell seed scene"]) -> Regime:
    """The regime of measured effects: variance components by the method of moments, mean over cells."""
    seeds, scenes = effects.shape[-2:]
    by_seed, by_scene, rest = (m.mean() for m in mean_squares(effects))
    seed_variance, scene_variance = max(by_seed - rest, 0.0) / scenes, max(by_scene - rest, 0.0) / seeds
    return Regime(float(np.sqrt(seed_variance)), float(np.sqrt(scene_variance)), float(np.sqrt(rest)))


def null_cells(
    rng: np.random.Generator, regime: Regime, cells: int, seeds: int, scenes: int
) -> Float[Array, "cell seed scene"]:
    """Cells without any effect."""

    def chance(*shape: int) -> Array:
        return rng.exponential(size=shape) - 1 if regime.skewed else rng.standard_normal(shape)

    return (
        regime.by_seed * chance(cells, seeds, 1)
        + regime.by_scene * chance(cells, 1, scenes)
        + regime.rest * rng.standard_normal((cells, seeds, scenes))
    )


def check(
    rng: np.random.Generator,
    regime: Regime,
    families: int,
    cells: int,
    seeds: int,
    scenes: int,
    effects: Sequence[float],
) -> dict:
    """What the procedure makes of `families` null families, and of an effect in one cell of each.

    family_wise_error: share of null families in which Holm rejects something; false_causes: in which a verdict is
    "effect"; coverage: of the 95 % intervals; power: by effect, the share of each verdict on the cell that has it.
    """
    rejected, named, covered = [], [], []
    said: dict[float, dict[str, int]] = {effect: dict.fromkeys(VERDICTS, 0) for effect in effects}
    for start in range(0, families, AT_ONCE):
        some = min(AT_ONCE, families - start)
        null = null_cells(rng, regime, some * cells, seeds, scenes)
        e = estimate(null)
        p = e.p.reshape(some, cells)
        adjusted = holm(p)
        rejected.append((adjusted < LEVEL).any(1))
        verdicts = map(verdict, e.effect, adjusted.ravel(), e.ci90_low, e.ci90_high)
        named.append((np.array(list(verdicts)) == "effect").reshape(some, cells).any(1))
        covered.append((e.ci_low <= 0) & (e.ci_high >= 0))
        for effect in effects:
            moved = estimate(null[::cells] + effect)
            p_holm = holm(np.concatenate([moved.p[:, None], p[:, 1:]], axis=1))[:, 0]
            for found in map(verdict, moved.effect, p_holm, moved.ci90_low, moved.ci90_high):
                said[effect][found] += 1
    return {
        "family_wise_error": float(np.concatenate(rejected).mean()),
        "false_causes": float(np.concatenate(named).mean()),
        "coverage": float(np.concatenate(covered).mean()),
        "power": {str(effect): {v: count / families for v, count in by.items()} for effect, by in said.items()},
    }
