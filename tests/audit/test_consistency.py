"""The audit of one commit: what it finds in this repository, and in a clone that somebody tampered with."""

import hashlib
import json
import re
import subprocess
from pathlib import Path

import pytest

from pipeline.audit import consistency
from pipeline.audit.__main__ import main
from pipeline.git import checked_out
from pipeline.runtime.errors import InputError


@pytest.mark.slow
def test_what_was_changed_added_or_removed_is_found():
    with checked_out("HEAD") as clone:
        table = clone / "reports/tables/repair.csv"
        table.write_text(table.read_text().replace("gradient", "descent", 1))
        for name in ("stray.csv", "reviewed.csv"):  # the second by `make reviewed`
            (clone / "reports" / name).write_text("a\n1\n")
        subprocess.run(["git", "add", "reports/stray.csv", "reports/reviewed.csv"], cwd=clone, check=True)
        for removed in ("reports/limits.html", "pipeline/stages/evaluate.py"):
            (clone / removed).unlink()
        pictures = clone / "rendered/pictures.dvc"
        pictures.write_text(re.sub(r"md5: \w{8}", "md5: 00000000", pictures.read_text()))
        page = clone / "README.md"
        page.write_text(page.read_text().replace("<!-- headlines -->", ""))
        params = clone / "params.yaml"
        params.write_text(params.read_text().replace("rate_hz: 50", "rate_hz: 60"))
        checks = {check.check: check.faults for check in consistency.audit(clone)}
    outputs = {fault.message for fault in checks["outputs"]}
    stale = {fault.place: fault.message for fault in checks["stages"]}
    assert [fault.place for fault in checks["outputs"] if fault.message == "no stage writes it"] == [
        "reports/stray.csv"
    ]
    assert {"reports/tables is modified", "reports/limits.html is deleted"} <= {
        part for message in outputs for part in message.split("; ")
    }
    assert "demos in params.yaml" in stale["demos"] and "stages/evaluate.py is deleted" in stale["evaluate"]
    assert "its lock was made from another rendered/pictures" in {fault.message for fault in checks["stages"]}
    assert len(checks["README"]) == 1
    (fault,) = checks["parameters"]
    assert fault.place == "conf/" and "params.yaml is not what conf/ composes: run" in fault.message


def test_a_page_s_file_is_compared_with_the_lock_or_with_a_folder_s_list_and_unchecked_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(consistency, "dvc", lambda *_: f"{tmp_path / 'cache'}\n")
    (tmp_path / "studies/safety").mkdir(parents=True)
    source = {"files": [{"stage": "safety", "file": "curve.csv", "md5": "aa"}]}
    (tmp_path / "studies/safety/provenance.json").write_text(json.dumps({"sources": source}))
    locks = {"studies/safety/dvc.yaml:safety": {"outs": [{"path": "outputs/studies/safety", "md5": "12.dir"}]}}
    checked = consistency.provenance(tmp_path, locks)
    assert (checked.items, checked.faults, checked.unchecked) == (0, [], 1)
    (tmp_path / "cache/files/md5/12").mkdir(parents=True)
    for md5, faults in (("aa", 0), ("bb", 1)):
        (tmp_path / "cache/files/md5/12/.dir").write_text(json.dumps([{"relpath": "curve.csv", "md5": md5}]))
        checked = consistency.provenance(tmp_path, locks)
        assert (checked.items, len(checked.faults), checked.unchecked) == (1, faults, 0)
    for md5, faults in (("aa", 0), ("bb", 1)):
        locks = {"studies/safety/dvc.yaml:safety": {"outs": [{"path": "outputs/studies/safety/curve.csv", "md5": md5}]}}
        assert len(consistency.provenance(tmp_path, locks).faults) == faults


def test_a_folder_that_a_stage_read_is_compared_file_by_file_or_by_sizes_without_their_list(tmp_path: Path):
    outs = [
        {"path": "outputs/train/full", "md5": "12.dir", "size": 5, "nfiles": 2},
        {"path": "outputs/train/note.txt", "md5": "dd", "size": 3},
    ]
    content = '[{"md5": "aa", "relpath": "full/a"}, {"md5": "bb", "relpath": "full/b/c"}, '
    content += '{"md5": "dd", "relpath": "note.txt"}]'
    read = {"path": "outputs/train", "md5": f"{hashlib.md5(content.encode()).hexdigest()}.dir", "size": 8, "nfiles": 3}
    assert consistency._holds(outs, read, tmp_path) == (True, False)
    assert consistency._holds(outs, read | {"size": 9}, tmp_path) == (False, False)
    (tmp_path / "files/md5/12").mkdir(parents=True)
    for md5 in ("bb", "cc"):
        listed = [{"md5": "aa", "relpath": "a"}, {"md5": md5, "relpath": "b/c"}]
        (tmp_path / "files/md5/12/.dir").write_text(json.dumps(listed))
        assert consistency._holds(outs, read, tmp_path) == (md5 == "bb", True)


def test_an_unknown_commit_and_one_without_results_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="is unknown: `git log --oneline`"):
        main(["nothing-of-that-name"])
    with pytest.raises(InputError, match="so no results"):
        consistency.audit(tmp_path)
