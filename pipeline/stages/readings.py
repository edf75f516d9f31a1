"""Stage readings: accuracy by number of demonstrations, in ways to understand what the paper's demonstrators showed.

`random_routes` is the main run, read from stage evaluate. In `few_routes_<distance>cm` people show few families of
routes that keep this distance from the boundary of validity. The paper reports the mean of its three users; to one of
them every path is valid. New scenes, with training items and with unseen ones, are the validation pools'.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from numpy import ndarray as Array
from omegaconf import DictConfig
from pydantic import AfterValidator, Field

from pipeline.artifacts.files import read_table, write_json, write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.runtime.settings import Count, Demonstrations, Group, Length, Pair, Whole, Wholes, need, rising
from pipeline.stats.crossed import Items, estimate, items_held
from pipeline.stats.tests import MIN_PAIRS
from pipeline.training.judged_sets import HELD_OUT, NEW_ITEMS, POOLS, draw_judged_sets, judge, judge_blind, row
from pipeline.training.loop import convergence, is_constant
from pipeline.training.refit import TrainingSet, refit

MODEL = "full"  # the paper's model
RANDOM = "random_routes"
PAPER, JUDGED = "paper", "judged"  # users: all, as the paper reports; those to whom some paths are invalid
KEY = ["reading", "split", "variant", "n_demos"]
GATE = ["reconstruction_over_flat", "own_demonstrations", "passed"]
FIT = ["routes", "clear_cm", "n_demos", "variant", "user", "seed"]
COLUMNS = [
    "reading", "split", "variant", "users", "n_demos", "mean", "q1", "q3", "ci_low", "ci_high", "seeds", "fits",
    "passed", "passed_mean",
]  # fmt: skip


class Settings(Group):
    root_seed: Whole
    clear_cm: Wholes
    n_demos: Annotated[list[Demonstrations], AfterValidator(rising), Field(min_length=2)]
    families: Annotated[list[Pair], Field(min_length=1)]
    family_radius: Length
    candidates: Count
    held_out: Count


def agree(readings: Settings, parameters: Any) -> None:
    """Reject numbers of demonstrations without main_n_demos, at which every reading ends, and too few candidates."""
    main_n, n_demos = parameters.main_n_demos, readings.n_demos
    need(main_n in n_demos, "readings.n_demos", n_demos, f"main_n_demos = {main_n} among them, where readings end")
    paths = main_n + readings.held_out
    most = f"at least main_n_demos + held_out = {paths}"
    need(readings.candidates >= paths, "readings.candidates", readings.candidates, most)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet (a row per fit or baseline, and split), curve.csv, convergence.csv and metrics.json."""
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(*POOLS.values(), *(train_pool(seed) for seed in cfg.protocol.seeds))
    evaluated = read_table(Path(cfg.paths.evaluate) / "accuracy.parquet")
    prior = read_position_prior(Path(cfg.paths.scenes))
    judged_sets = list(draw_judged_sets(cfg, scenes))
    evaluate = partial(_judge_and_check, {pool: scenes.images[pool] for pool in POOLS.values()})
    rows, gates = [], []
    numbers = [n for n in cfg.readings.n_demos if n <= cfg.main_n_demos]
    for n in numbers:
        of_n = sorted((x.first(n) for x in judged_sets), key=lambda x: is_constant(x.valid))  # equal labels fit at once
        rows += [blind for x in of_n for blind in judge_blind(prior[x.user], x)]
        if MODEL in cfg.variants:
            named = cfg.copy()
            named.main_n_demos = n  # names the random seeds of the fits
            answers = refit(named, {MODEL: of_n}, evaluate, f"readings, n = {n}")[MODEL]
            for x, (right, gate) in zip(of_n, answers, strict=True):
                rows += [row(x, MODEL, split, by_scene) for split, by_scene in right.items()]
                gates.append(x.key | {"variant": MODEL} | gate)
    table, convergence = pd.DataFrame(rows), pd.DataFrame(gates, columns=[*FIT, *GATE])
    unseen = scenes.layouts[POOLS[NEW_ITEMS]]
    items = items_held(unseen.item, unseen.symbol)
    users = {PAPER: list(cfg.users), JUDGED: list(cfg.evaluate.users)}
    curve = _curve(users, table, convergence, evaluated, items)
    ends: dict[str, dict[str, dict[str, float]]] = {}  # the headlines: both ends of the curve, as the paper reports it
    shown = curve[(curve["split"] == HELD_OUT) & (curve["users"] == PAPER) & curve["variant"].isin([MODEL, NEAREST])]
    for cell in shown[shown["n_demos"].isin([numbers[0], numbers[-1]])].itertuples():
        ends.setdefault(cell.reading, {}).setdefault(cell.variant, {})[f"n{cell.n_demos}"] = cell.mean
    write_table(out_dir / "accuracy.parquet", table.drop(columns="by_scene"))
    write_table(out_dir / "curve.csv", curve)
    write_table(out_dir / "convergence.csv", convergence)
    write_json(out_dir / "metrics.json", {"curve": ends})


def _judge_and_check(scenes: Mapping[str, Array], model: ValidityModel, judged_set: TrainingSet) -> tuple[dict, dict]:
    """Return the model's accuracy in each split, and whether its training converged by the gate of stage train."""
    return judge(scenes, model, judged_set), convergence(model, judged_set)


def _curve(
    users: Mapping[str, list[str]],
    accuracies: pd.DataFrame,
    convergence: pd.DataFrame,
    evaluated: pd.DataFrame,
    items: Items,
) -> pd.DataFrame:
    """Return mean accuracy by reading, split, variant, users and number of demonstrations, with COLUMNS.

    users: PAPER and JUDGED -> names; accuracies, convergence: of few routes; evaluated: accuracy.parquet of stage
    evaluate; items: the unseen ones of each scene. q1, q3: quartiles over seeds; ci_low, ci_high: 95 % interval from
    MIN_PAIRS seeds, over seeds, crossed with scenes and `items` where all seeds share them (empty there for random
    routes). fits, passed: number of fits, and of those that converged; passed_mean: the mean of these.
    """
    few = accuracies.merge(convergence[[*FIT, "passed"]], on=FIT, how="left")
    few = few.assign(reading=[f"few_routes_{clear_cm}cm" for clear_cm in few["clear_cm"]])
    seen = evaluated.assign(reading=RANDOM, split=evaluated["split"].astype(str).replace("seen_scenes", HELD_OUT))
    columns = [*KEY, "user", "seed", "accuracy"]
    table = pd.concat([few[[*columns, "passed", "by_scene"]], seen[columns].astype({"user": str})], ignore_index=True)
    table = table[table["variant"].isin([MODEL, NEAREST, POSITION]) & table["split"].isin([HELD_OUT, *POOLS])]
    parts = []
    for name, members in users.items():
        rows = table[table["user"].isin(members)]
        by_seed = rows.groupby([*KEY, "seed"], sort=False)["accuracy"].mean().groupby(KEY, sort=False)
        means = by_seed.agg(mean="mean", seeds="size").assign(users=name, ci_low=np.nan, ci_high=np.nan)
        means["q1"], means["q3"] = by_seed.quantile(0.25), by_seed.quantile(0.75)
        for key, cell in rows.groupby(KEY, sort=False):
            split, effects = key[1], by_seed.get_group(key).to_numpy()[None, None]  # seeds alone are chance
            if split != HELD_OUT:
                if cell["by_scene"].isna().any():
                    continue
                effects = np.stack([np.mean(list(x), axis=0) for _, x in cell.groupby("seed")["by_scene"]])[None]
            if len(cell["seed"].unique()) >= MIN_PAIRS:
                interval = estimate(effects, items=items if split == NEW_ITEMS else None)
                means.loc[key, ["ci_low", "ci_high"]] = interval.ci_low[0], interval.ci_high[0]
        fits = rows.dropna(subset="passed")
        counts = fits.groupby(KEY)["passed"].agg(["size", "sum"]).astype("Int64")
        means["fits"], means["passed"] = counts["size"], counts["sum"]
        passed = fits[fits["passed"].astype(bool)].groupby([*KEY, "user"])["accuracy"].mean()
        means["passed_mean"] = passed.groupby(KEY).mean()
        parts.append(means.reset_index())
    return pd.concat(parts, ignore_index=True)[COLUMNS]


if __name__ == "__main__":
    launch(main, "readings")
