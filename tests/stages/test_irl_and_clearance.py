"""Facts about stages irl and clearance: files like stage train's, constant labels, what they refuse."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.artifacts.demos import read_queries
from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import load_model
from pipeline.params import compose
from pipeline.runtime.places import ROOT
from pipeline.stages import clearance, irl
from tests.stages.facts import run_as_listed

STAGES = {"irl_maxent": irl.main, "irl_ranked": irl.main, "clearance": clearance.main}  # by variant
USERS = ("aggressive", "careful", "normal")
CPUINFO = Path("/proc/cpuinfo")
WITHOUT = {  # what pipeline.runtime.instructions leaves to the processor: numba's target and glibc's functions
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD",
}
SMALL = ["seeds=[0]", "n_demos=[1,2]", "main_n_demos=2", "irl.n_augmentations=2", "irl.curve_every=2", "workers=1"]
SMALL += ["variants.irl_maxent.steps=3", "variants.irl_ranked.steps=3", "clearance.steps=3", "clearance.curve_every=2"]


def config(small_world: Path, out: Path, *overrides: str):
    paths = [f"paths.scenes={small_world}/scenes", f"paths.demos={small_world}/demos"]
    paths += [f"paths.irl={out}", f"paths.clearance={out}"]
    return compose([*paths, *SMALL, *overrides])


@pytest.fixture(scope="module", params=STAGES)
def run(request, small_world, tmp_path_factory) -> tuple[str, Path]:
    """One run of each variant."""
    variant, out = request.param, tmp_path_factory.mktemp("fitted")
    run_as_listed(STAGES[variant], config(small_world, out, f"variant={variant}"), out / variant)
    return variant, out


def test_a_user_without_invalid_demonstrations_gets_laplaces_constant(run):
    variant, out = run
    predictions = read_table(out / variant / "predictions.parquet").query("user == 'aggressive' and n_demos == 2")
    np.testing.assert_allclose(predictions["p"], 7 / 8, rtol=1e-6)  # 3 scenes x 2 demonstrations, all valid


def test_saved_weights_give_the_predictions_that_were_written(run, small_world):
    variant, out = run
    model = load_model(config(small_world, out), variant, "careful", 0, 2)
    p = model.probability(
        read_scenes(small_world / "scenes").images["new_items"], read_queries(small_world / "demos")["new_items"].z
    )
    rows = read_table(out / variant / "predictions.parquet").query(
        "user == 'careful' and n_demos == 2 and split == 'new_items'"
    )
    np.testing.assert_allclose(rows["p"].to_numpy().reshape(p.shape), p, rtol=1e-5)


@pytest.mark.parametrize(("stage", "variants"), [("irl", "irl_maxent, irl_ranked"), ("clearance", "clearance")])
def test_a_variant_of_another_stage_is_refused_before_anything_is_written(small_world, tmp_path, stage, variants):
    with pytest.raises(ValueError, match=f"not fitted by stage {stage}: expected one of {variants}"):
        STAGES[variants.split(", ")[0]](config(small_world, tmp_path, "variant=full"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.skipif(
    not CPUINFO.is_file() or "avx512f" not in CPUINFO.read_text(), reason="needs a processor with AVX-512"
)
def test_predictions_have_the_same_bytes_with_avx512_and_without(small_world: Path, tmp_path: Path):
    given = [f"paths.scenes={small_world}/scenes", f"paths.demos={small_world}/demos", "variant=clearance"]
    given += ["seeds=[0]", "n_demos=[1,2]", "main_n_demos=2", "workers=1", "clearance.steps=3"]
    for name, environment in (("with", {}), ("without", WITHOUT)):
        command = [sys.executable, "-m", "pipeline.stages.clearance", *given, f"hydra.run.dir={tmp_path / name}"]
        subprocess.run(command, cwd=ROOT, env=os.environ | environment, check=True, capture_output=True)
    files = [path.relative_to(tmp_path / "with") for path in tmp_path.glob("with/clearance/**/*") if path.is_file()]
    assert len(files) >= 5
    assert all((tmp_path / "with" / file).read_bytes() == (tmp_path / "without" / file).read_bytes() for file in files)
