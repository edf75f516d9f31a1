"""The headlines, a row a training set, read from what stages and studies wrote."""

from collections.abc import Collection
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table


def headlines(cfg: DictConfig, folder: Path, targets: Collection[str]) -> pd.DataFrame:
    """Return (headline, seed, value) of the stages evaluate, repair and intervene, and of studies.

    Means are over the users of `evaluate.users`. A study gives the floating-point columns of each of its tables that
    has a row a seed. Stages without results by seed give none.
    """

    def judged(path: Path) -> pd.DataFrame:
        table = read_table(folder / path)
        return table[table["user"].isin(list(cfg.evaluate.users))] if "user" in table else table

    parts: list[tuple[str, pd.DataFrame, list[str], str]] = []  # headline, table, columns that name rows, its numbers
    if "evaluate" in targets:
        scores = judged(Path(cfg.paths.evaluate) / "accuracy.parquet")
        parts.append(("accuracy", scores[scores["n_demos"] == cfg.main_n_demos], ["variant", "split"], "accuracy"))
        if cfg.main_n_demos != 1:
            one = scores.query("n_demos == 1 and split == 'new_items'")
            parts.append(("accuracy_one_demo", one, ["variant", "split"], "accuracy"))
    if "repair" in targets:
        rows = judged(Path(cfg.paths.repair) / "repairs.parquet").query("method == 'gradient'")
        parts.append(("repair", rows, ["variant", "user"], "valid_end"))
    if "intervene" in targets:  # each seed's largest error of an estimated effect, over questions and users
        keys, effects = ["variant", "question", "user", "seed"], judged(Path(cfg.paths.intervene) / "effects.parquet")
        means = effects.groupby(keys, sort=False, observed=True)[["effect", "true_effect"]].mean().reset_index()
        means["error"] = (means["effect"] - means["true_effect"]).abs()
        worst = means.groupby(["variant", "seed"], sort=False, observed=True)["error"].max().reset_index()
        parts.append(("effect_error", worst, ["variant"], "error"))
    for study in targets:
        written = folder / cfg.paths.studies / study
        for table in map(judged, sorted([*written.glob("*.parquet"), *written.glob("*.csv")])):
            if "seed" in table and len(table):
                values = [c for c in table.select_dtypes("float").columns if c != "seed" and table[c].notna().any()]
                keys = [c for c in table.columns if c not in (*values, "seed", "user") and table[c].nunique() > 1]
                parts += [(value, table, keys, value) for value in values]
    made = [pd.DataFrame({"headline": [], "seed": [], "value": []})]
    for name, table, keys, value in parts:
        means = table.groupby([*keys, "seed"], sort=False, observed=True)[value].mean().reset_index()
        names = [".".join([name, *map(str, key)]) for key in means[keys].to_numpy()]
        made.append(pd.DataFrame({"headline": names, "seed": means["seed"], "value": means[value]}))
    table = pd.concat([part for part in made if len(part)] or made, ignore_index=True)
    return table.astype({"headline": str, "seed": int, "value": float})
