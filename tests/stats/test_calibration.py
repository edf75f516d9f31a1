"""The procedure on simulated families: family-wise error, coverage and verdicts, where the true effects are known.

Each family has twelve questions on ten seeds crossed with 500 scenes, as stage intervene's. An effect is a mean plus
the chance of its seed, of its scene and of the pair; the regimes differ in which of them rules.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from pipeline.causal.interventions import estimate_effects
from pipeline.stats.crossed import estimate
from pipeline.stats.tests import LEVEL, SMALLEST_EFFECT, holm

FAMILIES, QUESTIONS, SEEDS, SCENES = 60, 12, 10, 500
TOLERANCE = 3 * (LEVEL * (1 - LEVEL) / FAMILIES) ** 0.5  # three standard errors of a share of LEVEL

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Regime:
    """Standard deviations [P(valid)] of the three sources of chance.

    informative: the number of scenes in which all the scenes' chance lies, on average; 0: normal chance in all.
    """

    by_seed: float
    by_scene: float
    rest: float
    informative: int = 0

    def draw(self, effect: float = 0.0, families: int = FAMILIES) -> Iterator[np.ndarray]:
        """Yield families (question, seed, scene) whose every question has the effect."""
        rng, share = np.random.default_rng(7), self.informative / SCENES
        for _ in range(families):
            scenes = rng.standard_normal((QUESTIONS, 1, SCENES))
            if share:
                scenes = (share - (rng.random(scenes.shape) < share)) / np.sqrt(share * (1 - share))
            yield (
                effect
                + self.by_seed * rng.standard_normal((QUESTIONS, SEEDS, 1))
                + self.by_scene * scenes
                + self.rest * rng.standard_normal((QUESTIONS, SEEDS, SCENES), dtype=np.float32)
            )


REGIMES = {"both matter": Regime(0.03, 0.1, 0.1), "20 scenes decide": Regime(0.0, 0.06, 0.01, informative=20)}


def verdicts(regime: Regime, effect: float) -> np.ndarray:
    return np.concatenate([estimate_effects(family)["verdict"] for family in regime.draw(effect, 50)])


@pytest.mark.parametrize("regime", REGIMES.values(), ids=REGIMES)
def test_a_family_without_effects_rarely_shows_one_and_intervals_cover(regime: Regime):
    estimates = [estimate(family, skewed=True) for family in regime.draw()]
    assert np.mean([(holm(e.p) < LEVEL).any() for e in estimates]) <= LEVEL + TOLERANCE
    assert 0.935 <= np.mean([(e.ci_low <= 0) & (e.ci_high >= 0) for e in estimates]) <= 0.975


def test_verdicts_where_both_sources_matter_are_those_the_effect_deserves():
    regime = REGIMES["both matter"]
    assert np.mean(verdicts(regime, 0.0) == "negligible") >= 0.9 <= np.mean(verdicts(regime, 0.1) == "effect")
    assert np.mean(verdicts(regime, SMALLEST_EFFECT) == "negligible") <= LEVEL + TOLERANCE  # at the bound rarely
