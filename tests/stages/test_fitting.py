"""What stages train, irl and clearance write does not depend on processes, other seeds or the processor."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.demos import DEMO_COLUMNS, Queries, read_queries, write_demos, write_queries
from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, write_scenes
from pipeline.models.trained import load_model
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.stages import clearance, irl, train
from pipeline.world.layout import empty
from tests.factories import appearances
from tests.stages.facts import run_as_listed

pytestmark = pytest.mark.slow

STAGES = {"full": train.main, "irl_ranked": irl.main, "clearance": clearance.main}  # by variant
CPUINFO = Path("/proc/cpuinfo")
WITHOUT = {  # what pipeline.runtime.instructions leaves to the processor: numba's target and glibc's functions
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD",
}
SMALL = ["seeds=[0,1]", "n_demos=[1,2]", "main_n_demos=2", "train.steps=4", "train.curve_every=2", "workers=1"]
SMALL += ["train.engine=simd", "checkpoints=[0,2,50]", "irl.n_augmentations=2", "irl.curve_every=2"]
SMALL += ["irl.steps.ranked=3", "clearance.steps=3", "clearance.curve_every=2"]
POOLS = {"train-s0": 3, "train-s1": 3, "new_scenes": 2, "new_items": 2}


@pytest.fixture(scope="module")
def small_world(tmp_path_factory) -> Path:
    """Scenes, demonstrations and queries of two seeds for the stages that fit models: noise for images.

    Labels go by the side of the table, but aggressive accepts everything.
    """
    root, rng = tmp_path_factory.mktemp("small_world"), np.random.default_rng(0)
    images, layouts, queries, rows = {}, {}, {}, []
    for pool, scenes in POOLS.items():
        images[pool] = rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8)
        layouts[pool] = empty(scenes, 2)
        layouts[pool].symbol[:, 0] = layouts[pool].item[:, 0] = 0
        z = rng.uniform(-0.2, 1.2, (scenes, 4, 2))
        queries[pool] = Queries(z, {user: _label(z, user) for user in ("careful", "normal", "aggressive")})
    for seed in (0, 1):
        for user in ("aggressive", "careful", "normal"):
            z = np.stack(np.meshgrid([0.1, 0.9, 0.2], [0.1, 0.9]), -1).transpose(1, 0, 2) + 0.01 * seed
            valid = _label(z, user)
            for scene, demo in np.ndindex(3, 2):
                rows.append((seed, user, scene, demo, *z[scene, demo], valid[scene, demo], 0.0, False, 1.0, 3))
    write_scenes(root / "scenes", SceneSet(images, layouts, {pool: appearances(n) for pool, n in POOLS.items()}))
    demos = pd.DataFrame(rows, columns=DEMO_COLUMNS)
    write_demos(root / "demos", demos, np.zeros((3 * len(rows), 4)), np.arange(len(rows) + 1) * 3)
    write_queries(root / "demos", queries)
    return root


def _label(z: np.ndarray, user: str) -> np.ndarray:
    return (z[..., 0] < 0.5) | (user == "aggressive")


def config(small_world: Path, out: Path, *overrides: str):
    paths = [f"paths.scenes={small_world}/scenes", f"paths.demos={small_world}/demos"]
    return compose([*paths, *(f"paths.{stage}={out}" for stage in ("train", "irl", "clearance")), *SMALL, *overrides])


@pytest.fixture(scope="module")
def runs(small_world, tmp_path_factory) -> Path:
    """One run of each variant."""
    out = tmp_path_factory.mktemp("fitted")
    for variant, main in STAGES.items():
        run_as_listed(main, config(small_world, out, f"variant={variant}"), out / variant)
    return out


@pytest.mark.parametrize("variant", STAGES)
def test_saved_weights_give_the_predictions_that_were_written(runs, small_world, variant):
    cfg = config(small_world, runs)
    scenes, queries = read_scenes(small_world / "scenes"), read_queries(small_world / "demos")
    predictions = read_table(runs / variant / "predictions.parquet")
    for split, pool in (("seen_scenes", "train-s1"), ("new_items", "new_items")):
        p = load_model(cfg, variant, "careful", 1, 2).probability(scenes.images[pool], queries[pool].z)
        rows = predictions.query(f"seed == 1 and user == 'careful' and n_demos == 2 and split == '{split}'")
        np.testing.assert_allclose(rows["p"].to_numpy().reshape(p.shape), p, rtol=1e-5)
        assert np.array_equal(rows["valid"].to_numpy().reshape(p.shape), queries[pool].valid["careful"])
    constant = predictions.query("user == 'aggressive' and n_demos == 2")  # Laplace's: 3 scenes x 2 demonstrations
    np.testing.assert_allclose(constant["p"], 7 / 8, rtol=1e-6)


def test_neither_processes_nor_checkpoints_nor_other_seeds_change_a_weight(runs, small_world, tmp_path):
    given = "workers=2", "checkpoints=[]", "seed=1", "variant=full"
    train.main(config(small_world, tmp_path, *given), tmp_path / "full")
    assert list((tmp_path / "full" / "checkpoints").iterdir()) == []
    alone = _digests(tmp_path / "full" / "weights")
    assert len(alone) == 6 and alone.items() <= _digests(runs / "full" / "weights").items()


def test_a_fit_that_diverges_is_no_result(small_world, tmp_path):
    with pytest.raises(InputError, match=r"full of careful, seed 0, n_demos 2: its loss .* finite at step \d+"):
        train.main(config(small_world, tmp_path, "train.rate=1e30"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not CPUINFO.is_file() or "avx512f" not in CPUINFO.read_text(), reason="needs AVX-512")
def test_predictions_have_the_same_bytes_with_avx512_and_without(small_world: Path, tmp_path: Path):
    given = [f"paths.scenes={small_world}/scenes", f"paths.demos={small_world}/demos", "variant=clearance"]
    given += ["seeds=[0]", "n_demos=[1,2]", "main_n_demos=2", "workers=1", "clearance.steps=3"]
    for name, environment in (("with", {}), ("without", WITHOUT)):
        command = [sys.executable, "-m", "pipeline.stages.clearance", *given, f"hydra.run.dir={tmp_path / name}"]
        subprocess.run(command, cwd=ROOT, env=os.environ | environment, check=True, capture_output=True)
    with_it, without = (_digests(tmp_path / name / "clearance") for name in ("with", "without"))
    assert len(with_it) >= 5 and with_it == without


def _digests(root: Path) -> dict[str, str]:
    files = sorted(path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
