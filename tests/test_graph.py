"""dvc.yaml lists what each stage imports, without exceptions, and names no variant; a study is a folder of its own."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import grimp
import pytest
import yaml

from pipeline.git import checked_out, dvc
from pipeline.runtime.places import ROOT
from tests.stages.facts import all_stages

STUDIES = sorted(path.parent.name for path in ROOT.glob("studies/*/stage.py"))
FRONT_DOOR = "pipeline"  # its __init__ offers the library's functions, imported on first use; no stage calls them


def modules_of(stages: dict) -> dict[str, list[str]]:
    """stage -> the modules that its command runs; a study's page imports the one that draws its figures."""
    modules = {}
    for name, stage in stages.items():
        module, study = stage["cmd"].split("python -m ")[1].split()[:2]
        drawing = [f"studies.{study}.figures"] if name.startswith("page@") else []
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
    """Whether the module is a file with more than a docstring."""
    file = file_of(module)
    return file.is_file() and any(not isinstance(node, ast.Expr) for node in ast.parse(file.read_text()).body)


@pytest.fixture(scope="module")
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", "studies", "making", cache_dir=None)


@pytest.mark.slow
def test_each_stage_lists_every_package_it_imports_and_none_in_vain(imports: grimp.ImportGraph):
    """What stands in a matrix is listed for all of its stages: one of them has to import it."""
    stages, missing, needed, listed = all_stages(), [], set(), set()
    for stage, modules in modules_of(stages).items():
        closure, deps, matrix = closure_of(modules, imports), stages[stage]["deps"], stage.partition("@")[0]
        for name in sorted(name for name in closure if name != FRONT_DOOR and holds_code(name)):
            if not any(file_of(name).is_relative_to(ROOT / dep) for dep in deps):
                missing.append(f"{stage} imports {name}")
        code = [dep for dep in deps if dep.startswith(("pipeline/", "studies/", "making/"))]
        assert all((ROOT / dep).exists() for dep in code), f"{stage} lists what is not there"
        listed |= {(matrix, dep) for dep in code if not dep.endswith((".j2", ".csv"))}
        needed |= {(matrix, dep) for dep in code if any(file_of(n).is_relative_to(ROOT / dep) for n in closure)}
    assert missing == [] and sorted(listed - needed) == []


def test_no_stage_depends_on_a_variant_by_name():
    """Else a study would not wait for a variant that is added, and would miss one that is left out."""
    folders = ("outputs/train/", "outputs/irl/", "outputs/clearance/")
    assert [name for name, stage in all_stages().items() for dep in stage["deps"] if dep.startswith(folders)] == []


def test_metrics_are_headlines_and_nothing_else_stays_out_of_the_cache():
    """A plain output outside the cache makes a fresh clone run its stage again, unless all the stage's outputs are."""
    for name, stage in all_stages().items():
        given = [next(iter(out.items())) for out in stage.get("outs", []) if isinstance(out, dict)]
        uncached = [path for path, settings in given if not settings["cache"]]
        assert len(uncached) in (0, len(stage.get("outs", []))), f"{name}: {uncached}"


@pytest.mark.slow
def test_whoever_ran_no_study_has_what_they_put_out_so_that_dvc_checkout_ends_well():
    with checked_out("HEAD") as clone:
        studies = [f"studies/{name}/dvc.yaml" for name in STUDIES]
        dvc(clone, "fetch", "--remote", "store", *studies)
        dvc(clone, "checkout", "--force", *studies)
        assert sorted(path.name for path in clone.glob("outputs/studies/*")) == STUDIES


@pytest.mark.slow
def test_a_deleted_study_is_gone_without_a_trace_and_a_variant_is_one_file_beside_any_others(tmp_path: Path):
    study, conf = STUDIES[0], {path.stem: path.read_text() for path in ROOT.glob("conf/variants/*.yaml")}
    trained = {name for name, text in conf.items() if yaml.safe_load(text).get("stage") == "train"}
    for name in ("pipeline", "studies", "conf", "making"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.rmtree(tmp_path / "studies" / study)
    (tmp_path / "conf" / "studies" / f"{study}.yaml").unlink()
    (tmp_path / "conf/variants/narrow.yaml").write_text(conf["full"].replace("alpha: 100.0", "alpha: 10.0"))
    command = [sys.executable, "-m", "pipeline.params", "profile=smoke"]
    there = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=there, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    params = yaml.safe_load((tmp_path / "params.yaml").read_text())
    assert study not in params["studies"] and study not in params["graph"]["pages"]
    assert params["graph"]["train"][-1] == "narrow" and {*params["graph"]["train"]} == {*trained, "narrow"}
    assert params["variants"]["narrow"]["alpha"] == 10
