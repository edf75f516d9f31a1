"""The audit of a history: which commits it takes, and what its table says of them."""

import subprocess

from pipeline.audit import text
from pipeline.audit.consistency import Checked, Fault
from pipeline.audit.history import Entry, with_results
from pipeline.runtime.places import ROOT


def test_the_commits_with_results_are_those_that_changed_the_headlines_the_oldest_first():
    command = ["git", "log", "-1", "--format=%H", "HEAD", "--", "reports/metrics.json"]
    last = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    commits = with_results("HEAD")
    assert commits[-1] == last and len(set(commits)) == len(commits)


def test_a_row_names_the_faults_of_a_commit_and_the_verdicts_that_it_changed():
    clean = Checked("stages", "code and locks agree", 12, [])
    stale = Checked("stages", "code and locks agree", 12, [Fault("evaluate", "train.py is modified")])
    changed = [("repair_succeeds", "holds", "fails")]
    entries = [
        Entry("0a1b2c3d", "2026-11-25", "Results", [stale], changed),
        Entry("4e5f6a7b", "2026-11-25", "Results anew", [clean], []),
        Entry("8c9d0e1f", "2026-11-25", "Other folders", [], []),
        Entry("2a3b4c5d", "2026-11-25", "No README", [clean, Checked("README", "", 0, [])], []),
    ]
    rows = text.of_history("HEAD", entries).splitlines()[-4:]
    assert "| stages 1 | repair_succeeds: holds to fails |" in rows[0]
    assert "| none | – |" in rows[1] and "| cannot be audited |" in rows[2]
    assert "| none in 1 of 2 checks |" in rows[3]
