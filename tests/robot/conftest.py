"""Arms as the study sets them, each loaded and mapped once; without the extra `robot` its tests are left out."""

from importlib.util import find_spec

import pytest
from omegaconf import OmegaConf

from pipeline.robot import PACKAGES
from tests.factories import composed

TALLEST_M = 0.12
WITHOUT_EXTRA = ["test_carried.py", "test_execution.py", "test_export.py"]
collect_ignore = WITHOUT_EXTRA if any(find_spec(name) is None for name in PACKAGES) else []


@pytest.fixture(scope="session")
def pr2():
    return arm("pr2")


@pytest.fixture(scope="session")
def bench():
    from pipeline.robot.bench import Bench

    return Bench(side_m=0.6, base_x=0.18, base_y=-0.15, turn_deg=90.0, height_m=0.7, grip_m=0.155)


@pytest.fixture(scope="session")
def postures(pr2, bench):
    from pipeline.robot.inverse import posture_map

    return posture_map(pr2, bench, 21, bench.side_m * TALLEST_M)


def arm(name: str):
    """Return an arm as conf/ sets it."""
    from pipeline.robot.arm import load_arm

    return load_arm(name, OmegaConf.to_container(composed().studies.execution.arms[name]))  # pyright: ignore
