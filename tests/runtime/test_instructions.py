"""Stages run with the same instruction sets on every processor."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.config.graph import ROOT
from pipeline.runtime.instructions import SETTINGS, THREADS
from tests.sweep.running import SMALL, clone_of_working_tree

CPUINFO = Path("/proc/cpuinfo")
# What SETTINGS leaves to the processor: numba's target and glibc's functions
WITHOUT = {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD",
}
CODE = """import {package}, torch
from numpy._core._multiarray_umath import __cpu_features__ as features
print(torch.backends.cpu.get_cpu_capability(), features["X86_V4"], torch.get_num_threads())"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors have other instruction sets")
@pytest.mark.parametrize("package", ["pipeline.stages", "studies"])
def test_stages_and_studies_use_avx2_and_one_thread_at_most(package: str):
    clean = {name: value for name, value in os.environ.items() if name not in SETTINGS | THREADS}
    command = [sys.executable, "-c", CODE.format(package=package)]
    said = subprocess.run(command, cwd=ROOT, env=clean, capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["AVX2", "False", "1"]


@pytest.mark.slow
@pytest.mark.skipif(
    not CPUINFO.is_file() or "avx512f" not in CPUINFO.read_text(), reason="needs a processor with AVX-512"
)
def test_predictions_have_the_same_bytes_with_avx512_and_without(tmp_path: Path):
    clone = clone_of_working_tree(tmp_path / "clone")
    with_it = os.environ | {"PYTHONPATH": str(clone)}
    stage = ["pipeline.stages.clearance", "--params", "params.yaml", "variant=clearance"]
    for command in (["dvc", "pull", "--quiet", "data.dvc"], ["pipeline.params", *SMALL], ["dvc", "repro", "clearance"]):
        subprocess.run([sys.executable, "-m", *command], cwd=clone, env=with_it, check=True, capture_output=True)
    folder = clone / "outputs/clearance/clearance"
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".gitignore"]
    before = {path: path.read_bytes() for path in files}
    for path in files:
        path.unlink()
    subprocess.run([sys.executable, "-m", *stage], cwd=clone, env=with_it | WITHOUT, check=True, capture_output=True)
    assert len(files) >= 5 and before == {path: path.read_bytes() for path in files}
