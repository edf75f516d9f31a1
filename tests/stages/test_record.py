"""Stage record keeps a few recordings for git, and rewrites none whose contents are the same."""

import shutil
from pathlib import Path

import pandas as pd

from pipeline.stages.record import keep
from pipeline.viewer.digest import digest
from pipeline.viewer.run import write_run
from tests.viewer.example import a_run


def test_git_keeps_the_overview_and_the_worst_runs_and_a_file_of_the_same_contents_stays(tmp_path: Path):
    runs, kept = tmp_path / "runs", tmp_path / "kept"
    runs.mkdir()
    kept.mkdir()
    for name in ("a-s0", "a-s1", "b-s0"):
        write_run(runs / f"{name}.rrd", a_run(repairs=1 if name == "a-s1" else 2))
    shutil.copyfile(runs / "b-s0.rrd", runs / "overview.rrd")
    write_run(kept / "a-s1.rrd", a_run(repairs=1))  # the same contents, other bytes
    (kept / "a-s0.rrd").touch()
    before = (kept / "a-s1.rrd").read_bytes()
    assert before != (runs / "a-s1.rrd").read_bytes()
    table = pd.DataFrame({"run": ["a-s0", "a-s1", "b-s0", "overview"], "variant": ["a", "a", "b", None]})
    table = table.assign(accuracy=[0.9, 0.8, 0.7, None], sha256=[digest(runs / f"{run}.rrd") for run in table["run"]])
    keep(table, ["a"], runs, kept)
    assert {path.name for path in kept.iterdir()} == {"a-s1.rrd", "overview.rrd"}
    assert (kept / "a-s1.rrd").read_bytes() == before
