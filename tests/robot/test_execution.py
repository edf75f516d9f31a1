"""Movements follow their path, executed paths keep the joints' limits, failures have the right name; exports agree."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader  # pyright: ignore[reportMissingImports]

from pipeline.robot.arm import Arm, Bench, Collisions
from pipeline.robot.execution import KIND, TYPES, Motion, execute, lengths, minimum_jerk, write_bag
from pipeline.robot.inverse import COLLISION, PostureMap, posture_map
from pipeline.world.bezier import P_F, P_INIT, curve, random_z_theta
from tests.robot.conftest import TALLEST_M

ERROR_M, TILT_RAD = 0.002, 0.02
Z_THETA = random_z_theta(np.random.default_rng(1), 8)


@pytest.fixture(scope="module")
def motion(pr2: Arm, bench: Bench, postures: PostureMap) -> Motion:
    return execute(pr2, bench, postures, Z_THETA, 64, 0.35, ERROR_M, TILT_RAD)


def test_executed_paths_keep_limits_and_stay_on_the_path(pr2: Arm, bench: Bench, motion: Motion):
    assert set(motion.results["failure"]) == {""}
    assert motion.results["error_mean_m"].mean() < 1e-3 and motion.results["error_max_m"].max() < ERROR_M
    assert (motion.q >= pr2.model.lowerPositionLimit).all() and (motion.q <= pr2.model.upperPositionLimit).all()
    np.testing.assert_allclose(motion.grip[:, 0, :2], np.tile(bench.side_m * P_INIT, (8, 1)), atol=2e-3)
    np.testing.assert_allclose(motion.grip[:, -1, :2], np.tile(bench.side_m * P_F, (8, 1)), atol=2e-3)
    np.testing.assert_allclose(motion.grip[..., 2], bench.grip_m, atol=2e-3)
    collisions = Collisions(pr2, bench, bench.side_m * TALLEST_M)
    assert not any(collisions.at(q) for q in motion.q[:, ::9].reshape(-1, 7))


def test_a_movement_that_is_too_fast_fails_by_joint_speed(pr2: Arm, bench: Bench, postures: PostureMap, motion: Motion):
    fast = execute(pr2, bench, postures, Z_THETA, 64, 3.5, ERROR_M, TILT_RAD).results
    assert set(fast["failure"]) == {"joint speed"}
    np.testing.assert_allclose(fast["speed_share"], 10 * motion.results["speed_share"])


def test_what_is_in_the_arm_s_way_collides(pr2: Arm, bench: Bench):
    assert COLLISION in posture_map(pr2, bench, 5, 0.4).status, "items as tall as the arm"
    assert not Collisions(pr2, bench, 0.0).at(pr2.posture)
    assert Collisions(pr2, replace(bench, base_y=0.2), 0.0).at(pr2.posture), "the robot stands in the table"


def test_a_movement_stays_on_its_path_with_the_speed_profile_of_minimum_jerk():
    straight, tau = (P_INIT + P_F)[None] / 2, np.linspace(0, 1, 101)
    passed = np.linalg.norm(minimum_jerk(straight, 101)[0] - P_INIT, axis=-1) / lengths(straight)
    np.testing.assert_allclose(passed, 10 * tau**3 - 15 * tau**4 + 6 * tau**5, atol=1e-6)
    for points, path in zip(minimum_jerk(Z_THETA, 40), curve(Z_THETA, 4001), strict=True):
        assert np.linalg.norm(points[:, None] - path, axis=-1).min(1).max() < 1e-3
        np.testing.assert_allclose(points[[0, -1]], [P_INIT, P_F], atol=1e-12)


def test_a_bag_has_the_movements_from_rest_to_rest_and_the_same_bytes_each_time(tmp_path: Path, pr2: Arm):
    q = np.cumsum(np.random.default_rng(0).normal(size=(21, 7)), axis=0)
    moves = {"scene0_start0": (q, 2.0), "scene0_start1": (q[:5], 1.0)}
    for name in ("first", "second"):
        write_bag(tmp_path / name / "bag", pr2, moves)
    first, second = (sorted((tmp_path / name).rglob("*.*")) for name in ("first", "second"))
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    with Reader(tmp_path / "first" / "bag") as bag:
        for (name, (joints, duration_s)), (connection, _, raw) in zip(moves.items(), bag.messages(), strict=True):
            message: Any = TYPES.deserialize_cdr(raw, KIND)
            assert connection.topic == f"/{name}" and message.joint_names[0] == "r_shoulder_pan_joint"
            np.testing.assert_array_equal([point.positions for point in message.points], joints)
            speeds = np.array([point.velocities for point in message.points])
            step = duration_s / (len(joints) - 1)
            np.testing.assert_allclose(speeds[1:-1], (joints[2:] - joints[:-2]) / (2 * step))
            assert (speeds[[0, -1]] == 0).all()
            at = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
            np.testing.assert_allclose(at, np.linspace(0, duration_s, len(joints)), atol=1e-9)
