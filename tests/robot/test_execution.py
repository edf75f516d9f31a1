"""Executed paths keep the joints' limits and the grip's height, and failures have the right name."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.robot.arm import Arm
from pipeline.robot.bench import Bench
from pipeline.robot.collision import Collisions
from pipeline.robot.execution import Tolerances, deviation, execute
from pipeline.robot.inverse import COLLISION, PostureMap, posture_map
from pipeline.robot.motion import minimum_jerk
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from tests.robot.conftest import TALLEST_M

ALLOWED = Tolerances(0.002, 0.02)
Z_THETA = random_z_theta(np.random.default_rng(1), 8)


def test_a_bench_is_turned_into_the_robot_s_frame_and_back(bench: Bench):
    points = np.random.default_rng(0).random((5, 2))
    place = bench.to_table(bench.to_base(points))
    np.testing.assert_allclose(place[:, :2], bench.side_m * points)
    np.testing.assert_allclose(place[:, 2], bench.grip_m)
    ahead = bench.to_base(np.array([0.5, 0.5]))
    assert ahead[0] > 0 and ahead[2] == pytest.approx(0.855), "the table lies before the robot"


def test_executed_paths_keep_limits_and_stay_on_the_path(pr2: Arm, bench: Bench, postures: PostureMap):
    motion = execute(pr2, bench, postures, Z_THETA, 64, 0.35, ALLOWED)
    assert set(motion.results["failure"]) == {""}
    assert motion.results["error_mean_m"].mean() < 1e-3 and motion.results["error_max_m"].max() < ALLOWED.error_m
    assert (motion.q >= pr2.model.lowerPositionLimit).all() and (motion.q <= pr2.model.upperPositionLimit).all()
    np.testing.assert_allclose(motion.grip[:, 0, :2], np.tile(bench.side_m * P_INIT, (8, 1)), atol=2e-3)
    np.testing.assert_allclose(motion.grip[:, -1, :2], np.tile(bench.side_m * P_F, (8, 1)), atol=2e-3)
    np.testing.assert_allclose(motion.grip[..., 2], bench.grip_m, atol=2e-3)
    collisions = Collisions(pr2, bench, bench.side_m * TALLEST_M)
    assert not any(collisions.at(q) for q in motion.q[:, ::9].reshape(-1, 7))


def test_what_a_coarse_map_would_miss_is_polished_until_it_tracks(pr2: Arm, bench: Bench):
    coarse = posture_map(pr2, bench, 7, bench.side_m * TALLEST_M)
    interpolated = deviation(pr2, coarse.postures(minimum_jerk(Z_THETA, 64)), bench.to_base(minimum_jerk(Z_THETA, 64)))
    assert interpolated[2].max() > ALLOWED.error_m
    motion = execute(pr2, bench, coarse, Z_THETA, 64, 0.35, ALLOWED)
    assert set(motion.results["failure"]) == {""} and motion.results["error_max_m"].max() < ALLOWED.error_m


def test_a_movement_that_is_too_fast_fails_by_joint_speed(pr2: Arm, bench: Bench, postures: PostureMap):
    fast = execute(pr2, bench, postures, Z_THETA, 64, 3.5, ALLOWED).results
    assert set(fast["failure"]) == {"joint speed"}
    slow = execute(pr2, bench, postures, Z_THETA, 64, 0.35, ALLOWED).results
    np.testing.assert_allclose(fast["speed_share"], 10 * slow["speed_share"])


def test_a_table_too_large_or_too_far_fails_by_reach(pr2: Arm, bench: Bench):
    far = replace(bench, side_m=1.0, base_y=-1.0)
    result = execute(pr2, far, posture_map(pr2, far, 7, TALLEST_M), Z_THETA, 16, 0.35, ALLOWED).results
    assert "out of reach" in set(result["failure"])
    assert set(result["failure"]) <= {"out of reach", "joint limit", "collision", "off the table"}


def test_a_path_across_the_table_s_edge_fails_by_name(pr2: Arm, bench: Bench, postures: PostureMap):
    beyond = execute(pr2, bench, postures, np.array([[1.4, 1.4]]), 64, 0.35, ALLOWED).results
    assert beyond["failure"].tolist() == ["off the table"]


def test_items_as_tall_as_the_arm_are_in_its_way(pr2: Arm, bench: Bench):
    assert COLLISION in posture_map(pr2, bench, 5, 0.4).status


def test_a_robot_that_stands_in_the_table_collides(pr2: Arm, bench: Bench):
    assert not Collisions(pr2, bench, 0.0).at(pr2.posture)
    assert Collisions(pr2, replace(bench, base_y=0.2), 0.0).at(pr2.posture)
