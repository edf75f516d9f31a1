"""What a sweep found: a tidy table, means by setting, paired differences from a reference setting, and a page."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from pipeline.artifacts.files import read_json, read_table, write_table
from pipeline.audit.difference import paired
from pipeline.report.page import FOLDER, Site, environment, render_page, write_files
from pipeline.sweep.results import LOWER_IS_BETTER

FLIPPED = {"better": "worse", "worse": "better"}


@dataclass(frozen=True)
class Summary:
    """A sweep's results as its page shows them.

    results: (setting, the swept parameters, headline, seed, value); means: by setting and headline, with quartiles;
    differences: of each setting from the reference, for headlines that the sweep changes.
    """

    record: dict[str, Any]
    jobs: list[dict[str, Any]]
    parameters: list[str]
    reference: str
    is_default: bool
    results: pd.DataFrame
    means: pd.DataFrame
    differences: pd.DataFrame
    protocol: str
    profile: str

    @property
    def headlines(self) -> list[str]:
        """Return the headlines that the sweep changes, those on unseen items first."""
        names = list(dict.fromkeys(self.differences["headline"])) if len(self.differences) else []
        return sorted(names, key=lambda name: (not name.endswith("new_items"), name.startswith("convergence")))


def read_jobs(folder: Path, record: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the records of planned jobs and of those with a folder, with their name, path and swept values."""
    found = {}
    for path in sorted((folder / "jobs").glob("*/job.json")):
        job = read_json(path)
        found[tuple(job["overrides"])] = job | {"path": path.parent}
    planned = {tuple(job): {"overrides": job, "state": "missing"} for job in record["jobs"]}
    jobs = [found.get(key, job) for key, job in (planned | found).items()]
    for job in jobs:
        own = [text for text in job["overrides"] if text not in record["fixed"]]
        job["values"] = dict(text.lstrip("+").partition("=")[::2] for text in own)
    keys = list(dict.fromkeys(key for job in jobs for key in job["values"]))
    short = {key: key.rpartition(".")[2] for key in keys}
    names = short if len(set(short.values())) == len(keys) else {key: key for key in keys}
    for job in jobs:
        job["name"] = ", ".join(f"{names[key]}={value}" for key, value in job["values"].items()) or "default"
    return jobs


def summarise(record: dict[str, Any], jobs: list[dict[str, Any]]) -> Summary:
    """Return the summary of the jobs that are done."""
    done = [job for job in jobs if job["state"] == "done"]
    keys = list(dict.fromkeys(key for job in done for key in job["values"]))
    parameters = [key for key in keys if len({job["values"].get(key) for job in done}) > 1]
    defaults = record.get("defaults", {})
    at_default = [j for j in done if all(_same(j["values"].get(p), defaults.get(p)) for p in parameters)]
    reference = (at_default or done)[0]
    parts = []
    for job in done:
        table = read_table(job["path"] / "results.parquet")
        values = {p: job["values"].get(p, str(defaults.get(p))) for p in parameters}
        parts.append(table.assign(setting=job["name"], **values)[["setting", *parameters, *table.columns]])
    results = pd.concat(parts, ignore_index=True)
    by = results.groupby(["setting", "headline"], sort=False)["value"]
    means = by.agg(
        mean="mean", q1=lambda x: x.quantile(0.25), q3=lambda x: x.quantile(0.75), seeds="size"
    ).reset_index()
    cfg = yaml.safe_load((reference["path"] / "params.yaml").read_text())
    differences = _differences(results, reference["name"])
    facts = {"protocol": cfg["protocol"]["name"], "profile": cfg["profile"]}
    return Summary(record, jobs, parameters, reference["name"], bool(at_default), results, means, differences, **facts)


def _same(text: str | None, default: Any) -> bool:
    return text is None or yaml.safe_load(text) == default


def _differences(results: pd.DataFrame, reference: str) -> pd.DataFrame:
    """Return each setting's paired difference from the reference, for headlines that differ in any setting.

    Columns as of `paired`; Holm's correction is over all settings and headlines. A word says what is better, not what
    is larger.
    """
    columns = ["setting", "headline", "seed", "value"]
    base = results.loc[results["setting"] == reference, ["headline", "seed", "value"]]
    others = results.loc[results["setting"] != reference, columns].merge(
        base, on=["headline", "seed"], suffixes=("", "_before")
    )
    changed = others.loc[others["value"] != others["value_before"], "headline"].unique()
    others = others[others["headline"].isin(changed)]
    both = others.assign(headline=others["setting"] + "|" + others["headline"])
    table = paired(both[["headline", "seed"]].assign(value=both["value_before"]), both[["headline", "seed", "value"]])
    if len(table):
        parts = table.pop("headline").str.rpartition("|")
        table.insert(0, "headline", parts[2])
        table.insert(1, "setting", parts[0])
        lower = table["headline"].str.startswith(LOWER_IS_BETTER)
        table.loc[lower, "word"] = table.loc[lower, "word"].replace(FLIPPED)
    return table


def write_summary(folder: Path, record: dict[str, Any], jobs: list[dict[str, Any]]) -> Path:
    """Write index.html with its figures and tables, results.parquet and differences.parquet; return the page's path."""
    from pipeline.sweep.page.tables import best, title

    summary = summarise(record, jobs)
    site = Site()
    names = {"home": "", "pages": {"index": "Sweep"}, "facts": {"studies": []}}
    names |= {"s": summary, "best": best, "title": title, "origins": ()}  # its tables are made of no other tables
    made = environment([Path(__file__).parent / "page"], **names)
    render_page("index", "page.html.j2", "pipeline.sweep.page", summary, made, site)
    write_files(site, folder)
    shutil.copy(FOLDER / "page.css", folder)
    write_table(folder / "results.parquet", summary.results)
    write_table(folder / "differences.parquet", summary.differences)
    return folder / "index.html"
