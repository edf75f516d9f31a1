"""Measure minutes and memory of the README's commands in a fresh clone of the last commit.

python -m bench.repro OUT.json                    all of them, one after the other, in a temporary clone
python -m bench.repro OUT.json FOLDER demo test   these, in a clone that is kept; FOLDER is made if it is missing

Each result is added to OUT.json with the commit that was measured. A clone's first command makes the environment.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from pipeline.git import environment, git

ROOT = Path(__file__).resolve().parent.parent
RUNNING = re.compile(r"Running stage '(?:[^':]+:)?([^']+)'")
GIB = 2**30  # bytes
COMMANDS = {
    "environment": "make venv",
    "demo": "make demo",
    "repro": "make repro",
    "studies": "make studies",
    "test": "make test",
    "quick_tests": ".venv/bin/python -m pytest -n 2 -m 'not slow'",
}


def measure(out: Path, clone: Path, names: Sequence[str]) -> None:
    """Run the commands in the clone and add their results to `out`, each as soon as it has ended."""
    if not clone.exists():
        git(ROOT, "clone", "--quiet", str(ROOT), str(clone.resolve()))
    if not (clone / ".venv" / ".ready").exists():
        names = ["environment", *(name for name in names if name != "environment")]
    commit = git(clone, "describe", "--always", "--dirty").strip()
    for name in names:
        results = json.loads(out.read_text(encoding="utf-8")) if out.is_file() else {}
        results[name] = run(clone, COMMANDS[name]) | {"commit": commit}
        out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


def run(clone: Path, command: str) -> dict:
    """Run a command; return its minutes, those of its stages, and the peak memory of its processes [GiB]."""
    start = time.perf_counter()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "encoding": "utf-8"}
    process = subprocess.Popen(shlex.split(command), cwd=clone, env=environment(), **pipes)
    peak = [0.0]
    threading.Thread(target=_watch, args=(psutil.Process(process.pid), peak), daemon=True).start()
    starts: list[tuple[str, float]] = []
    assert process.stdout is not None
    for line in process.stdout:
        print(line, end="", flush=True)
        if match := RUNNING.search(line):
            starts.append((match[1], time.perf_counter()))
    end = time.perf_counter()
    if process.wait():
        raise SystemExit(f"error: {command} ended with {process.returncode} in {clone}; its output is above")
    ends = [*(time for _, time in starts), end][1:]
    stages = {stage: (after - before) / 60 for (stage, before), after in zip(starts, ends, strict=True)}
    return {"minutes": (end - start) / 60, "stages": stages, "peak_gib": peak[0] / GIB}


def _watch(root: psutil.Process, peak: list[float]) -> None:
    """Record in peak[0] the largest sum of proportional set sizes [bytes] of a process and its descendants."""
    while root.is_running():
        time.sleep(1)
        try:
            total = sum(process.memory_full_info().pss for process in [root, *root.children(recursive=True)])
        except psutil.Error:
            continue  # one has ended in the meantime
        peak[0] = max(peak[0], total)


if __name__ == "__main__":
    out, *rest = sys.argv[1:] or ["--help"]
    if out.startswith("-") or not set(rest[1:]) <= set(COMMANDS) or len(rest) == 1:
        sys.exit(f"{__doc__}\nCommands: {', '.join(COMMANDS)}")
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(out), Path(rest[0]) if rest else Path(folder) / "clone", rest[1:] or list(COMMANDS))
