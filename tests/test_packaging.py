"""`pip install .` gets every module, what modules read beside themselves, and the packages that they import."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import grimp
import pytest

from pipeline.runtime.places import ROOT


@pytest.mark.slow
def test_the_wheel_holds_every_module_and_template(tmp_path: Path):
    shutil.copytree(ROOT / "pipeline", tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    build = "import setuptools.build_meta as backend; backend.build_wheel('.')"
    done = subprocess.run([sys.executable, "-c", build], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    (wheel,) = tmp_path.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info" not in name}
    wanted = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "pipeline").rglob("*")
        if path.suffix in (".py", ".j2", ".css") and path.parent.name != "__pycache__"
    }
    assert wanted <= held, wanted - held
    assert {name.partition("/")[0] for name in held} == {"pipeline"}


@pytest.fixture(scope="module")
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", include_external_packages=True, cache_dir=None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "extras", "besides"),
    [
        ("pipeline.library", [], {"numba", "llvmlite"}),  # for the paper's variants alone
        ("pipeline.own.recorder.serve", ["own"], set()),
        ("pipeline.own.importing.run", ["own", "import"], set()),
        ("pipeline.sweep.__main__", ["own", "pipeline"], {"configobj"}),  # of dvc
    ],
)
def test_what_a_module_imports_is_installed_with_its_extra(
    imports: grimp.ImportGraph, module: str, extras: list[str], besides: set[str]
):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    listed = project["dependencies"] + [line for extra in extras for line in project["optional-dependencies"][extra]]
    installed = besides | {re.split(r"[^\w-]", line)[0] for line in listed}
    distributions = packages_distributions()
    packages = imports.find_upstream_modules(module) - imports.find_descendants("pipeline") - {"pipeline"}
    needed = {distributions[name][0].lower() for name in packages - sys.stdlib_module_names}
    assert needed <= installed, needed - installed


def test_locks_name_versions_that_every_index_has():
    lines = [line for path in ROOT.glob("requirements*.lock") for line in path.read_text().splitlines()]
    assert len(lines) > 200 and [line for line in lines if "+" in line] == []
