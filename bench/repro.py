"""The whole graph from an empty cache, in a throwaway clone of the last commit: minutes by stage and peak memory.

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
RUNNING = re.compile(r"Running stage '([^']+)'")
GIB = 2**30


def measure(clone: Path) -> dict:
    """Reproduce `clone`: minutes by stage, in order, and the most memory its processes held together [GiB]."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    subprocess.run(["dvc", "pull", "--quiet", "data.dvc"], cwd=clone, check=True)
    process = subprocess.Popen(["dvc", "repro"], cwd=clone, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    peak = [0.0]
    watch = threading.Thread(target=_watch, args=(psutil.Process(process.pid), peak), daemon=True)
    watch.start()
    stages, starts = [], []
    assert process.stdout is not None
    for line in process.stdout:
        print(line, end="")
        if found := RUNNING.search(line):
            stages.append(found[1])
            starts.append(time.perf_counter())
    end = time.perf_counter()
    if process.wait():
        raise SystemExit(f"error: dvc repro ended with {process.returncode} in {clone}; its output is above")
    minutes = [(b - a) / 60 for a, b in zip(starts, [*starts[1:], end], strict=True)]
    return {
        "repro_minutes": (end - starts[0]) / 60,
        "repro_stage_minutes": dict(zip(stages, minutes, strict=True)),
        "repro_peak_gib": peak[0] / GIB,
    }


def _watch(root: psutil.Process, peak: list[float]) -> None:
    """Keep the largest sum of proportional set sizes [bytes] of a process and its descendants in peak[0]."""
    while root.is_running():
        time.sleep(1)
        total = 0
        try:
            for process in [root, *root.children(recursive=True)]:
                total += process.memory_full_info().pss
        except psutil.Error:
            continue  # one has ended meanwhile
        peak[0] = max(peak[0], total)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        Path(sys.argv[1]).write_text(json.dumps(measure(Path(folder) / "clone"), indent=2) + "\n")
