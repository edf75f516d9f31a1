"""A change that can alter a result is never followed by "up to date": asked of DVC in a checkout of the last commit."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.audit.revision import checked_out
from pipeline.git import dvc
from pipeline.runtime.errors import InputError

pytestmark = pytest.mark.slow
UP_TO_DATE = "Data and pipelines are up to date."


@pytest.fixture(scope="module")
def clone() -> Iterator[Path]:
    with checked_out("HEAD") as folder:
        yield folder


def first_stale(clone: Path) -> str:
    """Return what `dvc repro --dry` would run first, or fails to, since no data is here."""
    try:
        said = dvc(clone, "repro", "--dry", "--allow-missing")
    except InputError as error:
        said = str(error)
    found = re.search(r"(?:Running stage|failed to reproduce) '([^']+)'", said)
    return found[1] if found else said.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [("conf/train.yaml", "  steps: 500", "  steps: 501"), ("conf/users/careful.yaml", "0.045", "0.046")],
)
def test_an_edit_of_conf_is_named_before_anything_else(clone: Path, file: str, old: str, new: str):
    assert first_stale(clone) == UP_TO_DATE
    path = clone / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    assert first_stale(clone) == "params"
    path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("place", "stages"),
    [
        ("params.py", "params"), ("launch.py", "scenes train@full report"), ("runtime", "params scenes report"),
        ("world", "scenes demos"), ("artifacts", "scenes"), ("models/vae", "train@full repair"),
        ("training/irl", "irl@irl_maxent readings"), ("perception", "irl@irl_maxent"), ("stats", "evaluate"),
        ("planning", "repair"), ("causal", "intervene"), ("viewer", "record"), ("report", "report"),
    ],
)  # fmt: skip
def test_a_change_of_a_package_makes_the_stages_that_import_it_stale(clone: Path, place: str, stages: str):
    path = clone / "pipeline" / place
    planted = path if path.is_file() else next(p for p in sorted(path.rglob("*.py")) if p.stat().st_size > 500)
    text = planted.read_text(encoding="utf-8")
    planted.write_text(f"{text}\nPLANTED = True\n", encoding="utf-8")
    found = json.loads(dvc(clone, "status", "--json", *stages.split()))
    planted.write_text(text, encoding="utf-8")
    for stage in stages.split():
        deps = {
            name: how for x in found[stage] if isinstance(x, dict) for name, how in x.get("changed deps", {}).items()
        }
        assert any(how == "modified" and planted.is_relative_to(clone / name) for name, how in deps.items()), stage
