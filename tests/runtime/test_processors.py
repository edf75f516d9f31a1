"""Stages run with the same instruction sets on every processor."""

import os
import platform
import subprocess
import sys

import pytest

from pipeline.runtime.instructions import SETTINGS, THREADS
from pipeline.runtime.places import ROOT

CLEAN = {name: value for name, value in os.environ.items() if name not in SETTINGS | THREADS}
CODE = """import {package}, torch
from numpy._core._multiarray_umath import __cpu_features__ as features
print(torch.backends.cpu.get_cpu_capability(), features["X86_V4"], torch.get_num_threads())"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors have other instruction sets")
@pytest.mark.parametrize("package", ["pipeline.stages", "studies"])
def test_stages_and_studies_use_avx2_and_one_thread_at_most(package: str):
    command = [sys.executable, "-c", CODE.format(package=package)]
    said = subprocess.run(command, cwd=ROOT, env=CLEAN, capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["AVX2", "False", "1"]
