"""The least data at which a curve reaches a threshold."""

import pytest

from pipeline.spec.efficiency import reaches


@pytest.mark.parametrize(
    ("curve", "least"),
    [
        ({5: 0.80, 10: 0.93, 20: 0.96, 40: 0.98}, 20),
        ({40: 0.98, 5: 0.80, 20: 0.96, 10: 0.93}, 20),  # in whatever order
        ({5: 0.95, 10: 0.99}, 5),  # the threshold itself counts
        ({5: 0.96, 10: 0.94, 20: 0.97}, 5),  # and so does a first time that does not last
        ({5: 0.50, 40: 0.94}, None),
        ({}, None),
    ],
)
def test_the_smallest_amount_at_or_above_the_threshold(curve: dict[int, float], least: int | None):
    assert reaches(curve, 0.95) == least
