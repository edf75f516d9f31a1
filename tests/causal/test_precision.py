"""What could be detected is detected as often as promised, and as many scenes as are asked for settle a verdict."""

from math import ceil

import numpy as np
import pytest
from scipy.stats import t as student

from pipeline.causal.interventions import judge
from pipeline.causal.precision import POWER, detectable, scenes_to_settle, seed_by_seed
from pipeline.causal.statistics import ENOUGH, SMALLEST_EFFECT


def chances(rng: np.random.Generator, cells: int, scenes: int, by_scene: float, by_seed: float = 0.0) -> np.ndarray:
    """Effects of nothing but chance, (cell, 10 seeds, scene)."""
    return (
        rng.normal(0, by_seed, (cells, 10, 1)) + rng.normal(0, by_scene, (cells, 1, scenes))
        + rng.normal(0, 0.05, (cells, 10, scenes))
    )  # fmt: skip


@pytest.mark.parametrize("by_scene", [0.2, 0.02], ids=["chance decides", "the smallest effect of interest decides"])
def test_an_effect_as_large_as_the_detectable_one_is_found_as_often_as_promised(by_scene: float):
    rng = np.random.default_rng(0)
    found = []
    for _ in range(400):
        effects = chances(rng, 12, 40, by_scene)
        effects[0] += detectable(chances(rng, 12, 40, by_scene)).mean()
        found.append(judge(effects)[0]["verdict"] == "effect")
    assert abs(np.mean(found) - POWER) < 0.07


def test_nothing_smaller_than_the_smallest_effect_of_interest_is_detectable():
    assert (detectable(np.zeros((3, 4, 20))) == SMALLEST_EFFECT).all()
    assert (detectable(chances(np.random.default_rng(4), 12, 40, 0.02)) > SMALLEST_EFFECT).all()


def test_a_verdict_is_settled_by_more_scenes_than_are_asked_for_and_left_open_by_fewer():
    rng = np.random.default_rng(1)

    def centred(mean: float, scenes: int) -> np.ndarray:
        effects = chances(rng, 4, scenes, 0.25)
        return effects + mean - effects.mean((1, 2), keepdims=True)

    def settled(mean: float, scenes: int) -> float:
        said = [judge(centred(mean, scenes))[0]["verdict"] for _ in range(40)]
        return float(np.mean([s != "inconclusive" for s in said]))

    for mean in (0.0, 0.03, 0.09):
        needed = scenes_to_settle(centred(mean, 300))[0]
        assert needed is not None
        assert settled(mean, round(1.5 * needed)) > 0.9
        assert settled(mean, round(0.6 * needed)) < 0.1


def test_scenes_that_vary_less_than_the_rest_count_for_what_the_rest_does():
    """Seeds alike, scenes alike but for chance: a scene's share of the variance is the rest's, by closed form."""
    rng, seeds, scenes = np.random.default_rng(5), 6, 9
    rest = rng.normal(size=(seeds, scenes))
    rest = 0.4 * (rest - rest.mean(0) - rest.mean(1, keepdims=True) + rest.mean())
    effects = rest[None]
    per_scene = (rest**2).sum() / ((seeds - 1) * (scenes - 1)) / seeds
    allowed = (SMALLEST_EFFECT / student.ppf(0.95, (seeds - 1) * (scenes - 1))) ** 2
    needed = ceil(per_scene / allowed)
    assert scenes_to_settle(effects) == [needed] and needed > 2


def test_a_cell_whose_scenes_agree_is_settled_by_as_many_as_its_family_needs_to_be_believed():
    rng = np.random.default_rng(6)
    family = chances(rng, 3, 100, 0.6)
    family[0] = 0.0

    def settled(scenes: int) -> bool:
        few = family[:, :, :scenes].copy()
        few[1, :, 0] += np.abs(family).max() - np.abs(few).max()  # as far as any goes, however few are drawn
        return judge(few)[0]["verdict"] == "no effect"

    needed = scenes_to_settle(family)[0]
    assert needed is not None and 0.6 * needed > ENOUGH
    assert settled(round(1.4 * needed)) and not settled(round(0.6 * needed))


def test_more_scenes_do_not_settle_what_the_seeds_leave_open():
    effects = chances(np.random.default_rng(2), 3, 50, 0.0, by_seed=0.3)
    effects += 0.04 - effects.mean((1, 2), keepdims=True)
    assert scenes_to_settle(effects) == [None] * 3


def test_clear_effects_are_right_in_every_seed_and_of_the_wrong_sign_in_none():
    effects = chances(np.random.default_rng(3), 2, 60, 0.02) + np.array([-0.3, 0.0])[:, None, None]
    assert seed_by_seed(effects, np.array([-0.3, 0.0])) == 20
    assert seed_by_seed(effects, np.array([0.3, 0.0])) == 10
