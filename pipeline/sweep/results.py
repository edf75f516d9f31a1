"""The headlines of one job, a row a training set, read from what its target stages wrote."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table

COLUMNS = ["headline", "seed", "value"]
DETOUR = "constant_detour"  # image-blind repair
LOWER_IS_BETTER = ("effect_error.", "unsafe")


def headlines(cfg: DictConfig, folder: Path, targets: Sequence[str]) -> pd.DataFrame:
    """Return (headline, seed, value) of the stages evaluate, repair and intervene, and of studies.

    Means are over the users of `evaluate.users`. A study gives the floating-point columns of each of its tables that
    has a row a seed. Stages without results by seed give none.
    """
    readers = {"evaluate": _accuracy, "repair": _repair, "intervene": _effect_error}
    parts = [pd.DataFrame(columns=COLUMNS)]
    for target in targets:
        if target in readers:
            parts.append(readers[target](cfg, folder))
        elif (folder / cfg.paths.studies / target).is_dir():
            parts += _study(cfg, folder / cfg.paths.studies / target)
    table = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    return table.astype({"headline": str, "seed": int, "value": float})


def _mean(table: pd.DataFrame, name: str, keys: list[str], value: str) -> pd.DataFrame:
    """Return the mean of a column for each seed and combination of `keys`, named name.key.key."""
    means = table.groupby([*keys, "seed"], sort=False, observed=True)[value].mean().reset_index()
    names = means[keys].astype(str).agg(".".join, axis=1) if keys else ""
    return pd.DataFrame({"headline": f"{name}." + names, "seed": means["seed"], "value": means[value]})


def _accuracy(cfg: DictConfig, folder: Path) -> pd.DataFrame:
    scores = read_table(folder / cfg.paths.evaluate / "accuracy.parquet")
    scores = scores[scores["user"].isin(list(cfg.evaluate.users))]
    main = scores[scores["n_demos"] == cfg.main_n_demos]
    parts = [_mean(main, "accuracy", ["variant", "split"], "accuracy")]
    one = scores.query("n_demos == 1 and split == 'new_items'")
    if len(one) and cfg.main_n_demos != 1:
        parts.append(_mean(one, "accuracy_one_demo", ["variant", "split"], "accuracy"))
    return pd.concat(parts)


def _repair(cfg: DictConfig, folder: Path) -> pd.DataFrame:
    rows = read_table(folder / cfg.paths.repair / "repairs.parquet")
    rows = rows[rows["method"].isin(["gradient", DETOUR]) & rows["user"].isin(list(cfg.evaluate.users))]
    rows = rows.assign(variant=rows["variant"].astype(object).where(rows["method"] == "gradient", DETOUR))
    return _mean(rows, "repair", ["variant", "user"], "valid_end")


def _effect_error(cfg: DictConfig, folder: Path) -> pd.DataFrame:
    """Return each seed's largest error of an estimated effect, over questions and users."""
    rows = read_table(folder / cfg.paths.intervene / "effects.parquet")
    rows = rows[rows["user"].isin(list(cfg.evaluate.users))]
    keys = ["variant", "question", "user", "seed"]
    effects = rows.groupby(keys, sort=False, observed=True)[["effect", "true_effect"]].mean()
    errors = (effects["effect"] - effects["true_effect"]).abs().rename("error").reset_index()
    worst = errors.groupby(["variant", "seed"], sort=False, observed=True)["error"].max().reset_index()
    return _mean(worst, "effect_error", ["variant"], "error")


def _study(cfg: DictConfig, folder: Path) -> list[pd.DataFrame]:
    parts = []
    for path in sorted([*folder.glob("*.parquet"), *folder.glob("*.csv")]):
        table = read_table(path)
        if "seed" in table and len(table):
            if "user" in table:
                table = table[table["user"].isin(list(cfg.evaluate.users))]
            values = [c for c in table.select_dtypes("float").columns if c != "seed" and table[c].notna().any()]
            keys = [c for c in table.columns if c not in (*values, "seed", "user") and table[c].nunique() > 1]
            parts += [_mean(table, value, keys, value) for value in values]
    return parts
