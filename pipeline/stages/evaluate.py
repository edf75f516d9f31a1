"""Stage evaluate: scores every variant and the image-free nulls on every query, and compares variants."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import Queries, demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import read_table, write_json, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, model_dir
from pipeline.artifacts.scenes import read_position_prior, train_pool
from pipeline.causal.interventions import DIGITS
from pipeline.launch import launch
from pipeline.models import baselines as nulls
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import LEVEL, estimate, holm, paired_wilcoxon, quartiles
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error, reliability

WORST = 0.05  # of the scenes
DRAWS = 200  # of errors in scenes at random
CALIBRATION_COLUMNS = ["variant", "split", "low", "high", "count", "confidence", "frequency"]
KEY = ["user", "n_demos", "seed", "split"]
Key = tuple[str, int, int, str]  # user, n, seed, split
Cells = dict[tuple[str, str, int], np.ndarray]  # (variant, split, n) -> accuracy of each seed
Judged = dict[str, dict[Key, np.ndarray]]  # variant -> key -> p of every query, scene by scene


def main(cfg: DictConfig, out_dir: Path) -> None:
    """accuracy.parquet, accuracy.csv, calibration.parquet, comparisons.csv and metrics.json."""
    queries = read_queries(Path(cfg.paths.demos))
    truth = _truth(cfg, queries)
    judged: Judged = {v: _predictions(cfg, v, truth) for v in tqdm(list(cfg.variants), desc="predictions")}
    judged |= _nulls(cfg, queries, truth)

    scores = _scores(judged, truth, cfg.evaluate.bins)
    averaged = _over_users(cfg, scores, list(cfg.evaluate.users))
    calibration, errors = _calibration(cfg, judged, truth)
    comparisons = _comparisons(cfg, averaged)
    metrics = {
        "accuracy": _summary(averaged),
        "in_new_scenes": _over_scenes(cfg, judged, truth),
        "accuracy_all_users": _summary(_over_users(cfg, scores, list(cfg.users))),
        "calibration": errors,
    }
    write_table(out_dir / "accuracy.parquet", scores)
    write_table(out_dir / "accuracy.csv", _curve(averaged))
    write_table(out_dir / "calibration.parquet", calibration)
    write_table(out_dir / "comparisons.csv", comparisons)
    write_json(out_dir / "metrics.json", metrics)


def _keys(cfg: DictConfig) -> list[Key]:
    """Every (user, n, seed, split) that must have been predicted."""
    return [
        (user, n, seed, split)
        for user in cfg.users
        for n in cfg.n_demos
        for seed in cfg.protocol.seeds
        for split in cfg.protocol.splits
    ]


def _pool(cfg: DictConfig, seed: int, split: str) -> str:
    """The pool of scenes a split stands for."""
    return cfg.protocol.splits[split] or train_pool(seed)


def _truth(cfg: DictConfig, queries: dict[str, Queries]) -> dict[Key, np.ndarray]:
    """The label (scene, query) of every query by key."""
    truth = {}
    for user, n, seed, split in _keys(cfg):
        pool = _pool(cfg, seed, split)
        if pool not in queries or user not in queries[pool].valid:
            raise InputError(
                f"no queries of pool {pool} for user {user}: run the demos stage with these seeds and users"
            )
        truth[user, n, seed, split] = queries[pool].valid[user]
    return truth


def _predictions(cfg: DictConfig, variant: str, truth: dict[Key, np.ndarray]) -> dict[Key, np.ndarray]:
    """A variant's p (scene, query) by key; InputError names the first key that is missing or other than asked."""
    path = model_dir(cfg, variant) / "predictions.parquet"
    table = read_table(path, PREDICTION_COLUMNS)
    rows = dict(table.groupby(KEY).indices)  # (user, n, seed, split) -> row numbers
    columns = {name: table[name].to_numpy() for name in ("scene", "query", "p", "valid")}
    again = f"run stage {cfg.variants[variant].stage} for {variant} again ({path})"
    out = {}
    for key, valid in truth.items():
        name = "user {}, n {}, seed {}, split {}".format(*key)
        if key not in rows:
            raise InputError(f"{variant} has no predictions for {name}: {again}")
        part = {column: values[rows[key]] for column, values in columns.items()}
        at = part["scene"], part["query"]
        if len(at[0]) != valid.size or max(at[0]) >= len(valid) or max(at[1]) >= valid.shape[1]:
            raise InputError(
                f"{variant} has {len(at[0])} predictions for {name}: expected {valid.size} "
                f"({valid.shape[0]} scenes of {valid.shape[1]} paths); {again}"
            )
        p = np.full(valid.shape, np.nan)
        p[at] = part["p"]
        if not ((p >= 0) & (p <= 1)).all() or not np.array_equal(valid[at], part["valid"]):
            raise InputError(
                f"{variant} predicts other paths, or no probabilities, for {name}: expected one p in "
                f"[0, 1] for every query of the demos stage; {again}"
            )
        out[key] = p
    return out


def _nulls(cfg: DictConfig, queries: dict[str, Queries], truth: dict[Key, np.ndarray]) -> Judged:
    """What both nulls answer; only scenes with demonstrations have a nearest one."""
    demos = read_demos(Path(cfg.paths.demos))
    prior = read_position_prior(Path(cfg.paths.scenes))
    near, place = {}, {}
    for key in truth:
        user, n, seed, split = key
        if user not in prior:
            raise InputError(f"position_prior.npz knows no user {user}: run the scenes stage again")
        z = queries[_pool(cfg, seed, split)].z
        place[key] = nulls.position_only(prior[user], z)
        if cfg.protocol.splits[split] is None:
            near[key] = nulls.nearest_demonstration(*demo_arrays(demos, seed, user, n), z)
    return dict(zip(nulls.NULLS, (near, place), strict=True))


def _scores(judged: Judged, truth: dict[Key, np.ndarray], bins: int) -> pd.DataFrame:
    """One row per variant, user, n, seed and split; auroc is NaN where all paths are valid."""
    rows = [
        (
            variant,
            *key,
            accuracy(p, v),
            auroc(p, v),
            brier(p, v),
            expected_calibration_error(p, v, bins),
            p.size,
        )
        for variant, by_key in tqdm(judged.items(), desc="scores")
        for key, p, v in ((key, p.ravel(), truth[key].ravel()) for key, p in by_key.items())
    ]
    return pd.DataFrame(rows, columns=["variant", *KEY, "accuracy", "auroc", "brier", "ece", "count"])


def _over_users(cfg: DictConfig, scores: pd.DataFrame, users: list[str]) -> Cells:
    """Each seed's accuracy, the mean over `users`, in the order of the protocol's seeds."""
    score = dict(zip(scores[["variant", *KEY]].itertuples(index=False, name=None), scores["accuracy"], strict=True))
    return {
        (variant, split, n): np.array(
            [np.mean([score[variant, user, n, seed, split] for user in users]) for seed in cfg.protocol.seeds]
        )
        for variant in dict.fromkeys(scores["variant"])
        for split in cfg.protocol.splits
        if (variant, users[0], cfg.n_demos[0], cfg.protocol.seeds[0], split)
        in score  # nearest_demonstration: seen scenes only
        for n in cfg.n_demos
    }


def _summary(averaged: Cells) -> dict:
    """variant -> split -> n<N> -> mean and quartiles over seeds."""
    out: dict = {}
    for (variant, split, n), by_seed in averaged.items():
        cell = _rounded(quartiles(by_seed)) | {"seeds": len(by_seed)}
        out.setdefault(variant, {}).setdefault(split, {})[f"n{n}"] = cell
    return out


def _rounded(numbers: dict[str, float]) -> dict[str, float]:
    return {name: round(value, DIGITS) for name, value in numbers.items()}


def _over_scenes(cfg: DictConfig, judged: Judged, truth: dict[Key, np.ndarray]) -> dict:
    """variant -> split that all seeds share -> accuracy at main_n_demos, mean over `evaluate.users`: its 95 % interval.

    The interval is over seeds crossed with scenes. `worst`: the share of all errors made in the `few` scenes where most
    are made, WORST of all `scenes`; `worst_by_chance`: if each path's errors lay in a scene at random, the mean of
    DRAWS. Both None without an error.
    """
    wrong = {v: {k: (p > DECISION) != truth[k] for k, p in by.items()} for v, by in judged.items()}
    shared = [split for split, pool in cfg.protocol.splits.items() if pool is not None]
    seeds, users, out = cfg.protocol.seeds, cfg.evaluate.users, {}
    for variant, split in product(judged, shared):
        keys = [[(user, cfg.main_n_demos, seed, split) for user in users] for seed in seeds]
        if keys[0][0] not in wrong[variant]:  # nearest_demonstration
            continue
        errors = np.array([[wrong[variant][key] for key in of_seed] for of_seed in keys])  # (seed, user, scene, query)
        e, by_path = estimate(1 - errors.mean((1, 3))[None]), errors.mean((0, 1))
        few = max(1, round(WORST * len(by_path)))
        out.setdefault(variant, {})[split] = {
            "ci_low": float(e.ci_low[0]), "ci_high": float(e.ci_high[0]), "scenes": len(by_path), "few": few,
            **dict.fromkeys(("worst", "worst_by_chance")),
        }  # fmt: skip
        if errors.any():
            rng = stream(cfg.scenes.root_seed, "errors by chance", variant, split)
            shuffled = [rng.permutation(by_path.ravel()).reshape(by_path.shape) for _ in range(DRAWS)]
            by_chance = np.mean([_in_worst(draw, few) for draw in shuffled])
            out[variant][split] |= {"worst": _in_worst(by_path, few), "worst_by_chance": float(by_chance)}
    return out


def _in_worst(errors: Float[Array, "scene query"], few: int) -> float:
    """The share of all errors made in the `few` scenes where most are made."""
    by_scene = np.sort(errors.sum(1))[::-1]
    return float(by_scene[:few].sum() / by_scene.sum())


def _curve(averaged: Cells) -> pd.DataFrame:
    """Accuracy against n: one row per variant, split and n."""
    cells = [
        {"variant": variant, "split": split, "n_demos": n} | _rounded(quartiles(by_seed))
        for (variant, split, n), by_seed in averaged.items()
    ]
    return pd.DataFrame(cells, columns=["variant", "split", "n_demos", "mean", "q1", "q3"])


def _calibration(cfg: DictConfig, judged: Judged, truth: dict[Key, np.ndarray]) -> tuple[pd.DataFrame, dict[str, dict]]:
    """Reliability bins and errors of each variant and split at main_n_demos, seeds and `evaluate.users` pooled.

    bias: mean p less the share that is valid.
    """
    tables, errors = [], {}
    for variant, by_key in judged.items():
        for split in cfg.protocol.splits:
            keys = [k for k in by_key if k[0] in cfg.evaluate.users and k[1] == cfg.main_n_demos and k[3] == split]
            if not keys:  # nearest_demonstration beyond the seen scenes
                continue
            p = np.concatenate([by_key[k].ravel() for k in keys])
            valid = np.concatenate([truth[k].ravel() for k in keys])
            bins = pd.DataFrame(vars(reliability(p, valid, cfg.evaluate.bins)))
            tables.append(bins.assign(variant=variant, split=split)[CALIBRATION_COLUMNS])
            errors.setdefault(variant, {})[split] = {
                "ece": expected_calibration_error(p, valid, cfg.evaluate.bins),
                "brier": brier(p, valid),
                "bias": float(p.mean() - valid.mean()),
            }
    table = pd.concat(tables, ignore_index=True)
    return table.query("count > 0"), errors


def _tests(cfg: DictConfig) -> list[tuple[str, str, str, str, int]]:
    """The tests fixed in advance: (family, variant, against, split, n)."""
    return [
        (group.family, group.variant, against, split, cfg.main_n_demos if group.n_demos is None else group.n_demos)
        for group in cfg.evaluate.comparisons
        for against in group.against
        for split in group.splits
        if group.n_demos is None or group.n_demos in cfg.n_demos
    ]


def _comparisons(cfg: DictConfig, averaged: Cells) -> pd.DataFrame:
    """Exact paired Wilcoxon over seeds for every test, and Holm's correction within each family."""
    rows = []
    for family, variant, against, split, n in _tests(cfg):
        a, b = averaged[variant, split, n], averaged[against, split, n]
        p = paired_wilcoxon(a, b)
        rows.append((family, variant, against, split, n, a.mean(), b.mean(), (a - b).mean(), p, len(a)))
    columns = ["family", "variant", "against", "split", "n_demos", "mean", "mean_against", "difference", "p", "seeds"]
    table = pd.DataFrame(rows, columns=columns)
    table["p_holm"] = table["p"]
    for rows_of in table.groupby("family").indices.values():
        table.loc[rows_of, "p_holm"] = holm(table["p"].to_numpy()[rows_of])
    return table.assign(significant=table["p_holm"] < LEVEL)


if __name__ == "__main__":
    launch(main, "evaluate")
