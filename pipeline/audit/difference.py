"""Compare two commits: what changed in their inputs, and what that did to headlines and claims."""

import difflib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from omegaconf import OmegaConf
from scipy.stats import t

from pipeline.git import git
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import PROCESSORS, ROOT
from pipeline.runtime.reading import parse_csv
from pipeline.stats.tests import LEVEL, MIN_PAIRS, holm

METRICS = "reports/metrics.json"
CLAIM = "claims."
SEEDS = "reports/tables/seeds.csv"  # headline, seed, value
DECIMALS = 12  # to which differences are rounded
SAME = 0.01  # two commits are the same within one per cent: a tenth of the least difference that pages comment on


class Commit(NamedTuple):
    """A commit of a repository or of its clone."""

    revision: str
    repository: Path = ROOT

    def file(self, path: str) -> str:
        """Return a file's text; "" if the commit has no such file."""
        listed = git(self.repository, "ls-tree", "--name-only", self.revision, path)
        return git(self.repository, "show", f"{self.revision}:{path}") if listed else ""

    def headlines(self) -> dict[str, Any]:
        """Return reports/metrics.json, flat: accuracy.full.new_items -> number; raise InputError if it is missing."""
        text = self.file(METRICS)
        if not text:
            raise InputError(f"commit {self.revision} has no {METRICS}: choose one with results")
        try:
            return flat(json.loads(text))
        except ValueError as error:
            raise InputError(f"{METRICS} of commit {self.revision} cannot be read: {error}") from error


@dataclass(frozen=True)
class Difference:
    """All that differs between two commits."""

    claims: list[tuple[str, str, str]]  # claim, verdict before, verdict after
    headlines: list[tuple[str, float | None, float | None, float | None]]  # that changed: name, before, after, change
    parameters: list[tuple[str, Any, Any]]  # name, before, after
    packages: list[str]  # lines of requirements.lock, - before and + after
    data: list[str]  # .dvc files whose data changed
    processors: list[tuple[str, str, str]]  # before, after, the stages that ran on another one
    by_seed: pd.DataFrame  # of `paired`; empty if one of the commits has no results by seed


def compare(before: Commit, after: Commit) -> Difference:
    """Return what differs between two commits. Raise InputError if one lacks reports/metrics.json."""
    old, new = before.headlines(), after.headlines()
    was, now = _parameters(before), _parameters(after)
    claims, numbers = [], list[tuple]()
    for name in sorted({*old, *new}):
        values = old.get(name), new.get(name)
        if name.startswith(CLAIM) and values[0] != values[1]:
            claims.append((name.removeprefix(CLAIM), *("–" if value is None else str(value) for value in values)))
        elif not name.startswith(CLAIM):
            x, y = (float(value) if isinstance(value, int | float) else None for value in values)
            if x != y:
                numbers.append((name, x, y, None if x is None or y is None else y - x))
    pinned, pinned_now = (commit.file("requirements.lock").splitlines() for commit in (before, after))
    packages = difflib.unified_diff(pinned, pinned_now, lineterm="", n=0)
    seeds = [commit.file(SEEDS) for commit in (before, after)]
    data = "diff", "--name-only", "-Gmd5: ", before.revision, after.revision, "--", "*.dvc"
    return Difference(
        claims=claims,
        headlines=sorted(numbers, key=lambda line: line[3] is None),  # numbers that only one of them has come last
        parameters=[(n, was.get(n), now.get(n)) for n in sorted({*was, *now}) if was.get(n) != now.get(n)],
        packages=[line for line in packages if re.match(r"[+-]\w", line)],
        data=git(after.repository, *data).splitlines(),
        processors=_processors(before, after),
        by_seed=paired(*(parse_csv(text, ("headline",)) for text in seeds)) if all(seeds) else pd.DataFrame(),
    )


def flat(tree: Any) -> dict[str, Any]:
    """Return a nested mapping as one of dotted names."""
    return pd.json_normalize([tree]).to_dict("records")[0]


def _parameters(commit: Commit) -> dict[str, Any]:
    """Return a commit's parameters by their dotted names; the text `null` is one that is empty."""
    parameters = flat(OmegaConf.to_container(OmegaConf.create(commit.file("params.yaml") or "{}")))
    return {name: "null" if value is None else value for name, value in parameters.items()}


def _processors(before: Commit, after: Commit) -> list[tuple[str, str, str]]:
    """Return the stages that ran on another processor, by the processors; none if one commit does not say."""
    old, new = (json.loads(commit.file(str(PROCESSORS)) or "{}") for commit in (before, after))
    moved: dict[tuple[str, str], list[str]] = {}
    for stage in sorted(old.keys() & new.keys()):
        if old[stage] != new[stage]:
            moved.setdefault((old[stage], new[stage]), []).append(stage)
    return [(*pair, ", ".join(stages)) for pair, stages in moved.items()]


def paired(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the paired differences over seeds of two tables: a row for each of `new`'s keys, such as headline.

    Keys are all columns but seed and value; `old` need not have all of them. Other columns: before, after, difference,
    seeds, ci_low, ci_high (95 %, Student's t), p_holm (paired t, Holm's correction over all rows), word. Word: better
    or worse if p_holm < .05; same if the interval lies within +-SAME, or no seed differs; else undecided. Interval and
    p are NaN for fewer than MIN_PAIRS pairs, and where all differences are equal: `untested` says which. Differences
    are rounded to DECIMALS, so that float noise is no variance. Seeds with no value are left out.
    """
    keys = [column for column in new if column not in ("seed", "value")]
    both = new.merge(old, on=[column for column in old if column != "value"], suffixes=("_after", "_before"))
    both = both.dropna(subset=["value_before", "value_after"])
    both["difference"] = (both["value_after"] - both["value_before"]).round(DECIMALS)
    columns = {name: (f"value_{name}", "mean") for name in ("before", "after")} | {"difference": ("difference", "mean")}
    columns |= {how: ("difference", how) for how in ("min", "max", "size", "sem")}
    table = both.groupby(keys, sort=False).agg(**columns).reset_index()
    low, high, seeds, error = (table.pop(how) for how in ("min", "max", "size", "sem"))
    equal, tested = (low == 0) & (high == 0), (seeds >= MIN_PAIRS) & (low < high)
    difference, error, freedom = table["difference"], error.where(tested), (seeds - 1).clip(lower=1)
    p = np.where(tested, 2 * t.sf(difference.abs() / error, freedom), 1.0)
    p_holm, reach = pd.Series(holm(p), index=table.index).where(tested), error * t.ppf(0.975, freedom)
    table = table.assign(seeds=seeds, ci_low=difference - reach, ci_high=difference + reach, p_holm=p_holm)
    clear = p_holm < LEVEL
    within = (table["ci_low"] > -SAME) & (table["ci_high"] < SAME)
    cases = [clear & (difference > 0), clear & (difference < 0), within | equal]
    return table.assign(word=np.select(cases, ["better", "worse", "same"], "undecided"))


def untested(row: Any) -> str:
    """Return why a row of `paired` has neither interval nor p; "" if it has them."""
    if not np.isnan(row.p_holm):
        return ""
    if row.difference == 0 and row.word == "same":
        return "equal for every seed"
    return "too few pairs" if row.seeds < MIN_PAIRS else "the same for every seed: no variance"
