"""Git keeps the overview and the worst run of some variants, and no new bytes of the same contents."""

from pathlib import Path

import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.stages.selection import main
from pipeline.viewer.digest import digest
from pipeline.viewer.run import write_overview, write_run
from tests.factories import composed
from tests.stages.facts import run_as_listed
from tests.viewer.example import a_run, some_runs

pytestmark = pytest.mark.slow


@pytest.fixture
def cfg(tmp_path: Path) -> DictConfig:
    """Recordings of two runs of one variant, the second the less accurate, and of another variant."""
    others = [f"variants.{variant}.compared=false" for variant in ("irl_ranked", "clearance")]
    cfg = composed("profile=smoke", *others, f"paths.record={tmp_path}")
    names = ["full-careful-s0", "full-normal-s1", "clearance-careful-s0", "overview"]
    (tmp_path / "runs").mkdir()
    for name in names[:3]:
        write_run(tmp_path / "runs" / f"{name}.rrd", a_run(repairs=1))
    write_overview(tmp_path / "runs" / "overview.rrd", some_runs())
    columns = {"variant": ["full", "full", "clearance", None], "accuracy": [0.8, 0.7, 0.1, None], "sha256": "0123"}
    write_table(tmp_path / "recordings.csv", pd.DataFrame({"run": names, **columns}))
    return cfg


def test_overview_and_worst_run_are_kept_and_replaced_if_their_contents_change(cfg: DictConfig, tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "full-careful-s9.rrd").touch()  # the worst one of an earlier run
    kept = run_as_listed(main, cfg, tmp_path / "kept")
    assert sorted(path.name for path in kept.iterdir()) == ["full-normal-s1.rrd", "overview.rrd", "recordings.csv"]
    assert (kept / "recordings.csv").read_bytes() == (tmp_path / "recordings.csv").read_bytes()
    kept, new = tmp_path / "kept" / "full-normal-s1.rrd", tmp_path / "runs" / "full-normal-s1.rrd"
    before = kept.read_bytes()
    write_run(new, a_run(repairs=1))
    assert new.read_bytes() != before and digest(new) == digest(kept)
    main(cfg, tmp_path / "kept")
    assert kept.read_bytes() == before
    write_run(new, a_run(repairs=2))
    main(cfg, tmp_path / "kept")
    assert kept.read_bytes() == new.read_bytes()
