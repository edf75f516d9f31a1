"""The whole real graph runs at profile=smoke in a throwaway clone."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_the_whole_graph_runs_in_a_throwaway_clone():
    run = subprocess.run(["bash", "tests/smoke.sh"], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-4000:]
    assert "smoke run complete" in run.stdout
