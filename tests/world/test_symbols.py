"""A further kind of item takes one row of code, rows of data and margins, and nothing else."""

import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.world.symbols import SYMBOLS

SMALL = [
    "profile=smoke", "scenes.per_seed=2", "scenes.shared=6", "scenes.validation=2", "scenes.calibration=40",
    "scenes.calibration_paths=20", "scenes.prior_side=4",
]  # fmt: skip


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A copy of this repository with a fifth kind, mugs as large as some bowls that careful users keep away from."""
    for name in ("pipeline", "studies", "conf", "data"):
        shutil.copytree(name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    for path in Path().glob("*.yaml"):
        shutil.copy(path, tmp_path)
    symbols = tmp_path / "pipeline/world/symbols.py"
    before, after = symbols.read_text().split(")  # layouts store")
    symbols.write_text(f'{before}    Symbol("mug", height_m=0.02),\n)  # layouts store{after}')
    items = pd.read_csv(tmp_path / "data/items.csv")
    mugs = items[items["symbol"] == "bowl"].assign(symbol="mug", name=lambda bowls: "mug-" + bowls["name"])
    pd.concat([items, mugs]).to_csv(tmp_path / "data/items.csv", index=False)
    users = yaml.safe_load((tmp_path / "conf/users.yaml").read_text())
    for user, margins in users["users"].items():
        margins["mug"] = 0.045 if user == "careful" else None
    (tmp_path / "conf/users.yaml").write_text(yaml.safe_dump(users))
    return tmp_path


def run(repository: Path, *arguments: str) -> None:
    result = subprocess.run([sys.executable, "-m", *arguments], cwd=repository, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]


@pytest.mark.slow
def test_a_fifth_kind_is_laid_out_rendered_and_judged(repository: Path):
    run(repository, "pipeline.params", *SMALL)
    run(repository, "pipeline.stages.scenes", "--params", "params.yaml")
    scenes = read_scenes(repository / "outputs/scenes")
    kinds = {int(symbol) for layouts in scenes.layouts.values() for symbol in layouts.symbol[layouts.present]}
    assert len(SYMBOLS) in kinds
    table = read_table(repository / "outputs/scenes/p_valid.csv")
    truth = table.pivot(index="added", columns="user", values="truth")
    assert truth.loc["mug", "careful"] < truth.loc["none", "careful"]
    assert truth.loc["mug", "normal"] == truth.loc["none", "normal"]


def test_the_four_kinds_of_the_paper_keep_their_order():
    assert SYMBOLS[:4] == ("bowl", "plate", "cutlery", "glass")
