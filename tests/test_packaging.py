"""`pip install .` gets every module and what modules read beside themselves."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

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
