"""Arms as the study sets them, each loaded and mapped once; the tests need the packages of the extra `robot`."""

import pytest

from pipeline.robot import PACKAGES

for package in PACKAGES:
    pytest.importorskip(package)

from omegaconf import OmegaConf

from pipeline.robot.arm import Arm, load_arm
from pipeline.robot.bench import Bench
from pipeline.robot.inverse import PostureMap, posture_map
from tests.factories import composed

TALLEST_M = 0.12


@pytest.fixture(scope="session")
def pr2() -> Arm:
    return arm("pr2")


@pytest.fixture(scope="session")
def bench() -> Bench:
    return Bench(side_m=0.6, base_x=0.18, base_y=-0.15, turn_deg=90.0, height_m=0.7, grip_m=0.155)


@pytest.fixture(scope="session")
def postures(pr2: Arm, bench: Bench) -> PostureMap:
    return posture_map(pr2, bench, 21, bench.side_m * TALLEST_M)


def arm(name: str) -> Arm:
    return load_arm(name, OmegaConf.to_container(composed().studies.execution.arms[name]))  # pyright: ignore
