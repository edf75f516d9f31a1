"""An item counts once, whatever the number of scenes it was added to."""

import numpy as np
import pytest

from pipeline.stats.clusters import by_item, inflate_item_variance


def test_an_items_scenes_are_averaged_where_they_have_the_dose():
    drop = np.array([[[1, 2.0], [3, np.nan], [5, np.nan], [7, np.nan]]])  # of one seed, in four scenes
    np.testing.assert_array_equal(by_item(drop, np.array([4, 4, 2, 2])), [[[6, np.nan], [2, 2]]])  # item 2, item 4


def test_a_second_scene_with_the_same_effect_of_an_item_does_not_count():
    drop = np.random.default_rng(0).normal(size=(3, 4, 2))
    item = np.array([0, 1, 2, 3])
    twice = by_item(np.concatenate([drop, drop[:, :1]], axis=1), np.append(item, 0))
    np.testing.assert_array_equal(twice, by_item(drop, item))


@pytest.mark.parametrize("n_training", [2, 6, 100])
def test_items_lie_further_apart_by_the_chance_of_those_that_were_trained_on(n_training: int):
    """The variance of the mean over items grows from 1 / n to 1 / n + 1 / n_training; nothing else changes."""
    values = np.random.default_rng(1).normal(size=(10, 6))
    wider = inflate_item_variance(values, n_training)
    assert wider.mean(0).var() == pytest.approx(values.mean(0).var() * 6 * (1 / 6 + 1 / n_training))
    np.testing.assert_allclose(wider.mean(1), values.mean(1))  # seed by seed
    np.testing.assert_allclose(wider - wider.mean(0), values - values.mean(0))
