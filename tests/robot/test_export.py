"""Joint trajectories are the same in JSON and in a ROS 2 bag."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.robot.export import KIND, read_bag, trajectory, write_bag


def test_a_bag_is_read_back_as_it_was_written(tmp_path: Path):
    q = np.cumsum(np.random.default_rng(0).normal(size=(20, 3)), axis=0)
    moves = {"scene0_start0": trajectory(["a", "b", "c"], q, 2.0), "scene0_start1": trajectory(["a"], q[:, :1], 3.0)}
    write_bag(tmp_path / "bag", moves, "base_link")
    read = read_bag(tmp_path / "bag")
    assert list(read) == list(moves) and "JointTrajectory" in KIND
    for name, move in moves.items():
        assert read[name]["joint_names"] == move["joint_names"]
        for point, expected in zip(read[name]["points"], move["points"], strict=True):
            assert point["positions"] == expected["positions"] and point["velocities"] == expected["velocities"]
            assert point["time_from_start"] == pytest.approx(expected["time_from_start"], abs=1e-9)


def test_a_bag_has_the_same_bytes_each_time(tmp_path: Path):
    moves = {"one": trajectory(["a"], np.arange(5.0)[:, None], 1.0)}
    for name in ("first", "second"):
        write_bag(tmp_path / name / "bag", moves, "base_link")
    first, second = (sorted((tmp_path / name).rglob("*.*")) for name in ("first", "second"))
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_a_movement_starts_and_ends_at_rest():
    move = trajectory(["a"], np.arange(5.0)[:, None], 1.0)
    assert [point["velocities"] for point in move["points"]][::4] == [[0.0], [0.0]]
    assert [point["time_from_start"] for point in move["points"]] == [0.0, 0.25, 0.5, 0.75, 1.0]
