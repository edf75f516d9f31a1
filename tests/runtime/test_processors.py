"""Stages run with the same instruction sets on every processor, and models compute the same bytes.

QEMU (Debian: qemu-user) reports an AMD or an older Intel processor.
"""

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from pipeline.runtime.instructions import SETTINGS, THREADS
from pipeline.runtime.places import ROOT

PROGRAM = Path(__file__).with_name("emulated.py")
PLACES = f"{ROOT}:{sysconfig.get_path('purelib')}"  # QEMU runs the interpreter itself, which knows no environment
CLEAN = {name: value for name, value in os.environ.items() if name not in SETTINGS | THREADS} | {"PYTHONPATH": PLACES}


def digests(*emulator: str) -> list[str]:
    command = [*emulator, str(Path(sys.executable).resolve()), str(PROGRAM)]
    said = subprocess.run(command, cwd=ROOT, env=CLEAN, capture_output=True, text=True, check=True)
    return said.stdout.splitlines()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="needs qemu-x86_64, from Debian's package qemu-user")
@pytest.mark.parametrize("processor", ["EPYC-Rome", "Haswell"])
def test_models_compute_the_same_bytes_on_other_processors(processor: str):
    here = digests()
    assert len(here) == 4 and here == digests("qemu-x86_64", "-cpu", processor)


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
