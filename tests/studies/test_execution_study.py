"""The study executes every path once, counts failures by name, and says in a sentence what it cannot do."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_table
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT
from studies.execution.stage import main, random_starts
from tests.factories import SCENES, random_demos, untrained_models, write_table_of_demos

pytest.importorskip("pinocchio")
pytestmark = pytest.mark.slow
SMALL = {"coarse": 5, "lattice": 15, "instants": 24, "error_m": 0.01, "physics_starts": 1, "exported": 2, "chunk": 40}
SMALL |= {"side_m": [0.6], "base_x": [0.3], "base_y_m": [-0.15]}


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Three scenes, demonstrations, and repairs of every invalid start that all end on a side of the table."""
    folder = tmp_path_factory.mktemp("inputs")
    cfg = untrained_models(folder, [0, 1])
    cfg.paths.demos, cfg.paths.repair = str(folder / "demos"), str(folder / "repair")
    demos = random_demos(np.random.default_rng(0), cfg, SCENES).assign(duration_s=3.5)
    write_table_of_demos(Path(cfg.paths.demos), demos)
    starts, rows = random_starts(cfg, SCENES), []
    for method, variant in (("gradient", "full"), ("gradient", "clearance"), ("nearest", "clearance"), ("oracle", "")):
        for seed in cfg.protocol.seeds:
            for scene, start in np.ndindex(SCENES, 2):
                z = starts[scene, start]
                accepted = None if method == "oracle" else bool(start)
                row = {"method": method, "variant": variant, "user": "careful", "seed": seed, "scene": scene}
                row |= {"start": start, "z0_x": z[0], "z0_y": z[1], "z_x": 0.9, "z_y": 0.1 + 0.01 * start}
                rows.append(row | {"accepted": accepted, "valid_end": True})
    write_table(folder / "repair" / "repairs.parquet", pd.DataFrame(rows).astype({"accepted": "boolean"}))
    cfg.studies.execution.update(SMALL)
    return cfg


def test_every_path_is_executed_once_and_failures_have_a_name(cfg: DictConfig, out: Path):
    executions, summary = read_table(out / "executions.parquet"), read_table(out / "summary.csv")
    seeds, users = len(cfg.protocol.seeds), len(cfg.users)
    expected = {"gradient": 2 * seeds * SCENES * 2, "nearest": seeds * SCENES * 2, "oracle": SCENES * 2}
    expected |= {"straight": SCENES * users, "unrepaired": SCENES * users * cfg.repair.starts}
    expected |= {"demonstrations": seeds * users * SCENES * 10}
    assert executions["method"].value_counts().to_dict() == expected
    assert executions[["error_mean_m", "shaker_m", "gripper_m"]].notna().all(axis=None)
    shares = summary.loc[:, "executed":"tracking"].sum(axis=1)
    np.testing.assert_allclose(shares, 1, atol=1e-5)
    repairs = summary[summary["method"] == "repairs"].iloc[0]
    assert repairs["paths"] == 3 * seeds * SCENES * 2 and repairs["accepted"] == repairs["paths"] / 2
    assert repairs["executed"] == 1


def test_the_export_and_the_picture_have_the_whole_arm(out: Path):
    shown = read_arrays(out / "shown.npz")
    assert shown["chain"].shape == (2, SMALL["instants"], 8, 3) and (out / "bag/bag.mcap").is_file()
    ends = shown["side_m"] * np.array([P_INIT, P_F])
    np.testing.assert_allclose(shown["chain"][:, [0, -1], -1, :2], [ends, ends], atol=0.01)


def test_a_table_where_the_arm_cannot_go_is_refused(cfg: DictConfig, tmp_path: Path):
    far = cfg.copy()
    far.studies.execution.base_y_m = [-3.0]
    with pytest.raises(InputError, match=r"executes no demonstration on any table .*: move its base"):
        main(far, tmp_path)
