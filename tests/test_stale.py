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
    ("file", "old", "new", "stage"),
    [
        ("conf/train.yaml", "  steps: 500", "  steps: 501", "params"),
        ("conf/users.yaml", "0.045", "0.046", "params"),
        ("pipeline/config/values.py", "MAX_N = 10", "MAX_N = 11", "params"),
        ("pipeline/causal/questions.py", "Name | None = None", 'Name | None = "paper"', "intervene"),
    ],
)
def test_a_change_of_conf_or_of_what_composes_it_is_named(clone: Path, file: str, old: str, new: str, stage: str):
    assert first_stale(clone) == UP_TO_DATE
    path = clone / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    assert first_stale(clone) == stage
    path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("package", "stage"),
    [
        ("world", "scenes"), ("artifacts", "scenes"), ("models/vae", "train@full"), ("perception", "irl@irl_maxent"),
        ("stats", "evaluate"), ("planning", "repair"), ("causal", "intervene"), ("viewer", "record"),
        ("report", "report"),
    ],
)  # fmt: skip
def test_a_change_of_a_package_makes_the_first_stage_that_imports_it_stale(clone: Path, package: str, stage: str):
    planted = next(path for path in sorted((clone / "pipeline" / package).rglob("*.py")) if path.stat().st_size > 500)
    text = planted.read_text(encoding="utf-8")
    planted.write_text(f"{text}\nPLANTED = True\n", encoding="utf-8")
    entries = json.loads(dvc(clone, "status", "--json", stage))[stage]
    planted.write_text(text, encoding="utf-8")
    deps = {name: how for x in entries if isinstance(x, dict) for name, how in x.get("changed deps", {}).items()}
    assert any(how == "modified" and planted.is_relative_to(clone / name) for name, how in deps.items())
