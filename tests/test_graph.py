"""dvc.yaml lists what each stage imports, stays short, and each study is a folder that can be deleted."""

import ast
import os
import shutil
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import grimp
import pytest
import yaml
from pipeline.config.graph import ROOT, graph_files, listed_variants, with_variants

DOORS = ("pipeline.config", "pipeline.params", "pipeline.launch")  # check parameters: deps of stage params alone
FRONT_DOOR = "pipeline"  # its __init__ offers the library's functions; no stage calls them
PAPER = {"full": "train", "ae": "train", "classifier": "train", "irl_maxent": "irl", "irl_ranked": "irl"}
PAPER |= {"clearance": "clearance"}
STUDIES = sorted(path.parent.name for path in ROOT.glob("studies/*/__init__.py"))


def modules_of(stages: dict) -> dict[str, list[str]]:
    """stage -> the modules that its command runs; a study's page imports those that draw its figures and tables."""
    modules = {}
    for name, stage in stages.items():
        module, study = stage["cmd"].split("python -m ")[1].split()[:2]
        drawing = [f"studies.{study}.{part}" for part in ("figures", "tables")] if name.endswith("/page") else []
        modules[name] = [part for part in (module, *drawing) if file_of(part).is_file()]
    return modules


def closure_of(modules: list[str], imports: grimp.ImportGraph) -> set[str]:
    """The modules, all that they import, and the packages in which these lie."""
    found = {*modules, *(name for module in modules for name in imports.find_upstream_modules(module))}
    return found | {name.rsplit(".", level)[0] for name in found for level in range(1, name.count(".") + 1)}


def file_of(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    return path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"


def holds_code(module: str) -> bool:
    """Whether the module is more than a docstring."""
    return any(not isinstance(node, ast.Expr) for node in ast.parse(file_of(module).read_text()).body)


@pytest.fixture(scope="module")
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", "studies", "making", cache_dir=None)


@pytest.fixture(scope="module")
def behind_the_door(imports: grimp.ImportGraph) -> grimp.ImportGraph:
    """The imports without the modules that check parameters and pass them on."""
    graph = deepcopy(imports)
    for name in sorted(name for name in graph.modules if name.startswith(DOORS)):
        graph.remove_module(name)
    return graph


@pytest.fixture(scope="module")
def all_stages() -> dict[str, dict]:
    """folder/stage -> its entry; the paper's stages have no folder."""
    return {
        str(path.parent.relative_to(ROOT) / name): stage
        for path in graph_files()
        for name, stage in yaml.safe_load(path.read_text())["stages"].items()
    }


def test_each_stage_lists_every_package_it_imports(
    imports: grimp.ImportGraph, behind_the_door: grimp.ImportGraph, all_stages: dict[str, dict]
):
    missing = []
    for stage, modules in modules_of(all_stages).items():
        closure = closure_of(modules, imports if stage == "params" else behind_the_door)
        listed = [ROOT / dep for dep in all_stages[stage]["deps"]]
        for name in sorted(name for name in closure if name != FRONT_DOOR and holds_code(name)):
            if not any(file_of(name).is_relative_to(path) for path in listed):
                missing.append(f"{stage} imports {name}")
    assert not missing, "not among the deps:\n" + "\n".join(missing)


def test_each_stage_lists_no_package_in_vain(imports: grimp.ImportGraph, all_stages: dict[str, dict]):
    for stage, modules in modules_of(all_stages).items():
        files = [file_of(name) for name in closure_of(modules, imports)]
        for dep in all_stages[stage]["deps"]:
            if dep.startswith(("pipeline/", "studies/", "making/")) and not dep.endswith((".j2", ".csv")):
                assert any(file.is_relative_to(ROOT / dep) for file in files), f"{stage} does not import {dep}"
            assert not dep.endswith(".j2") or (ROOT / dep).is_file(), f"{stage} lists {dep}, which is not there"


def test_the_paper_s_graph_is_short_and_lists_the_data_that_stages_hand_on_file_by_file(all_stages: dict[str, dict]):
    """A directory over several stages' outputs is restored in part by `dvc pull`."""
    assert len((ROOT / "dvc.yaml").read_text().splitlines()) <= 300
    outs = {next(iter(out)) if isinstance(out, dict) else out for s in all_stages.values() for out in s.get("outs", [])}
    data = {dep for stage in all_stages.values() for dep in stage["deps"] if dep.startswith("outputs/")}
    assert [dep for dep in data if any(str(out).startswith(f"{dep}/") for out in outs)] == []


def test_metrics_are_headlines_and_nothing_else_stays_out_of_the_cache(all_stages: dict[str, dict]):
    """A plain output outside the cache makes a fresh clone run its stage again, unless all the stage's outputs are."""
    for name, stage in all_stages.items():
        given = [next(iter(out.items())) for out in stage.get("outs", []) if isinstance(out, dict)]
        uncached = [path for path, settings in given if not settings["cache"]]
        assert len(uncached) in (0, len(stage.get("outs", []))), f"{name}: {uncached}"


def test_a_study_has_its_own_graph_settings_and_parameters():
    for study in STUDIES:
        folder = ROOT / "studies" / study
        assert (folder / "settings.py").is_file() and (ROOT / "conf" / "studies" / f"{study}.yaml").is_file()
        stages = list(yaml.safe_load((folder / "dvc.yaml").read_text())["stages"])
        assert (stages[0], stages[-1]) == (study, "page")


def test_a_deleted_study_is_gone_without_a_trace(tmp_path: Path):
    study = STUDIES[0]
    for name in ("pipeline", "studies", "conf"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    shutil.rmtree(tmp_path / "studies" / study)
    (tmp_path / "conf" / "studies" / f"{study}.yaml").unlink()
    command = [sys.executable, "-m", "pipeline.params", "profile=smoke"]
    there = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=there, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert study not in yaml.safe_load((tmp_path / "params.yaml").read_text()).get("studies", {})


@pytest.mark.parametrize(
    "variants", [{"full": "train", "clearance": "clearance"}, PAPER | {"wide": "clearance"}, {"ae": "train"}]
)
def test_the_graph_lists_the_variants_there_are_and_returns_to_the_paper_s(variants: dict[str, str]):
    text = (ROOT / "dvc.yaml").read_text()
    assert listed_variants() == set(PAPER)
    changed = with_variants(text, variants, set(PAPER))
    stages = yaml.safe_load(changed)["stages"]
    assert {v for s in ("train", "irl", "clearance") for v in stages[s]["matrix"]["variant"]} == set(variants)
    weights = {dep for dep in stages["repair"]["deps"] if dep.endswith("/weights")}
    assert weights == {f"outputs/{stage}/{variant}/weights" for variant, stage in variants.items()}
    assert with_variants(changed, PAPER, set(variants)) == text


def test_a_row_of_some_variants_was_chosen_by_hand_and_stays():
    text = "    deps:\n    - outputs/train/full/weights\n    - outputs/clearance/clearance/weights\n    - data\n"
    assert with_variants(text, {"full": "train"}, set(PAPER)) == text
    both = with_variants(text, {"full": "train"}, {"full", "clearance"})
    assert both == "    deps:\n    - outputs/train/full/weights\n    - data\n"
