"""Repairs are judged by the truth, and their lengths beside the oracle's."""

import pandas as pd
import pytest

from pipeline.artifacts.repairs import measures


def test_displacements_are_compared_with_the_oracles_over_all_starts_together():
    rows = pd.DataFrame(
        {"valid_end": True, "accepted": True, "displacement_m": [1.0, 3.0], "oracle_displacement_m": [1.0, 1.5]}
    )
    found = measures(rows)
    assert found["displacement_ratio"] == pytest.approx(1.6)  # the mean of 1 and 2 would be 1.5
    assert (found["displacement_m"], found["oracle_displacement_m"]) == (2.0, 1.25)
