"""The arm as the study sets it, mapped once; without the extra `robot` its tests are left out."""

from importlib.util import find_spec

import pytest

from tests.factories import composed

TALLEST_M = 0.12
collect_ignore_glob = ["test_*.py"] if find_spec("pinocchio") is None else []


@pytest.fixture(scope="session")
def pr2():
    from pipeline.robot.arm import load_arm

    study = composed().studies.execution
    return load_arm(tuple(study.posture.items()), tuple(study.still.items()))


@pytest.fixture(scope="session")
def bench():
    from pipeline.robot.arm import Bench

    return Bench(side_m=0.6, base_x=0.18, base_y=-0.15, height_m=0.7, grip_m=0.155)


@pytest.fixture(scope="session")
def postures(pr2, bench):
    from pipeline.robot.inverse import posture_map

    return posture_map(pr2, bench, 21, bench.side_m * TALLEST_M)
