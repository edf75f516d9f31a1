"""Repairs are judged by the truth, their lengths beside the oracle's, and their rates by seeds and scenes."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from pipeline.planning.measures import by_threshold, measures, summary


def ends(valid: np.ndarray, accepted: np.ndarray | bool = True, p: float | np.ndarray = 0.9) -> list[pd.DataFrame]:
    """A table a seed of ends, `valid` by seed and scene, two starts in each scene."""
    accepted = np.broadcast_to(accepted, valid.shape)
    return [
        pd.DataFrame(
            {
                "seed": seed, "scene": np.repeat(np.arange(valid.shape[1]), 2), "valid_end": np.repeat(of, 2),
                "accepted": pd.array(np.repeat(called, 2), dtype="boolean"),
                "p_end": np.broadcast_to(p, 2 * len(of)), "displacement_m": 1.0, "oracle_displacement_m": 0.5,
            }
        )
        for seed, (of, called) in enumerate(zip(valid, accepted, strict=True))
    ]  # fmt: skip


def test_displacements_are_compared_with_the_oracles_over_all_starts_together():
    rows = pd.DataFrame(
        {"valid_end": True, "accepted": True, "displacement_m": [1.0, 3.0], "oracle_displacement_m": [1.0, 1.5]}
    )
    found = measures(rows)
    assert found["displacement_ratio"] == pytest.approx(1.6)  # the mean of 1 and 2 would be 1.5
    assert (found["displacement_m"], found["oracle_displacement_m"]) == (2.0, 1.25)


def test_failures_do_not_shorten_the_displacement_of_ends_that_are_valid():
    (rows,) = ends(np.array([[True, False]]))
    rows["displacement_m"] = [2.0, 2.0, 0.0, 0.0]
    found = summary([rows])
    assert (found["displacement_ratio"], found["displacement_ratio_valid"]) == (2.0, 4.0)
    assert summary(ends(np.array([[False, False]])))["displacement_ratio_valid"] is None


def test_a_rate_that_differs_by_scene_alone_has_the_interval_of_the_scenes():
    """All seeds alike: further seeds say nothing, and the interval is Student's over scenes."""
    valid = np.broadcast_to([True, True, True, False, True, False], (4, 6))
    found = summary(ends(valid))
    shares = valid[0].astype(float)
    half = student.ppf(0.975, 5) * shares.std(ddof=1) / np.sqrt(6)
    assert found["success_ci"] == pytest.approx([shares.mean() - half, min(shares.mean() + half, 1.0)])
    assert found["success"] == found["success_q1"] == found["success_q3"] == pytest.approx(4 / 6)


def test_whoever_is_fooled_accepts_what_is_invalid():
    valid, accepted = np.array([[True, False, False], [True, True, False]]), np.array([[True, True, False]] * 2)
    found = summary(ends(valid, accepted))
    assert found["fooled"] == pytest.approx(1 / 6) and found["abstained"] == pytest.approx(1 / 3)
    low, high = found["fooled_ci"]
    assert 0 <= low <= 1 / 6 <= high
    assert summary(ends(valid[:, :1], accepted[:, :1]))["fooled_ci"] is None


def test_a_higher_threshold_accepts_less_and_says_how_much_of_it_is_invalid():
    valid = np.array([[True, True, False, False]])
    p = np.repeat([0.99, 0.7, 0.95, 0.6], 2)
    low, middle, high, none = by_threshold(ends(valid, p=p), [0.5, 0.8, 0.97, 0.995])
    assert low == {"above": 0.5, "accepted": 1.0, "fooled": 0.5, "invalid": 0.5}
    assert middle == {"above": 0.8, "accepted": 0.5, "fooled": 0.25, "invalid": 0.5}
    assert high == {"above": 0.97, "accepted": 0.25, "fooled": 0.0, "invalid": 0.0}
    assert none == {"above": 0.995, "accepted": 0.0, "fooled": 0.0, "invalid": None}
