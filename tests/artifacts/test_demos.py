"""Demonstrations and queries come back as they were; the first n of each scene are nested."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.demos import (
    DEMO_COLUMNS,
    Queries,
    demo_arrays,
    read_demos,
    read_queries,
    read_trajectories,
    write_demos,
    write_queries,
)
from pipeline.runtime.errors import InputError


def some_demos(scenes: int = 3, demos: int = 4) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    keys = [(0, user, s, d) for user in ("careful", "normal") for s in range(scenes) for d in range(demos)]
    table = pd.DataFrame(keys, columns=["seed", "user", "scene", "demo"])
    return table.assign(
        z_x=rng.uniform(size=len(keys)), z_y=rng.uniform(size=len(keys)), valid=rng.random(len(keys)) > 0.5,
        residual_m=0.001, poor_fit=False, duration_s=4.0, samples=5,
    )[DEMO_COLUMNS]  # fmt: skip


def test_recordings_lie_row_for_row_beside_their_table(tmp_path: Path):
    demos = some_demos()
    offsets = np.arange(len(demos) + 1) * 5
    samples = np.random.default_rng(1).random((offsets[-1], 4)).astype(np.float32)
    write_demos(tmp_path, demos, samples, offsets)
    pd.testing.assert_frame_equal(read_demos(tmp_path), demos)
    back, read_offsets = read_trajectories(tmp_path)
    np.testing.assert_array_equal(back, samples)
    np.testing.assert_array_equal(read_offsets, offsets)
    with pytest.raises(ValueError, match="do not match"):
        write_demos(tmp_path, demos, samples[:-1], offsets)


def test_fewer_demonstrations_are_the_first_of_more():
    demos = some_demos()
    z, valid = demo_arrays(demos, 0, "normal", 4)
    fewer, fewer_valid = demo_arrays(demos, 0, "normal", 2)
    assert z.shape == (3, 4, 2) and valid.dtype == bool
    np.testing.assert_array_equal(fewer, z[:, :2])
    np.testing.assert_array_equal(fewer_valid, valid[:, :2])


def test_a_z_theta_that_is_not_finite_is_refused(tmp_path: Path):
    demos = some_demos()
    demos.loc[3, "z_x"] = np.nan
    write_demos(tmp_path, demos, np.zeros((0, 4)), np.zeros(len(demos) + 1, dtype=int))
    with pytest.raises(InputError, match="not finite"):
        read_demos(tmp_path)


@pytest.mark.parametrize(("seed", "user", "n"), [(0, "careful", 5), (1, "careful", 2), (0, "hasty", 2)])
def test_too_few_demonstrations_are_refused(seed: int, user: str, n: int):
    with pytest.raises(InputError, match=f"user {user}, seed {seed}: expected {n}"):
        demo_arrays(some_demos(), seed, user, n)


def test_queries_come_back_by_pool_and_user(tmp_path: Path):
    rng = np.random.default_rng(0)
    queries = {
        pool: Queries(rng.random((2, 3, 2)), {user: rng.random((2, 3)) > 0.5 for user in ("careful", "normal")})
        for pool in ("train-s0", "new_items")
    }
    write_queries(tmp_path, queries)
    back = read_queries(tmp_path)
    assert set(back) == set(queries)
    for pool, q in queries.items():
        np.testing.assert_array_equal(back[pool].z, q.z)
        assert set(back[pool].valid) == {"careful", "normal"}
        for user, valid in q.valid.items():
            np.testing.assert_array_equal(back[pool].valid[user], valid)
