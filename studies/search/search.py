"""Search settings of every learner on validation scenes, and write studies/search/settings.csv, one row a setting.

python -m studies.search.search            start, or go on where the table ends (`make search`)
python -m studies.search.search full ae    only these learners

Every learner has the same number of settings, drawn by the same sampler (Optuna's TPE). It maximises balanced accuracy
in new validation scenes, the mean over careful and normal users. The table alone decides what is drawn next, so an
interrupted search goes on as if it had not been.
"""

import argparse
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pandas as pd
from omegaconf import DictConfig
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.samplers import PartialFixedSampler, TPESampler

from pipeline.artifacts.files import read_table, write_table
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import job_seed
from studies.search.fits import (
    ENSEMBLE,
    OWN,
    REPEAT,
    SAMPLED,
    SHARED,
    Fit,
    Predicted,
    default,
    fit_all,
    fits_of,
    ranges_of,
    scores,
    setting_of,
)

TABLE = Path(__file__).with_name("settings.csv")
KEY = ["learner", "origin", "number"]  # origin: repeat, sampled, or ensemble (of the sampled setting `number`)
ORIGINS = [REPEAT, SAMPLED, ENSEMBLE]
SPLITS = ("seen_scenes", "new_scenes")
DIGITS = 6  # significant digits of a setting, as in the table


def main(argv: Sequence[str]) -> None:
    """Search the settings of the learners in `argv`, or of all."""
    cfg = compose(["protocol=validation"])
    if unknown := [name for name in argv if name not in cfg.variants]:
        raise InputError(f"learner {unknown[0]!r}: expected some of {', '.join(map(str, cfg.variants))}")
    search(cfg, list(argv) or list(cfg.variants), TABLE)


def search(cfg: DictConfig, learners: Sequence[str], path: Path) -> None:
    """Go on with the search of these learners until the table at `path` is complete."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # its version is pinned
    table = read_table(path) if path.is_file() else pd.DataFrame(columns=KEY)
    while rows := [row for learner in learners for row in draw(cfg, learner, table[table["learner"] == learner])]:
        counts = table[table["origin"] == SAMPLED].groupby("learner").size().reindex(learners, fill_value=0)
        done = judge(cfg, rows, f"search, {counts.min()} of {cfg.studies.search.settings} settings")
        write_table(path, ordered(cfg, pd.concat([table, done], ignore_index=True)))
        table = read_table(path)  # as rounded, so that an interrupted search draws the same settings


def ordered(cfg: DictConfig, table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows by learner, origin and number; columns: key, parameters, results."""
    parameters = dict.fromkeys(name for ranges in cfg.studies.search.space.values() for name in ranges)
    parameters = [name for name in parameters if name in table.columns]
    results = [name for name in table.columns if name not in [*KEY, *parameters]]
    ranks = [table[name].map(order.index) for name, order in zip(KEY, (list(cfg.variants), ORIGINS), strict=False)]
    rows = np.lexsort((table["number"].astype(int), *ranks[::-1]))
    return table.iloc[rows][[*KEY, *parameters, *results]].reset_index(drop=True)


def draw(cfg: DictConfig, learner: str, table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the next rows of a learner, without results; none if its table is complete.

    First the repeats of the default, then `together` settings at a time, last the ensembles of the best.
    """
    study, ranges = cfg.studies.search, ranges_of(cfg, learner)
    rows = []
    if table.empty:
        rows += [_row(learner, REPEAT, i, 1, default(cfg, learner)) for i in range(study.repeats)]
    sampled = table[table["origin"] == SAMPLED]
    if len(sampled) < study.settings:
        settings = ask(cfg, learner, sampled, min(study.together, study.settings - len(sampled)))
        return rows + [_row(learner, SAMPLED, len(sampled) + i, 1, setting) for i, setting in enumerate(settings)]
    if ENSEMBLE not in set(table["origin"]):
        best = sampled.sort_values("new_scenes", ascending=False, kind="stable").head(study.ensembles)
        for row in best.to_dict("records"):
            rows.append(_row(learner, ENSEMBLE, int(row["number"]), study.members, setting_of(row, ranges)))
    return rows


def _row(learner: str, origin: str, number: int, members: int, setting: Mapping[str, Any]) -> dict[str, Any]:
    return {"learner": learner, "origin": origin, "number": number, "members_averaged": members, **setting}


def ask(cfg: DictConfig, learner: str, sampled: pd.DataFrame, count: int) -> list[dict[str, Any]]:
    """Draw the next settings of a learner, given the results so far.

    Those that a stack shares are drawn once, so that all of these fit into one.
    """
    study, ranges = cfg.studies.search, ranges_of(cfg, learner)
    distributions = {name: distribution(**values) for name, values in ranges.items()}
    base = TPESampler(
        n_startup_trials=study.startup,
        multivariate=True,
        constant_liar=True,
        seed=job_seed(study.root_seed, learner, len(sampled)) % 2**32,
    )
    trials = optuna.create_study(direction="maximize", sampler=base)
    for row in sampled.to_dict("records"):
        params, value = setting_of(row, ranges), float(row["new_scenes"])
        trials.add_trial(optuna.trial.create_trial(params=params, distributions=distributions, value=value))
    if sampled.empty:
        trials.enqueue_trial(default(cfg, learner))
    settings: list[dict[str, Any]] = []
    for _ in range(count):
        if settings:
            shared = {name: settings[0][name] for name in SHARED if name in settings[0] and "latent" in settings[0]}
            trials.sampler = PartialFixedSampler(shared, base)
        params = trials.ask(distributions).params
        settings.append({x: float(f"{v:.{DIGITS}g}") if isinstance(v, float) else v for x, v in params.items()})
    return settings


def distribution(
    log: Sequence[float] | None, even: Sequence[float] | None, one_of: Sequence[Any] | None
) -> BaseDistribution:
    """Return Optuna's distribution of a range in conf/studies/search.yaml."""
    if one_of is not None:
        return CategoricalDistribution(one_of)
    low, high = log or even or (0.0, 1.0)
    return FloatDistribution(low, high, log=log is not None)


def judge(cfg: DictConfig, rows: Sequence[Mapping[str, Any]], desc: str) -> pd.DataFrame:
    """Fit the settings of these rows, one model a user and member, and return the rows with their results."""
    groups: list[list[Fit]] = []
    for row in rows:
        members = [row["number"]] if row["origin"] == REPEAT else range(row["members_averaged"])
        setting = {name: row[name] for name in ranges_of(cfg, row["learner"])}
        groups.append(fits_of(cfg, row["learner"], setting, [cfg.studies.search.training_set], list(members)))
    predicted = iter(fit_all(cfg, [fit for group in groups for fit in group], SPLITS, desc))
    results = [_results(cfg, row, [next(predicted) for _ in fits]) for row, fits in zip(rows, groups, strict=True)]
    return pd.DataFrame([{**row, **result} for row, result in zip(rows, results, strict=True)])


def _results(cfg: DictConfig, row: Mapping[str, Any], predicted: Sequence[Predicted]) -> dict[str, Any]:
    """Return a setting's results: balanced accuracies, the gate (the worse user decides), and seconds of one core."""
    users = list(cfg.evaluate.users)
    each = len(predicted) // len(users)
    has_decoder = bool(cfg.variants[row["learner"]].get("alpha"))
    by_user = {user: scores(predicted[i * each : (i + 1) * each], has_decoder) for i, user in enumerate(users)}
    values = pd.DataFrame(by_user)  # (score, user)
    result = {f"new_scenes_{user}": by_user[user]["balanced.new_scenes"] for user in users}
    result |= {split: float(values.loc[f"balanced.{split}"].mean()) for split in SPLITS[::-1]}
    return result | {
        "reconstruction_over_flat": values.loc["reconstruction_over_flat"].max(),
        "own_demonstrations": values.loc[f"accuracy.{OWN}"].min(),
        "passed": bool(values.loc["passed"].all()),
        "seconds": round(float(values.loc["seconds"].sum()), 1),
    }


if __name__ == "__main__":
    about, _, more = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        "python -m studies.search.search", None, about, more, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("learners", nargs="*", help="names of variants; none: all")
    try:
        main(parser.parse_args().learners)
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("error: interrupted; `make search` goes on where the table ends", file=sys.stderr)
        sys.exit(130)
