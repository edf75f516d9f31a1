"""Stage search: refit the best setting of each learner in training sets of the main results, beside its default.

`make search` judged settings in validation scenes (search.py, settings.csv). The best is the one with the highest
balanced accuracy there. The default's predictions are those of the main results.
"""

from functools import partial
from itertools import product
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, model_dir
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from studies.search.fits import REPEAT, Predicted, fit_all, fits_of, ranges_of, scores, setting_of

TABLE = Path(__file__).with_name("settings.csv")
DEFAULT, BEST = "default", "best"
KEY = ["learner", "setting", "split"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write settings.csv (the search's, of the learners there are), learners.csv, accuracy.parquet and summary.csv."""
    settings = read_table(TABLE)
    settings = settings[settings["learner"].isin(list(cfg.variants))]
    if settings.empty:
        raise InputError(f"{TABLE} has no setting of {', '.join(map(str, cfg.variants))}: run `make search`")
    chosen = best(settings)
    accuracies = pd.DataFrame([*of_default(cfg, list(chosen.index)), *of_best(cfg, chosen)])
    write_table(out_dir / "settings.csv", settings)
    write_table(out_dir / "learners.csv", searched(settings, chosen))
    write_table(out_dir / "accuracy.parquet", accuracies)
    write_table(out_dir / "summary.csv", summarise(accuracies))


def best(settings: pd.DataFrame) -> pd.DataFrame:
    """Return each learner's best row, single or ensemble, by learner; the first of equal ones."""
    judged = settings[settings["origin"] != REPEAT]
    first = judged.sort_values("new_scenes", ascending=False, kind="stable").drop_duplicates("learner")
    order = settings["learner"].drop_duplicates()
    return first.set_index("learner", drop=False).loc[order]


def searched(settings: pd.DataFrame, chosen: pd.DataFrame) -> pd.DataFrame:
    """Return what the search found of each learner, on validation scenes.

    settings: those judged; spread: standard deviation of the default over initial weights; passed: share that pass the
    gate; best_passed: the best result among these, empty if none does; _seen: on other paths of the training scenes.
    """
    rows = []
    for learner, row in chosen.iterrows():
        of_learner = settings[settings["learner"] == learner]
        repeated = of_learner[of_learner["origin"] == REPEAT]
        judged = of_learner[of_learner["origin"] != REPEAT]
        rows.append(
            {
                "learner": learner,
                "settings": len(judged),
                "default": repeated["new_scenes"].mean(),
                "spread": repeated["new_scenes"].std(),
                "repeats": len(repeated),
                "best": row["new_scenes"],
                "number": row["number"],
                "members": row["members_averaged"],
                "passed": judged["passed"].astype(bool).mean(),
                "best_passed": judged.loc[judged["passed"].astype(bool), "new_scenes"].max(),
                "default_seen": repeated["seen_scenes"].mean(),
                "best_seen": judged["seen_scenes"].max(),
                "minutes": of_learner["seconds"].sum() / 60,
            }
        )
    return pd.DataFrame(rows)


def of_best(cfg: DictConfig, chosen: pd.DataFrame) -> list[dict]:
    """Fit each learner's best setting; return its accuracies by user, seed and split."""
    seeds, fits = list(cfg.protocol.seeds)[: cfg.studies.search.seeds], []
    for learner, row in chosen.iterrows():
        setting = setting_of(row.to_dict(), ranges_of(cfg, str(learner)))
        fits += fits_of(cfg, str(learner), setting, seeds, range(int(row["members_averaged"])))
    predicted, rows = iter(fit_all(cfg, fits, list(cfg.protocol.splits), "best settings")), []
    for learner, row in chosen.iterrows():
        for user, seed in product(cfg.evaluate.users, seeds):
            models = [next(predicted) for _ in range(int(row["members_averaged"]))]
            rows += _rows(cfg, str(learner), BEST, user, seed, models)
    return rows


def of_default(cfg: DictConfig, learners: list[str]) -> list[dict]:
    """Return the accuracies of the main results' models by user, seed and split."""
    seeds, rows = list(cfg.protocol.seeds)[: cfg.studies.search.seeds], []
    for learner in learners:
        table = read_table(model_dir(cfg, learner) / "predictions.parquet", PREDICTION_COLUMNS)
        table = table[(table["n_demos"] == cfg.main_n_demos) & table["user"].isin(list(cfg.evaluate.users))]
        for (user, seed), part in table[table["seed"].isin(seeds)].groupby(["user", "seed"], sort=False):
            by_split = {split: part[part["split"] == split] for split in cfg.protocol.splits}
            p, valid = ({s: x[name].to_numpy() for s, x in by_split.items()} for name in ("p", "valid"))
            rows += _rows(cfg, learner, DEFAULT, str(user), int(seed), [Predicted(p, valid, float("nan"), 0.0)])
    return rows


def _rows(cfg: DictConfig, learner: str, setting: str, user: str, seed: int, models: list[Predicted]) -> list[dict]:
    result, measures = scores(models, has_decoder=False), ("accuracy", "balanced")
    key = {"learner": learner, "setting": setting, "user": user, "seed": seed}
    return [key | {"split": s} | {name: result[f"{name}.{s}"] for name in measures} for s in cfg.protocol.splits]


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Return mean accuracies (over users) with quartiles over seeds."""
    by_seed = table.groupby([*KEY, "seed"], sort=False)[["accuracy", "balanced"]].mean().reset_index()
    first, third = partial(pd.Series.quantile, q=0.25), partial(pd.Series.quantile, q=0.75)
    columns = {"accuracy": ("accuracy", "mean"), "q1": ("accuracy", first), "q3": ("accuracy", third)}
    columns |= {"balanced": ("balanced", "mean"), "seeds": ("seed", "size")}
    return by_seed.groupby(KEY, sort=False).agg(**columns).reset_index()


if __name__ == "__main__":
    launch(main, "search")
