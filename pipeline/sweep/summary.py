"""Summarise a sweep: a tidy table of results, paired differences from a reference setting, and a page."""

import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_table
from pipeline.audit.difference import paired, untested
from pipeline.launch import load
from pipeline.report.page import FOLDER, Site, environment, render_page, write_files
from pipeline.report.style import label
from pipeline.stats.tests import MIN_PAIRS
from pipeline.sweep.job import Sweep
from pipeline.sweep.plan import sweeps, value_of

KINDS = {"accuracy_one_demo": "accuracy with one demonstration", "effect_error": "largest effect error"}
LOWER_IS_BETTER = "effect_error.", "unsafe"  # how such headlines begin
MAX_PANELS = 4  # results beside one another


@dataclass(frozen=True)
class Summary:
    """A sweep's results as its page shows them."""

    record: dict[str, Any]  # sweep.json
    jobs: list[dict[str, Any]]
    cfg: DictConfig  # of the reference
    parameters: list[str]  # those of which jobs have different values
    reference: str  # the setting that others are compared with: the default one if `is_default`
    is_default: bool
    results: pd.DataFrame  # setting, the parameters, headline, seed, value
    differences: pd.DataFrame  # of each setting from the reference, for headlines that the sweep changes

    def table(self, name: str) -> pd.DataFrame:
        """Return a table by its name."""
        return getattr(self, name)

    def source(self, name: str) -> str:
        """Return how a number of a table names it."""
        return f"{name}.parquet"


def read_jobs(sweep: Sweep) -> list[dict[str, Any]]:
    """Return the records of planned jobs and of those with a folder, one a folder; each has its path and name."""
    planned = {sweep.job_folder(job): {"overrides": job, "state": "missing"} for job in sweep.record["jobs"]}
    found = {path.parent: read_json(path) for path in sorted((sweep.folder / "jobs").glob("*/job.json"))}
    return [job | {"path": path, "name": path.name} for path, job in (planned | found).items()]


def summarise(record: dict[str, Any], jobs: list[dict[str, Any]]) -> Summary:
    """Return the summary of the jobs that are done."""
    done = [job for job in jobs if job["state"] == "done"]
    own = [text for job in done for text in job["overrides"] if text not in record["fixed"]]
    keys = list(dict.fromkeys(text.partition("=")[0].lstrip("+~") for text in own))
    settings = [load(job["path"] / "params.yaml") for job in done]
    pairs = [[text.lstrip("+~").partition("=")[::2] for text in job["overrides"]] for job in done]
    typed = [{k: word for k, word in job if k != "experiment" or not sweeps(word)} for job in pairs]
    values = [  # a parameter may be swept by a later run alone; an experiment is none, and known by what was typed
        {key: value if (value := value_of(cfg, key)) != "null" else words.get(key, value) for key in keys}
        for cfg, words in zip(settings, typed, strict=True)
    ]
    keys = [key for key in keys if len({value[key] for value in values}) > 1]
    ends = [key.rpartition(".")[2] for key in keys]
    shown = dict(zip(keys, ends if len({*ends}) == len(keys) else keys, strict=True))
    names = [", ".join(f"{shown[key]}={value[key]}" for key in keys) or "default" for value in values]
    parts = {}  # settings that are spelled in two ways count once
    for job, name, value in zip(done, names, values, strict=True):
        columns = {"setting": name} | {key: value[key] for key in keys}
        table = read_table(job["path"] / "results.parquet")
        parts[name] = table.assign(**columns)[[*columns, *table.columns]]
    results = pd.concat(list(parts.values()), ignore_index=True)
    is_default = [
        all(key not in words or value[key] == record["defaults"].get(key) for key in keys)
        for value, words in zip(values, typed, strict=True)
    ]
    place = is_default.index(True) if any(is_default) else 0
    compared = _differences(results, names[place])
    return Summary(record, jobs, settings[place], keys, names[place], any(is_default), results, compared)


def _differences(results: pd.DataFrame, reference: str) -> pd.DataFrame:
    """Return each setting's paired difference from the reference, for headlines that differ in any setting.

    Columns as of `paired`; best: whether the mean is the best of its headline; why: what kept the difference from being
    tested. A word says what is better, not what is larger. Unseen items come first.
    """
    is_reference, columns = results["setting"] == reference, ["headline", "seed", "value"]
    base, others = results.loc[is_reference, columns], results.loc[~is_reference, ["headline", "setting", *columns[1:]]]
    both = others.merge(base, on=columns[:2], suffixes=("", "_before"))
    changed = both.loc[both["value"] != both["value_before"], "headline"].unique()
    table = paired(base, others[others["headline"].isin(changed)])
    table = table.sort_values("headline", key=lambda names: ~names.str.endswith("new_items"), kind="stable")
    lower = table["headline"].str.startswith(LOWER_IS_BETTER)
    gain = table["difference"].where(~lower, -table["difference"])
    best = (gain > 0) & (gain == gain.groupby(table["headline"]).transform("max"))
    words = table["word"].where(~lower, table["word"].replace({"better": "worse", "worse": "better"}))
    return table.assign(word=words, best=best, why=[untested(row) for row in table.itertuples()])


def title(headline: str) -> str:
    """Return a headline in words: accuracy.full.new_items as Accuracy, paper's model, unseen items."""
    kind, *rest = headline.split(".")
    text = ", ".join([KINDS.get(kind, kind.replace("_", " ")), *map(label, rest)])
    return text[:1].upper() + text[1:]


def along(parameter: str) -> Callable[[Summary], pd.DataFrame]:
    """Return a function that gives means and quartiles by a parameter's values, result and variant."""

    def curve(summary: Summary) -> pd.DataFrame:
        table = summary.results[summary.results["headline"].isin(summary.differences["headline"])]
        parts = table["headline"].str.extract(r"^([^.]+)(?:\.([^.]+))?(.*)$").fillna("")
        numbers = pd.to_numeric(table[parameter], errors="coerce")
        at = table[parameter] if numbers.isna().any() else numbers
        table = table.assign(result=(parts[0] + parts[2]).map(title), variant=parts[1], at=at)
        table = table[table["result"].isin(table["result"].unique()[:MAX_PANELS])]
        groups = table.groupby(["result", "variant", "at"], sort=False)["value"]
        return groups.describe()[["mean", "25%", "75%"]].set_axis(["mean", "q1", "q3"], axis=1).reset_index()

    return curve


def write_summary(folder: Path, record: dict[str, Any], jobs: list[dict[str, Any]]) -> None:
    """Write index.html with its figures and tables, and the tidy tables as parquet."""
    summary, site = summarise(record, jobs), Site()
    names = {"home": "", "pages": {"index": "Sweep"}, "facts": {"studies": []}, "few": MIN_PAIRS, "s": summary}
    made = environment([Path(__file__).parent], along=along, title=title, typed=shlex.join, **names)
    render_page("index", "page.html.j2", None, summary, made, site)
    write_files(site, folder)
    shutil.copy(FOLDER / "page.css", folder)
    write_table(folder / "results.parquet", summary.results)
    write_table(folder / "differences.parquet", summary.differences)
