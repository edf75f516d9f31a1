"""Summarise a sweep: a tidy table of results, paired differences from a reference setting, and a page."""

import shutil
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_table
from pipeline.audit.difference import MIN_PAIRS, paired, untested
from pipeline.launch import load
from pipeline.report.page import FOLDER, Site, environment, render_page, write_files
from pipeline.report.style import label
from pipeline.sweep.job import Sweep
from pipeline.sweep.plan import value_of
from pipeline.sweep.results import LOWER_IS_BETTER

FLIPPED = {"better": "worse", "worse": "better"}
KINDS = {"accuracy_one_demo": "accuracy with one demonstration", "effect_error": "largest effect error"}
MAX_PANELS = 4  # results beside one another


@dataclass(frozen=True)
class Summary:
    """A sweep's results as its page shows them.

    parameters: those of which jobs have different values; reference: the setting that others are compared with, the
    default one if `is_default`; results: (setting, the parameters, headline, seed, value); differences: of each setting
    from the reference, for headlines that the sweep changes.
    """

    record: dict[str, Any]
    jobs: list[dict[str, Any]]
    parameters: list[str]
    reference: str
    is_default: bool
    cfg: DictConfig
    results: pd.DataFrame
    differences: pd.DataFrame


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
    values = [{key: value_of(cfg, key) for key in keys} for cfg in settings]  # one may be swept by a later run alone
    parameters = [key for key in keys if len({value[key] for value in values}) > 1]
    short = {key: key.rpartition(".")[2] for key in parameters}
    names = short if len({*short.values()}) == len(parameters) else {key: key for key in parameters}
    parts = {}
    for job, value in zip(done, values, strict=True):
        name = ", ".join(f"{names[key]}={value[key]}" for key in parameters) or "default"
        shared = {"setting": name} | {key: value[key] for key in parameters}
        table = read_table(job["path"] / "results.parquet")
        parts[name] = table.assign(**shared)[[*shared, *table.columns]]
    defaults = [all(value[key] == record["defaults"].get(key) for key in parameters) for value in values]
    place = defaults.index(True) if any(defaults) else 0
    reference = ", ".join(f"{names[key]}={values[place][key]}" for key in parameters) or "default"
    results = pd.concat(list(parts.values()), ignore_index=True)
    differences = _differences(results, reference)
    return Summary(record, jobs, parameters, reference, any(defaults), settings[place], results, differences)


def _differences(results: pd.DataFrame, reference: str) -> pd.DataFrame:
    """Return each setting's paired difference from the reference, for headlines that differ in any setting.

    Columns as of `paired`, and `best`, whether the setting's mean is the best of its headline. Holm's correction is over
    all settings and headlines. A word says what is better, not what is larger.
    """
    is_reference, columns = results["setting"] == reference, ["headline", "seed", "value"]
    base, others = results.loc[is_reference, columns], results.loc[~is_reference, ["headline", "setting", *columns[1:]]]
    both = others.merge(base, on=columns[:2], suffixes=("", "_before"))
    changed = both.loc[both["value"] != both["value_before"], "headline"].unique()
    table = paired(base, others[others["headline"].isin(changed)])
    lower = table["headline"].str.startswith(LOWER_IS_BETTER)
    gain = table["difference"].where(~lower, -table["difference"])
    best = (gain > 0) & (gain == gain.groupby(table["headline"]).transform("max"))
    return table.assign(word=table["word"].where(~lower, table["word"].replace(FLIPPED)), best=best)


def title(parts: Collection[str]) -> str:
    """Return a headline's parts in words: accuracy, full, new_items as Accuracy, paper's model, unseen items."""
    kind, *rest = parts
    text = ", ".join([KINDS.get(kind, kind.replace("_", " ")), *map(label, rest)])
    return text[:1].upper() + text[1:]


def differences(summary: Summary) -> pd.DataFrame:
    """Return the differences as the page shows them, unseen items first, with the reason of those that were not tested."""
    table = summary.differences
    words = [", ".join(filter(None, [row.word, untested(row)])) for row in table.itertuples()]
    table = table.assign(headline=[title(name.split(".")) for name in table["headline"]], word=words)
    return table.loc[(~summary.differences["headline"].str.endswith("new_items")).sort_values(kind="stable").index]


def along(parameter: str) -> Callable[[Summary], pd.DataFrame]:
    """Return a function that gives means and quartiles over seeds by a parameter's values, result and variant.

    The other parameters are as in the reference; if this parameter has one value there, the mean is over all settings.
    """

    def curve(summary: Summary) -> pd.DataFrame:
        results = summary.results[summary.results["headline"].isin(summary.differences["headline"])]
        others = [name for name in summary.parameters if name != parameter]
        reference = results[results["setting"] == summary.reference].iloc[0]
        held = results[(results[others] == reference[others]).all(axis=1)]
        table = held if held[parameter].nunique() > 1 else results
        parts = [[*name.split("."), ""] for name in table["headline"]]
        table = table.assign(result=[title([p[0], *p[2:-1]]) for p in parts], variant=[p[1] for p in parts])
        table = table[table["result"].isin(table["result"].unique()[:MAX_PANELS])]
        numbers = pd.to_numeric(table[parameter], errors="coerce")
        table = table.assign(at=table[parameter] if numbers.isna().any() else numbers)
        groups = table.groupby(["result", "variant", "at"], sort=False)["value"]
        return groups.quantile([0.25, 0.75]).unstack().set_axis(["q1", "q3"], axis=1).join(groups.mean()).reset_index()

    return curve


def write_summary(folder: Path, record: dict[str, Any], jobs: list[dict[str, Any]]) -> None:
    """Write index.html with its figures and tables, and the tidy tables as parquet."""
    summary, site = summarise(record, jobs), Site()
    names = {"home": "", "pages": {"index": "Sweep"}, "facts": {"studies": []}, "few": MIN_PAIRS, "s": summary}
    made = environment([Path(__file__).parent], differences=differences, along=along, **names)
    render_page("index", "page.html.j2", None, summary, made, site)
    write_files(site, folder)
    shutil.copy(FOLDER / "page.css", folder)
    for name in ("results", "differences"):
        write_table(folder / f"{name}.parquet", getattr(summary, name))
