"""Demonstrations and queries come back as they were; the first n of each scene are nested."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.demos import DEMO_COLUMNS, demo_arrays, read_demos, write_demos
from pipeline.runtime.errors import InputError


def some_demos(scenes: int = 3, demos: int = 4) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    keys = [(0, user, s, d) for user in ("careful", "normal") for s in range(scenes) for d in range(demos)]
    table = pd.DataFrame(keys, columns=["seed", "user", "scene", "demo"])
    return table.assign(
        z_x=rng.uniform(size=len(keys)), z_y=rng.uniform(size=len(keys)), valid=rng.random(len(keys)) > 0.5,
        residual_m=0.001, poor_fit=False, duration_s=4.0, samples=5,
    )[DEMO_COLUMNS]  # fmt: skip


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
