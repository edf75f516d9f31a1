"""Measure the processor time and memory of importing bags of .1 and 1.1 GB."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.factories import RED, WHITE, draw_table
from tests.own.importing import bags
from tests.own.importing.test_import import hand

DEMOS, POSES_HZ = 60, 200
PICTURES = {"1_gb": 380, "100_mb": 38}
CODE = """
import sys
from pipeline.own.__main__ import main
main(["import", *sys.argv[1:]])
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))  # kB
"""


@pytest.mark.benchmark(group="import")
@pytest.mark.parametrize("size", PICTURES)
@pytest.mark.parametrize("storage", bags.STORAGES, ids=lambda storage: storage.name.lower())
def test_a_large_bag(benchmark, tmp_path: Path, storage, size: str):
    """Measure seconds and peak memory of the command, in a process of its own."""
    log, table = tmp_path / "log", draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE))
    noise = np.random.default_rng(0).integers(0, 8, (800, 1200, 3), np.uint8)  # a camera's; PNG is slower for it
    pixels = np.minimum(cv2.resize(table, (1200, 800)), 247) + noise
    t, x, y = np.transpose(hand(DEMOS))
    times = np.arange(0, t[-1], 1 / POSES_HZ)
    times = times[np.diff(t)[np.searchsorted(t, times, "right") - 1] < 1]  # the hand is carried back unseen
    poses = zip(times, np.interp(times, t, x), np.interp(times, t, y), strict=True)
    entries = [(moment, "/hand", bags.posed(moment, *place)) for moment, *place in poses]
    picture = bags.image(0, pixels, "rgb8")
    count = PICTURES[size]
    bags.write(log, [*entries, *((i * t[-1] / count, "/camera", picture) for i in range(count))], storage)
    before = os.times()
    command = [sys.executable, "-c", CODE, str(log), str(tmp_path / "folder")]
    done = benchmark.pedantic(lambda: subprocess.check_output(command, text=True), rounds=1)
    importing = sum(os.times()[2:4]) - sum(before[2:4])  # processor time: other work shares the machine
    assert len(list((tmp_path / "folder" / "scenes").iterdir())) == DEMOS
    name = f"{storage.name.lower()}_{size}"
    benchmark.extra_info["results"] = {
        f"import_processor_s_{name}": importing,
        f"import_gib_{name}": int(done.split()[-1]) / 2**20,
    }
