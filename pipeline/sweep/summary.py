"""Summarise a sweep: a tidy table, means by setting, paired differences from a reference setting."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
import yaml
from omegaconf import OmegaConf

from pipeline.artifacts.files import read_json, read_table
from pipeline.audit.difference import paired
from pipeline.audit.setting import canonical, setting, values
from pipeline.sweep.results import DETOUR, LOWER_IS_BETTER

QUARTILES = {"mean": "mean", "q1": lambda x: x.quantile(0.25), "q3": lambda x: x.quantile(0.75)}
MISSING = object()
FLIPPED = {"better": "worse", "worse": "better"}


@dataclass(frozen=True)
class Summary:
    """A sweep's results as its page shows them.

    results: (setting, the swept parameters, headline, seed, value); means: by setting and headline, with quartiles;
    differences: of each setting from the reference, for headlines that the sweep changes; comparisons: of variants
    within each setting.
    """

    record: dict[str, Any]
    jobs: list[dict[str, Any]]
    parameters: list[str]
    reference: str
    is_default: bool
    results: pd.DataFrame
    means: pd.DataFrame
    differences: pd.DataFrame
    comparisons: pd.DataFrame
    protocol: str
    profile: str

    @property
    def headlines(self) -> list[str]:
        """Return the headlines that the sweep changes, those on unseen items first."""
        return sorted(self.differences["headline"].unique(), key=lambda name: not name.endswith("new_items"))


def read_jobs(folder: Path, record: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the records of planned jobs and of those with a folder, one a setting.

    Each has its name, path, swept values as text, and in `at_default` those of them that are the default.
    """
    found = {}
    for path in sorted((folder / "jobs").glob("*/job.json")):
        job = read_json(path)
        key = setting(job["overrides"], record["fixed"])
        if job["state"] == "done" or key not in found:
            found[key] = job | {"path": path.parent}
    planned = {setting(job, record["fixed"]): {"overrides": job, "state": "missing"} for job in record["jobs"]}
    jobs = [found.get(key, job) for key, job in (planned | found).items()]
    fixed = values(record["fixed"])
    for job in jobs:
        given = values(job["overrides"]).items()
        job["values"] = {k: v for k, v in given if k not in fixed or canonical(v) != canonical(fixed[k])}
    keys = list(dict.fromkeys(key for job in jobs for key in job["values"]))
    for job in jobs:  # a later run may sweep what an earlier one left as it was
        if job["state"] == "done" and (others := [key for key in keys if key not in job["values"]]):
            job["values"] |= _values(job["path"] / "params.yaml", others)
    texts = {key: _texts([job["values"][key] for job in jobs if key in job["values"]]) for key in keys}
    defaults = {key.lstrip("+"): canonical(value) for key, value in record.get("defaults", {}).items()}
    for job in jobs:
        own = {key: canonical(value) for key, value in job["values"].items()}
        job["at_default"] = [key for key, text in own.items() if text == defaults.get(key)]
        job["values"] = {key: texts[key][text] for key, text in own.items()}
    short = {key: key.rpartition(".")[2] for key in keys}
    names = short if len(set(short.values())) == len(keys) else {key: key for key in keys}
    for job in jobs:
        job["name"] = ", ".join(f"{names[key]}={value}" for key, value in job["values"].items()) or "default"
    return jobs


def _values(path: Path, names: list[str]) -> dict[str, Any]:
    """Return parameters by their dotted names as a params.yaml has them; leave out what it lacks."""
    parameters = OmegaConf.load(path)
    found = {name: OmegaConf.select(parameters, name, default=MISSING) for name in names}
    return {
        name: OmegaConf.to_object(value) if OmegaConf.is_config(value) else value
        for name, value in found.items()
        if value is not MISSING
    }


def _texts(swept: list[Any]) -> dict[str, str]:
    """Return canonical text -> what a page shows: `shown`, unless two values would look the same."""
    texts = {canonical(value): shown(value) for value in swept}
    return texts if len(set(texts.values())) == len(texts) else {text: text for text in texts}


def shown(value: Any) -> str:
    """Return a parameter's value as text; a mapping whose values are all the same is shown as that value."""
    same = isinstance(value, dict) and len({canonical(part) for part in value.values()}) == 1
    return shown(next(iter(value.values()))) if same else canonical(value)


def summarise(record: dict[str, Any], jobs: list[dict[str, Any]]) -> Summary:
    """Return the summary of the jobs that are done."""
    done = [job for job in jobs if job["state"] == "done"]
    keys = list(dict.fromkeys(key for job in done for key in job["values"]))
    parameters = [key for key in keys if len({job["values"].get(key) for job in done}) > 1]
    defaults = {key.lstrip("+"): shown(value) for key, value in record.get("defaults", {}).items()}
    at_default = [job for job in done if all(p in job["at_default"] or p not in job["values"] for p in parameters)]
    reference = (at_default or done)[0]
    parts = []
    for job in done:
        table = read_table(job["path"] / "results.parquet")
        values = {p: job["values"].get(p, defaults.get(p)) for p in parameters}
        parts.append(table.assign(setting=job["name"], **values)[["setting", *parameters, *table.columns]])
    results = pd.concat(parts, ignore_index=True)
    by = results.groupby(["setting", "headline"], sort=False)["value"]
    means = by.agg(**QUARTILES, seeds="size").reset_index()
    cfg = yaml.safe_load((reference["path"] / "params.yaml").read_text())
    differences = _differences(results, reference["name"])
    comparisons = _comparisons(results, cfg["evaluate"]["comparisons"])
    facts = {"comparisons": comparisons, "protocol": cfg["protocol"]["name"], "profile": cfg["profile"]}
    return Summary(record, jobs, parameters, reference["name"], bool(at_default), results, means, differences, **facts)


def _differences(results: pd.DataFrame, reference: str) -> pd.DataFrame:
    """Return each setting's paired difference from the reference, for headlines that differ in any setting.

    Columns as of `paired`; Holm's correction is over all settings and headlines. A word says what is better, not what
    is larger.
    """
    is_reference, columns = results["setting"] == reference, ["headline", "seed", "value"]
    base, others = results.loc[is_reference, columns], results.loc[~is_reference, ["headline", "setting", *columns[1:]]]
    both = others.merge(base, on=columns[:2], suffixes=("", "_before"))
    changed = both.loc[both["value"] != both["value_before"], "headline"].unique()
    table = paired(base, others[others["headline"].isin(changed)])
    lower = table["headline"].str.startswith(LOWER_IS_BETTER)
    return table.assign(word=table["word"].where(~lower, table["word"].replace(FLIPPED)))


def _comparisons(results: pd.DataFrame, families: list[dict[str, Any]]) -> pd.DataFrame:
    """Return how much better a variant is than another in each setting, for the pairs of `evaluate.comparisons`.

    Columns: setting, variant, against, split and those of `paired`: accuracies at main_n_demos, and, with a split
    "repair, <user>", shares of repairs that end valid against the image-blind detour. Holm corrects over all rows.
    """
    parts = results["headline"].str.extract(r"^(?P<kind>accuracy|repair)\.(?P<variant>[^.]+)\.(?P<split>.+)$")
    parts["split"] = parts["split"].where(parts.pop("kind") == "accuracy", "repair, " + parts["split"])
    scores = results[["setting", "seed", "value"]].join(parts).dropna()
    families = [family for family in families if family["n_demos"] is None]
    pairs = [(f["variant"], against, split) for f in families for against, split in product(f["against"], f["splits"])]
    variants, repairs = dict.fromkeys(f["variant"] for f in families), scores[scores["variant"] == DETOUR]
    pairs += [(variant, DETOUR, split) for variant in variants for split in repairs["split"].unique()]
    compared = pd.DataFrame(pairs, columns=["variant", "against", "split"], dtype=str)
    after = compared.merge(scores, on=["variant", "split"])
    before = compared.merge(scores.rename(columns={"variant": "against"}), on=["against", "split"])
    return paired(before, after[["setting", *compared.columns, "seed", "value"]])
