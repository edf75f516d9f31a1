"""Compare two commits: what changed in their inputs, and what that did to headlines and claims."""

import difflib
import io
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml
from scipy.stats import t

from pipeline.audit.revision import git
from pipeline.config.graph import ROOT
from pipeline.launch import PROCESSORS
from pipeline.runtime.errors import InputError
from pipeline.stats.tests import LEVEL, holm

LOCKS = "requirements.lock"
DATA = re.compile(r"md5: (\S+)")
CLAIM = "claims."
SEEDS = "reports/tables/seeds.csv"  # headline, seed, value
SAME = 0.01  # two commits are the same within one per cent: a tenth of the least difference that pages comment on


class Commit(NamedTuple):
    """A commit of a repository or of its clone."""

    revision: str
    repository: Path = ROOT

    def file(self, path: str) -> str:
        """Return a file's text; "" if the commit has no such file."""
        try:
            return git(self.repository, "show", f"{self.revision}:{path}")
        except InputError:
            return ""

    def files(self, suffix: str) -> list[str]:
        """Return the paths of all files with this suffix."""
        names = git(self.repository, "ls-tree", "-r", "--name-only", self.revision).splitlines()
        return [name for name in names if name.endswith(suffix)]

    def table(self, path: str) -> pd.DataFrame | None:
        """Return a csv; None if the commit has no such file."""
        text = self.file(path)
        return pd.read_csv(io.StringIO(text)) if text else None

    def headlines(self) -> dict[str, Any]:
        """Return reports/metrics.json, flat: accuracy.full.new_items -> number; raise InputError if it is missing."""
        text = self.file("reports/metrics.json")
        if not text:
            raise InputError(f"commit {self.revision} has no reports/metrics.json: choose one with results")
        return flat(json.loads(text))


class Headline(NamedTuple):
    """One number of reports/metrics.json in both commits."""

    name: str
    before: float | None
    after: float | None

    @property
    def change(self) -> float | None:
        """Return after minus before; None if one is missing."""
        return None if self.before is None or self.after is None else self.after - self.before


class Difference(NamedTuple):
    """All that differs between two commits."""

    claims: list[tuple[str, str, str]]  # claim, verdict before, verdict after
    headlines: list[Headline]  # those that changed
    parameters: list[tuple[str, Any, Any]]  # name, before, after
    packages: list[str]  # lines of requirements.lock, - before and + after
    data: list[str]  # .dvc files whose data changed
    processors: list[tuple[str, str, str]]  # before, after, the stages that ran on another one
    modules: pd.DataFrame  # package, files, lines added, lines removed
    recordings: list[str]  # recordings of the later commit whose content changed
    by_seed: pd.DataFrame  # of `paired`; empty if one of the commits has no results by seed


def compare(before: Commit, after: Commit) -> Difference:
    """Return what differs between two commits. Raise InputError if one lacks reports/metrics.json."""
    old, new = before.headlines(), after.headlines()
    seeds = before.table(SEEDS), after.table(SEEDS)
    names = sorted({*old, *new})
    claims = [
        (name.removeprefix("claims."), str(old.get(name, "–")), str(new.get(name, "–")))
        for name in names
        if name.startswith("claims.")
    ]
    numbers = [
        Headline(name, _number(old.get(name)), _number(new.get(name)))
        for name in names
        if not name.startswith("claims.")
    ]
    changed = [line for line in numbers if line.before != line.after]
    return Difference(
        claims=[claim for claim in claims if claim[1] != claim[2]],
        headlines=sorted(changed, key=lambda line: line.change is None),  # numbers that only one of them has come last
        parameters=_parameters(before, after),
        packages=_packages(before, after),
        data=[path for path in after.files(".dvc") if _data(before, path) != _data(after, path)],
        processors=_processors(before, after),
        modules=_modules(before, after),
        recordings=_recordings(before, after),
        by_seed=pd.DataFrame() if seeds[0] is None or seeds[1] is None else paired(*seeds),
    )


def flat(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Return a nested mapping as one of dotted names."""
    if not isinstance(tree, dict):
        return {prefix: tree}
    parts = [flat(part, f"{prefix}.{key}".lstrip(".")) for key, part in tree.items()]
    return {name: value for part in parts for name, value in part.items()}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _parameters(before: Commit, after: Commit) -> list[tuple[str, Any, Any]]:
    old, new = (flat(yaml.safe_load(commit.file("params.yaml")) or {}) for commit in (before, after))
    return [(name, old.get(name), new.get(name)) for name in sorted({*old, *new}) if old.get(name) != new.get(name)]


def _packages(before: Commit, after: Commit) -> list[str]:
    old, new = (commit.file(LOCKS).splitlines() for commit in (before, after))
    lines = difflib.unified_diff(old, new, lineterm="", n=0)
    return [line for line in lines if re.match(r"[+-]\w", line)]


def _data(commit: Commit, path: str) -> list[str]:
    return DATA.findall(commit.file(path))


def _processors(before: Commit, after: Commit) -> list[tuple[str, str, str]]:
    """Return the stages that ran on another processor, by the processors; none if one commit does not say."""
    old, new = (json.loads(commit.file(PROCESSORS) or "{}") for commit in (before, after))
    moved: dict[tuple[str, str], list[str]] = {}
    for stage in sorted(old.keys() & new.keys()):
        if old[stage] != new[stage]:
            moved.setdefault((old[stage], new[stage]), []).append(stage)
    return [(*pair, ", ".join(stages)) for pair, stages in moved.items()]


def _modules(before: Commit, after: Commit) -> pd.DataFrame:
    """Return the Python lines that changed, by package."""
    lines = git(after.repository, "diff", "--numstat", before.revision, after.revision, "--", "*.py").splitlines()
    rows = [line.split("\t") for line in lines if not line.startswith("-")]
    table = pd.DataFrame(rows, columns=["added", "removed", "file"]).astype({"added": int, "removed": int})
    table["package"] = ["/".join(re.sub(r"\{.* => (.*)\}", r"\1", name).split("/")[:2]) for name in table["file"]]
    return table.groupby("package").agg(files=("file", "size"), added=("added", "sum"), removed=("removed", "sum"))


def _recordings(before: Commit, after: Commit) -> list[str]:
    old, new = _digests(before), _digests(after)
    kept = [Path(path).stem for path in after.files(".rrd")]
    return [name for name in kept if name in new and old.get(name) != new[name]]


def _digests(commit: Commit) -> dict[str, str]:
    table = commit.table("reports/recordings/recordings.csv")
    return {} if table is None else dict(zip(table["run"], table["sha256"], strict=True))


def paired(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the paired differences over seeds of the headlines in two tables (headline, seed, value).

    Columns: headline, before, after, difference, ci_low, ci_high (95 %, Student's t), p_holm (paired t, Holm's
    correction over all headlines), seeds, word. Word: better or worse if p_holm < .05; same if the interval lies within
    +-SAME; else undecided.
    """
    both = old.merge(new, on=["headline", "seed"], suffixes=("_before", "_after"))
    rows = [_pair(str(name), part) for name, part in both.groupby("headline", sort=False) if len(part) > 1]
    table = pd.DataFrame(rows)
    if len(table):
        table["p_holm"] = holm(table.pop("p").to_numpy())
        table["word"] = [_word(row) for row in table.itertuples()]
    return table


def _pair(name: str, part: pd.DataFrame) -> dict[str, Any]:
    differences = (part["value_after"] - part["value_before"]).to_numpy()
    mean, error = differences.mean(), differences.std(ddof=1) / np.sqrt(len(differences))
    reach = error * t.ppf(0.975, len(differences) - 1)
    p = 2 * t.sf(abs(mean) / error, len(differences) - 1) if error > 0 else float(mean == 0)
    row = {"headline": name, "before": part["value_before"].mean(), "after": part["value_after"].mean()}
    return row | {"difference": mean, "ci_low": mean - reach, "ci_high": mean + reach, "p": p, "seeds": len(part)}


def _word(row: Any) -> str:
    if row.p_holm < LEVEL and row.difference:
        return "better" if row.difference > 0 else "worse"
    return "same" if row.ci_low > -SAME and row.ci_high < SAME else "undecided"
