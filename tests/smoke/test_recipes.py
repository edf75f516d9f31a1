"""CONTRIBUTING.md's recipes, followed to the letter in copies of the repository, lead to the report's pages."""

import json
import os
import shutil
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pipeline.artifacts.files import read_table
from pipeline.git import dvc, git, run
from pipeline.runtime.places import ROOT
from tests.smoke.reproduce import reproduce
from tests.sweep.running import clone_of_working_tree

TINY = [
    "profile=smoke", "n_demos=[2]", "main_n_demos=2", "readings.n_demos=[1,2]", "checkpoints=[0]", "scenes.per_seed=6",
    "scenes.shared=12",
    "scenes.validation=2", "scenes.calibration=40", "scenes.calibration_paths=20", "scenes.prior_side=6",
    "demos.per_scene=2", "demos.queries_seen=4", "demos.queries_new=4", "train.steps=4", "train.engine=reference",
    "clearance.steps=4", "irl.n_augmentations=1", "irl.steps.ranked=2",
    "repair.starts=1", "repair.steps=4", "repair.lattice_side=12",
    "intervene.paths=4", "intervene.more_scenes=24",
    "record.map_side=6", "record.scenes=1", "record.training_scenes=1", "report.map_side=8",
]  # fmt: skip
MEMBERS = 4  # of the added variant


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A copy of what the paper's graph needs."""
    for name in ("pipeline", "studies", "making", "conf", "data", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("dvc.yaml", "data.dvc", "params.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def paper(repository: Path, *overrides: str) -> None:
    """Run the paper's graph on these parameters, and check that dvc.yaml lists what was read and written."""
    reproduce(repository, ["dvc.yaml"], *TINY, *overrides)
    graph = yaml.safe_load((repository / "params.yaml").read_text())["graph"]
    for name, stage in yaml.safe_load((repository / "dvc.yaml").read_text())["stages"].items():
        for variant in graph[name] if "matrix" in stage else [""]:
            for listed in [*stage["deps"], *stage["outs"], *stage.get("metrics", [])]:
                path = listed if isinstance(listed, str) else next(iter(listed))
                assert (repository / path.replace("${item.variant}", variant)).exists(), f"{name}: {path}"


def insert(path: Path, before: str, *lines: str) -> None:
    """Put lines in front of the first one that starts with `before`."""
    head, mark, tail = path.read_text().partition(before)
    assert mark, f"{path.name} has no {before!r}"
    path.write_text("".join([head, *(f"{line}\n" for line in lines), mark, tail]))


def add_a_variant(repository: Path) -> None:
    text = (repository / "conf/variants/clearance.yaml").read_text().replace("members: 8", f"members: {MEMBERS}")
    (repository / "conf/variants/few.yaml").write_text(text)


def add_a_user(repository: Path) -> None:
    tidy = "bowl: null\nplate: 0.05\ncutlery: 0.03\nglass: null\n"
    (repository / "conf/users/tidy.yaml").write_text(tidy)
    insert(repository / "conf/config.yaml", "  - scenes", "  - users@users.tidy: tidy")
    evaluate = repository / "conf/evaluate.yaml"
    evaluate.write_text(evaluate.read_text().replace("users: [careful, normal]", "users: [careful, normal, tidy]"))


def add_a_symbol(repository: Path) -> None:
    """Mugs: as large as bowls, their cut-outs those of bowls under other names; careful users keep away from them."""
    with (repository / "pipeline/world/symbols.yaml").open("a") as symbols:
        symbols.write("mug: {height_m: 0.02}\n")
    items = pd.read_csv(repository / "data/items.csv")
    mugs = items[items["symbol"] == "bowl"].assign(
        symbol="mug",
        name=lambda bowls: "mug-" + bowls["name"],
        file=lambda bowls: "items/mug-" + bowls["name"] + ".png",
    )
    for bowl, mug in zip(items.loc[mugs.index, "file"], mugs["file"], strict=True):
        shutil.copy(repository / "data" / bowl, repository / "data" / mug)
    pd.concat([items, mugs]).to_csv(repository / "data/items.csv", index=False)
    for user in (repository / "conf/users").glob("*.yaml"):
        margin = 0.045 if user.stem == "careful" else "null"
        user.write_text(f"{user.read_text()}mug: {margin}\n")
    (repository / "conf/questions/add_mug.yaml").write_text("kind: add\nsymbol: mug\nfamily: paper\n")
    insert(
        repository / "conf/config.yaml", "  - questions@questions.another", "  - questions@questions.add_mug: add_mug"
    )


def ask_a_question(repository: Path) -> None:
    """Write the question that CONTRIBUTING.md prints."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    printed = text.partition("# conf/questions/move_plate.yaml\n")[2].partition("\n\n")[0]
    lines = [line.removeprefix("    ") for line in printed.splitlines()]
    (repository / "conf/questions/move_plate.yaml").write_text("\n".join(lines) + "\n")
    line = "  - questions@questions.move_plate: move_plate"
    assert line.strip(" -") in text
    insert(repository / "conf/config.yaml", "  - optional studies@", line)


def test_a_variant_a_user_a_symbol_and_a_question_reach_the_pages(repository: Path):
    add_a_variant(repository)
    add_a_user(repository)
    add_a_symbol(repository)
    ask_a_question(repository)
    paper(repository, "~variants.ae", "~variants.classifier", "~variants.irl_maxent")

    outputs, variants = repository / "outputs", {"full", "irl_ranked", "clearance", "few"}
    p_valid = read_table(outputs / "scenes/p_valid.csv").pivot(index="added", columns="user", values="truth")
    assert p_valid.loc["mug", "careful"] < p_valid.loc["none", "careful"]
    assert p_valid.loc["mug", "normal"] == p_valid.loc["none", "normal"]
    summary = read_table(outputs / "intervene/summary.csv")
    for question, kind in (("add_mug", "add"), ("move_plate", "move")):
        rows = summary[summary["question"] == question]
        assert set(rows["kind"]) == {kind} and set(rows["variant"]) == variants
        assert set(rows["user"]) == {"careful", "normal", "aggressive", "tidy"}
    assert "another_user_tidy" in set(summary["question"])
    metrics = json.loads((repository / "reports/metrics.json").read_text())
    assert set(metrics["accuracy"]) >= variants and "tidy" in metrics["repair"]["few"]
    assert (outputs / "record/runs/few-tidy-s0.rrd").is_file()
    table = read_table(repository / "reports/tables/causes-bold.csv")
    assert "mug" in read_table(repository / "reports/tables/users-margins.csv")
    printed = table["Source"].str.startswith("The paper,")
    assert table.loc[printed, "Mug"].isna().all() and table.loc[~printed, "Mug"].notna().all()
    assert set(table.loc[~printed, "User"]) == {"careful", "normal", "aggressive", "tidy"}
    assert metrics["bold"]["few"] <= 12 and metrics["verdicts_right"] == {
        variant: int(summary.query("kind == 'add' and variant == @variant and user != 'aggressive'")["right"].sum())
        for variant in variants
    }, "README, metrics and pages count the users whose results are averaged"
    pages = {path.stem: path.read_text() for path in (repository / "reports").glob("*.html")}
    assert "mug" in pages["causes"] and "tidy" in pages["repair"] and ">few<" in pages["accuracy"]


def test_the_recipes_end_in_a_commit_that_every_hook_accepts(tmp_path: Path):
    clone = clone_of_working_tree(tmp_path / "clone")
    (clone / ".venv").symlink_to(sys.prefix)
    shutil.copytree(ROOT / "data", clone / "data", dirs_exist_ok=True)
    add_a_variant(clone)
    add_a_user(clone)
    add_a_symbol(clone)
    ask_a_question(clone)
    dvc(clone, "add", "data")
    dvc(clone, "push", "--remote", "store", "data.dvc")
    here = {"PYTHONPATH": str(clone), "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}"}
    run([sys.executable, "-m", "pipeline.params"], clone, here, check=True)
    git(clone, "add", "--all")
    hooks = run(["pre-commit", "run", "--all-files"], clone, here, capture_output=True)
    assert hooks.returncode == 0, hooks.stdout[-3000:]
    assert hooks.stdout.count("Passed") == 6, hooks.stdout
