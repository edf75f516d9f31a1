"""Stage person: make the experiment on a person (pipeline/causal/experiment.py) on simulated people of known rules.

Also: how many labels tell a person's rule on designed tables (pipeline/own/design.py), beside random ones.
"""

from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from pydantic import Field

from pipeline.artifacts.files import write_table
from pipeline.causal.experiment import LOOKS, NEAR_M, STICKER, local_verdicts, smallest_settled, wilson
from pipeline.launch import launch
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Chance, Distance, Group, Length, Names, Several, Size, StudyGroup, Whole
from pipeline.runtime.streams import stream
from studies.person.designed import CHOICES, LABELS, labels
from studies.person.people import Person, sit

DRAWS = 4000  # simulated pairs behind each true effect
WORDS = "effect", "present", "negligible", "undecided"
CLAIMS = "effect", "present"
MANY = 100  # judgements that a careful person should need at most
DESIGNED = 40  # people whose rule is sought on designed and on random tables, at most; two seconds each


class Habits(Group):
    lapses: Chance = 0.0
    accepting: Chance = 0.5
    blur_m: Distance = 0.0
    drift_m: Distance = 0.0
    order: Chance = 0.0
    compositing: Chance = 0.0


class Careful(Group):
    margin_m: Length
    lapses: Annotated[list[Chance], Field(min_length=2)]


class Curve(Group):
    margins_m: Annotated[list[Distance], Field(min_length=1)]
    lapses: Chance


class Settings(StudyGroup):
    root_seed: Whole
    kinds: Annotated[Names, Field(min_length=2)]
    scenes: Several
    seconds: Size
    people: Several
    margins_m: Annotated[list[Distance], Field(min_length=1)]
    most: Habits
    each: Several
    sorts: Annotated[dict[str, Habits], Field(min_length=1)]
    curve: Curve
    careful: Careful


Job = tuple[str, Person, tuple]  # group, person, and the names of the person's stream


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write coverage.csv, false_effects.csv, power.csv, minutes.csv and designed.csv."""
    study = cfg.studies.person
    jobs = people(study)
    parts = map_jobs(partial(asked, int(study.scenes)), jobs, cfg.workers, "simulated people")
    table = pd.concat(parts, keys=range(len(parts)), names=["person", None]).reset_index("person")
    write_table(out_dir / "coverage.csv", coverage(table[table["group"] == "any"]))
    write_table(out_dir / "false_effects.csv", false_effects(table[table["group"].isin(list(study.sorts))]))
    write_table(out_dir / "power.csv", power(table[table["group"].str.startswith("power")], study.kinds[0]))
    write_table(out_dir / "minutes.csv", minutes(table[table["group"].str.startswith("careful")], float(study.seconds)))
    several = list(product(CHOICES, range(min(int(study.each), DESIGNED))))
    counts = map_jobs(partial(labelled, study), several, cfg.workers, "designed tables")
    write_table(out_dir / "designed.csv", designed(pd.DataFrame(several, columns=["choice", "person"]), counts))


def labelled(study: Any, job: tuple[str, int]) -> int:
    """Return `labels` of one person; tables, rule and lapses of a person are the same for both choices."""
    choice, person = job
    rng = stream(study.root_seed, "designed", person)
    return labels(choice, len(study.kinds), list(study.margins_m), study.scenes, study.curve.lapses, rng)


def designed(table: pd.DataFrame, counts: Sequence[int]) -> pd.DataFrame:
    """Return for each choice of tables the labels until the rule is known: median, q1, q3, and the share within LABELS.

    Quantiles above LABELS are LABELS + 1: not known by then.
    """
    rows = []
    for choice, part in table.assign(labels=counts).groupby("choice", sort=False)["labels"]:
        q1, median, q3 = np.quantile(part, (0.25, 0.5, 0.75), method="higher").tolist()
        rows.append((choice, len(part), median, q1, q3, *wilson(int((part <= LABELS).sum()), len(part))))
    return pd.DataFrame(rows, columns=["choice", "people", "median", "q1", "q3", "known", "ci_low", "ci_high"])


def people(study: Any) -> list[Job]:
    """Return every simulated person: of any margins and habits, of each sort, along the power curve, and careful."""
    kinds, seed, jobs = list(study.kinds), study.root_seed, list[Job]()
    for i in range(study.people):
        rng = stream(seed, "any", i)
        margins = dict(zip(kinds, rng.choice(list(study.margins_m), len(kinds)).tolist(), strict=True))
        habits = {name: float(rng.uniform(0, most)) for name, most in study.most.items()}
        jobs.append(("any", Person(margins, **habits), (seed, "any", i, "sitting")))
    groups = {sort: Person(dict.fromkeys(kinds, 0.0), **habits) for sort, habits in study.sorts.items()}
    first, *others = kinds
    for margin in study.curve.margins_m:
        groups[f"power {margin:g}"] = Person({first: margin, **dict.fromkeys(others, 0.0)}, lapses=study.curve.lapses)
    for lapses in study.careful.lapses:
        margins = {kind: study.careful.margin_m if kind == "glass" else 0.0 for kind in kinds}
        groups[f"careful {lapses:g}"] = Person(margins, lapses=lapses)
    return jobs + [(name, one, (seed, name, i)) for (name, one), i in product(groups.items(), range(study.each))]


def asked(scenes: int, job: Job) -> pd.DataFrame:
    """Return the verdicts of one simulated sitting beside the truth: `local_verdicts` and columns of the person."""
    group, person, names = job
    rng = stream(*names)
    plan, answers = sit(person, rng, scenes)
    table = local_verdicts(plan, answers).assign(group=group, judgements=len(answers), lapses=person.lapses)
    truth = person.true_effects(rng, DRAWS) if group == "any" else dict.fromkeys(table["kind"], np.nan)
    return table.assign(truth=table["kind"].map(truth), margin_m=table["kind"].map(person.margins).fillna(0.0))


def coverage(table: pd.DataFrame) -> pd.DataFrame:
    """Return the share of intervals that hold the true effect, with their mean width, by the look that decided."""
    rows = []
    for look in ("all", *range(1, len(LOOKS) + 1)):
        part = table[(table["kind"] != STICKER) & ((look == "all") | (table["look"] == look))]
        holds = (part["ci_low"] <= part["truth"]) & (part["truth"] <= part["ci_high"])
        width = (part["ci_high"] - part["ci_low"]).mean()
        rows.append((str(look), len(part), *wilson(int(holds.sum()), len(part)), width))
    return pd.DataFrame(rows, columns=["look", "intervals", "coverage", "ci_low", "ci_high", "width"])


def false_effects(table: pd.DataFrame) -> pd.DataFrame:
    """Return for each sort of people the share who get an effect, or a present one, of any kind; none has one."""
    kinds, rows = table[table["kind"] != STICKER], []
    for sort, part in kinds.groupby("group", sort=False):
        wrong = part["verdict"].isin(CLAIMS).groupby(part["person"]).any()
        negligible = (part["verdict"] == "negligible").mean()
        rows.append((sort, len(wrong), *wilson(int(wrong.sum()), len(wrong)), negligible))
    return pd.DataFrame(rows, columns=["sort", "people", "false", "ci_low", "ci_high", "negligible"])


def power(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Return the share of each verdict on this kind by the share of near places within its margin."""
    rows = []
    for _, part in table.groupby("group", sort=False):
        one = part[part["kind"] == kind]
        within = min(1.0, float(one["margin_m"].iloc[0]) / NEAR_M)
        for word in WORDS:
            rows.append((within, word, len(one), *wilson(int((one["verdict"] == word).sum()), len(one))))
    return pd.DataFrame(rows, columns=["within", "verdict", "people", "share", "share_ci_low", "share_ci_high"])


def minutes(table: pd.DataFrame, seconds: float) -> pd.DataFrame:
    """Return how many judgements a careful person needs until all verdicts stand, and how often all are right.

    median, q1, q3: of judgements, right or not; minutes: the median's; within: share of people with all verdicts right
    after at most MANY judgements; settled: the smallest effect that the pairs of the first look call absent.
    """
    rows, kinds = [], table[table["kind"] != STICKER]
    for lapses, part in kinds.groupby("lapses", sort=False):
        wanted = np.where(part["margin_m"] > 0, "effect", "negligible")
        right = (part["verdict"] == wanted).groupby(part["person"]).all()
        judgements = part.groupby("person")["judgements"].first()
        q1, median, q3 = np.quantile(judgements, (0.25, 0.5, 0.75), method="higher").tolist()
        row = {"lapses": lapses, "people": len(right), "median": median, "q1": q1, "q3": q3}
        row |= {"minutes": median * seconds / 60}
        row |= dict(zip(("right", "right_ci_low", "right_ci_high"), wilson(int(right.sum()), len(right)), strict=True))
        row |= {"within": (right & (judgements <= MANY)).mean(), "settled": smallest_settled(LOOKS[0])}
        rows.append(row)
    return pd.DataFrame(rows)


if __name__ == "__main__":
    launch(main, "person")
