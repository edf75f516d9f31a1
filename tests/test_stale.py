"""A change that can alter a result is never followed by "up to date": asked of DVC in a checkout of the last commit."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.git import checked_out, dvc
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


def test_an_edit_of_conf_is_named_before_anything_else(clone: Path):
    assert first_stale(clone) == UP_TO_DATE
    path = clone / "conf/users/careful.yaml"
    text = path.read_text(encoding="utf-8")
    assert "0.045" in text
    path.write_text(text.replace("0.045", "0.046"), encoding="utf-8")
    assert first_stale(clone) == "params"
    path.write_text(text, encoding="utf-8")


# package or module -> stages that import it, of which DVC is asked
READ_BY = {
    "params.py": "params", "launch.py": "scenes train@full report", "runtime": "params scenes report",
    "world": "scenes demos", "artifacts": "scenes", "models/vae": "train@full repair",
    "training/irl": "irl@irl_maxent readings", "perception": "irl@irl_maxent", "stats": "evaluate",
    "planning": "repair", "causal": "intervene", "viewer": "record", "report": "report",
}  # fmt: skip


def test_a_change_of_any_package_makes_the_stages_that_import_it_stale(clone: Path):
    planted = {}
    for place in READ_BY:
        path = clone / "pipeline" / place
        planted[place] = path if path.is_file() else max(path.rglob("*.py"), key=lambda p: p.stat().st_size)
        with planted[place].open("a", encoding="utf-8") as code:
            code.write("\nPLANTED = True\n")
    found = json.loads(dvc(clone, "status", "--json"))
    for place, stages in READ_BY.items():
        for stage in stages.split():
            changed = [x["changed deps"] for x in found[stage] if isinstance(x, dict) and "changed deps" in x]
            modified = [clone / name for deps in changed for name, how in deps.items() if how == "modified"]
            assert any(planted[place].is_relative_to(path) for path in modified), (stage, place)
