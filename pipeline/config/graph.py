"""Read the DVC graph: each stage's inputs and outputs, and the variants that it lists."""

import re
from pathlib import Path
from typing import Any

import yaml

from pipeline.runtime.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
FITTED = ("train", "irl", "clearance")  # stages that run once per variant, each variant in its own folder
# matches the outputs of a fitted variant: path, stage, variant, file
LISTED = re.compile(rf"outputs/({'|'.join(FITTED)})/([\w-]+)/([\w.]+)")


def graph_files() -> list[Path]:
    """Return the paper's dvc.yaml and those of all existing studies."""
    return [ROOT / "dvc.yaml", *sorted(ROOT.glob("studies/*/dvc.yaml"))]


def _stages(path: Path) -> dict[str, Any]:
    """Return the stages of a dvc.yaml. Raises InputError for a file that cannot be parsed."""
    try:
        return dict(yaml.safe_load(path.read_text())["stages"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        name = path.relative_to(ROOT)
        raise InputError(f"{name} could not be parsed ({error}): restore it with `git checkout {name}`") from error


def stage_entry(stage: str) -> dict[str, Any] | None:
    """Return the entry of a stage in dvc.yaml or in the study's own file; None if there is none."""
    for path in (ROOT / "dvc.yaml", ROOT / "studies" / stage / "dvc.yaml"):
        if path.is_file() and stage in (stages := _stages(path)):
            return stages[stage]
    return None


def with_variants(text: str, stage_of: dict[str, str], before: set[str]) -> str:
    """Return a dvc.yaml whose matrices and file lists name the variants of `stage_of` (variant -> stage).

    `before`: variants that the graph names so far. A list with files of all of them becomes a list of all new ones, one
    per line. A list with only some of them was chosen by hand and is kept.
    """
    for stage in FITTED:
        names = ", ".join(v for v, fitted_by in stage_of.items() if fitted_by == stage)
        text = re.sub(rf"(?m)(^  {stage}:\n(?:    .*\n)*?      variant: )\[.*\]", rf"\g<1>[{names}]", text)
    matches, rows = list(LISTED.finditer(text)), []
    for match in matches:
        gap = text[rows[-1][-1].end() : match.start()] if rows else "?"
        same_row = rows and rows[-1][-1][3] == match[3] and re.fullmatch(r"[\s,-]*", gap)
        rows[-1].append(match) if same_row else rows.append([match])
    for row in reversed(rows):
        if {match[2] for match in row} == before:
            start = text.rfind("\n", 0, row[0].start()) + 1
            indent = re.match(r"\s*-?\s*", text[start:])[0]  # pyright: ignore[reportOptionalSubscript]
            separator = f"\n{indent}" if "-" in indent else f",\n{indent}"
            files = [f"outputs/{stage}/{variant}/{row[0][3]}" for variant, stage in stage_of.items()]
            text = text[: row[0].start()] + separator.join(files) + text[row[-1].end() :]
    return text


def listed_variants() -> set[str]:
    """Return the variants that the paper's graph fits."""
    stages = _stages(ROOT / "dvc.yaml")
    return {variant for stage in FITTED for variant in stages[stage]["matrix"]["variant"]}
