"""Measure the wall-clock minutes of the README's make targets in a temporary clone of the last commit.

python -m bench.repro OUT.json
"""

import json
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import psutil

ROOT = Path(__file__).resolve().parent.parent
RUNNING = re.compile(r"Running stage '(?:[^':]+:)?([^']+)'")
GIB = 2**30  # bytes
TARGETS = {"venv": "environment", "demo": "demo", "repro": "repro", "studies": "studies", "test": "test"}


def measure(clone: Path) -> dict:
    """Return minutes of each make target in order, minutes of each stage, and peak memory [GiB]."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    results: dict = {"stage_minutes": {}}
    for target, name in TARGETS.items():
        minutes, stages, peak = run(clone, target)
        results[f"{name}_minutes"] = minutes
        if target in ("repro", "studies"):
            results["stage_minutes"] |= stages
            results["repro_peak_gib"] = max(peak, results.get("repro_peak_gib", 0.0))
    return results


def run(clone: Path, target: str) -> tuple[float, dict[str, float], float]:
    """Run a make target; return its minutes, its stages' minutes, and the peak memory of its processes [GiB]."""
    start = time.perf_counter()
    process = subprocess.Popen(["make", target], cwd=clone, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    peak = [0.0]
    threading.Thread(target=_watch, args=(psutil.Process(process.pid), peak), daemon=True).start()
    starts: list[tuple[str, float]] = []
    assert process.stdout is not None
    for line in process.stdout:
        print(line, end="")
        if match := RUNNING.search(line):
            starts.append((match[1], time.perf_counter()))
    end = time.perf_counter()
    if process.wait():
        raise SystemExit(f"error: make {target} ended with {process.returncode} in {clone}; its output is above")
    ends = [*(at for _, at in starts[1:]), end]
    stages = {stage: (after - before) / 60 for (stage, before), after in zip(starts, ends, strict=True)}
    return (end - start) / 60, stages, peak[0] / GIB


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
    with tempfile.TemporaryDirectory() as folder:
        Path(sys.argv[1]).write_text(json.dumps(measure(Path(folder) / "clone"), indent=2) + "\n")
