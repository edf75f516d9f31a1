"""Stage evaluate: score every variant and the image-blind baselines on all queries, and compare variants."""

from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import read_table, write_json, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, fitted_n_demos, model_dir
from pipeline.artifacts.scenes import read_position_prior, train_pool
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Count, Demonstrations, Group, Names, Some, need, need_several_seeds, need_some
from pipeline.stats.crossed import estimate, quartiles
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error, reliability
from pipeline.stats.tests import LEVEL, holm, paired_wilcoxon

MODEL = ["user", "n_demos", "seed", "split"]
QUERY = [*MODEL, "scene", "query"]
COMPARED = [
    "family", "variant", "against", "split", "n_demos", "mean", "mean_against", "difference", "q1", "q3", "p", "p_holm",
    "significant", "seeds",
]  # fmt: skip
CONVERGENCE = ["reconstruction_over_flat", "own_demonstrations", "passed"]
HEADLINE, SEEN = "new_items", "seen_scenes"  # splits of the headlines, which fit a screen together
PAPER, SHOWN = "full", ("full", "clearance")  # variants with more headlines than others
MAX_TESTS = 25  # with 10 seeds the smallest p is 2/1024: under Holm's correction more tests could never be significant


class Comparison(Group):
    """A family of paired tests: one variant against others."""

    family: str
    variant: str
    against: Some
    splits: Some
    n_demos: Demonstrations | None


class Settings(Group):
    users: Names
    bins: Count
    comparisons: list[Comparison]


def agree(evaluate: Settings, parameters: Any) -> None:
    """Reject comparisons that cannot be made, and more than MAX_TESTS in a family; absent variants are skipped."""
    need_several_seeds(parameters)
    need_some("evaluate.users", evaluate.users, parameters.users)
    splits, name, counts = dict(parameters.protocol.splits), "evaluate.comparisons", Counter()
    several = parameters.scenes.validation > 1 or not {"val_scenes", "val_items"} & set(splits.values())
    at_least = "at least 2, or intervals over scenes mean nothing"
    need(several, "scenes.validation", parameters.scenes.validation, at_least)
    for c in evaluate.comparisons:
        for split in c.splits:
            judged = split in splits and (NEAREST not in (c.variant, *c.against) or splits[split] is None)
            where = f"one of {', '.join(splits)}; {NEAREST} has demonstrations only in seen scenes"
            need(judged, name, f"{c.variant} against {', '.join(c.against)} on {split}", where)
        fitted = (c.n_demos or parameters.main_n_demos) in parameters.n_demos
        counts[c.family] += len(c.against) * len(c.splits) * fitted
    for family, count in counts.items():
        few = f"at most {MAX_TESTS}, or Holm's correction leaves nothing to be found"
        need(count <= MAX_TESTS, name, f"{count} tests in family {family}", few)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet, metrics.json, and accuracy, calibration, scores, comparisons and convergence as csv."""
    truth = _truth(cfg)
    parts = [_predictions(cfg, variant, truth) for variant in tqdm(list(cfg.variants), desc="predictions")]
    predictions = pd.concat([*parts, *_baselines(cfg, truth)], ignore_index=True)
    accuracies = _accuracies(predictions, cfg.evaluate.bins)
    judged = predictions[predictions["user"].isin(cfg.evaluate.users)]
    scored = accuracies[accuracies["user"].isin(cfg.evaluate.users)]
    by_seed = scored.groupby(["variant", "split", "n_demos", "seed"], sort=False)["accuracy"].mean().unstack(sort=False)
    summary = _summary(cfg, by_seed, judged)
    calibration, scores = _calibration(judged[judged["n_demos"] == cfg.main_n_demos], cfg.evaluate.bins)
    write_table(out_dir / "accuracy.parquet", accuracies)
    write_table(out_dir / "accuracy.csv", summary)
    write_table(out_dir / "calibration.csv", calibration)
    write_table(out_dir / "scores.csv", scores)
    write_table(out_dir / "comparisons.csv", _comparisons(cfg, by_seed))
    convergence = _convergence(cfg)
    write_table(out_dir / "convergence.csv", convergence)
    write_json(out_dir / "metrics.json", _metrics(cfg, summary, convergence))


def _truth(cfg: DictConfig) -> pd.DataFrame:
    """Return all queries of every model with path [m] and label; InputError if a pool or user has none."""
    queries, parts = read_queries(Path(cfg.paths.demos)), []
    for user in cfg.users:
        for n in cfg.n_demos:
            for seed in cfg.protocol.seeds:
                for split, shared in cfg.protocol.splits.items():
                    pool = shared or train_pool(seed)
                    if pool not in queries or user not in queries[pool].valid:
                        raise InputError(
                            f"no queries of pool {pool} for user {user}: run the demos stage with these seeds and users"
                        )
                    valid, z = queries[pool].valid[user], queries[pool].z
                    scene, query = (index.ravel() for index in np.indices(valid.shape))
                    part = {"scene": scene, "query": query, "valid": valid.ravel()}
                    part |= {"z_x": z[..., 0].ravel(), "z_y": z[..., 1].ravel()}
                    parts.append(pd.DataFrame(part).assign(user=user, n_demos=n, seed=seed, split=split))
    table = pd.concat(parts, ignore_index=True)
    return table.astype({"user": "category", "split": "category"})


def _predictions(cfg: DictConfig, variant: str, truth: pd.DataFrame) -> pd.DataFrame:
    """Return a variant's p of every query; InputError for the first model with missing or different queries."""
    path = model_dir(cfg, variant) / "predictions.parquet"
    again = f"run stage {cfg.variants[variant].stage} for {variant} again ({path})"
    table = read_table(path, PREDICTION_COLUMNS)
    truth = truth[truth["n_demos"].isin(fitted_n_demos(cfg, variant))]
    for name in ("user", "split"):
        table[name] = pd.Categorical(table[name], truth[name].cat.categories)
    merged = truth.merge(table, on=QUERY, how="left", suffixes=("", "_predicted"))
    lacking = merged["p"].isna()
    if len(merged) != len(truth) or lacking.any():
        counts = table.groupby(MODEL, observed=True).size()
        for key, count in truth.groupby(MODEL, observed=True, sort=False).size().items():
            if (predicted := counts.get(key, 0)) != count:
                name = "user {}, {} demonstrations, seed {}, split {}".format(*key)  # pyright: ignore
                raise InputError(f"{variant} has {predicted} predictions for {name}: expected {count}; {again}")
        raise InputError(f"{variant} predicts other paths: expected one p a query; {again}")
    if not merged["p"].between(0, 1).all() or (merged["valid"] != merged["valid_predicted"]).any():
        raise InputError(f"{variant} predicts other paths, or no probabilities: expected p in [0, 1]; {again}")
    return merged[[*QUERY, "p", "valid"]].assign(variant=variant, p=merged["p"].astype(float))


def _baselines(cfg: DictConfig, truth: pd.DataFrame) -> list[pd.DataFrame]:
    """Return the image-blind baselines' predictions: position_only, and nearest_demonstration in seen scenes."""
    prior, demos, parts = read_position_prior(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos)), []
    for (user, n, seed, split), rows in truth.groupby(MODEL, observed=True, sort=False):
        z = rows[["z_x", "z_y"]].to_numpy()
        parts.append(rows.assign(variant=POSITION, p=baselines.position_only(prior[user], z)))
        if cfg.protocol.splits[split] is None:
            shape = (rows["scene"].nunique(), -1, 2)
            p = baselines.nearest_demonstration(*demo_arrays(demos, seed, user, n), z.reshape(shape))
            parts.append(rows.assign(variant=NEAREST, p=p.ravel()))
    columns = [*QUERY, "p", "valid", "variant"]
    return [table[columns] for table in sorted(parts, key=lambda rows: rows["variant"].iloc[0] != NEAREST)]


def _accuracies(predictions: pd.DataFrame, bins: int) -> pd.DataFrame:
    """Return the scores of every model and split; auroc is NaN if all labels are equal."""
    rows = []
    for key, group in predictions.groupby(["variant", *MODEL], observed=True, sort=False):
        p, valid = group["p"].to_numpy(), group["valid"].to_numpy()
        rows.append((*key, *_scores(p, valid, bins).values(), len(p)))
    return pd.DataFrame(rows, columns=["variant", *MODEL, "accuracy", "auroc", "brier", "ece", "bias", "count"])


def _scores(p: Float[Array, " query"], valid: Array, bins: int) -> dict[str, float]:
    return {
        "accuracy": accuracy(p, valid), "auroc": auroc(p, valid), "brier": brier(p, valid),
        "ece": expected_calibration_error(p, valid, bins), "bias": p.mean() - valid.mean(),
    }  # fmt: skip


def _summary(cfg: DictConfig, by_seed: pd.DataFrame, judged: pd.DataFrame) -> pd.DataFrame:
    """Return mean accuracy and quartiles over seeds by variant, split and number of demonstrations.

    At main_n_demos, splits shared by all seeds have a 95 % interval over seeds crossed with scenes.
    """
    shared = [split for split, pool in cfg.protocol.splits.items() if pool is not None]
    right = judged.assign(right=(judged["p"] > DECISION) == judged["valid"])
    right = right[(right["n_demos"] == cfg.main_n_demos) & right["split"].isin(shared)]
    rows = []
    for key, values in by_seed.iterrows():
        row = dict(zip(by_seed.index.names, key, strict=True)) | quartiles(values.to_numpy())
        row |= {"ci_low": np.nan, "ci_high": np.nan, "seeds": len(values)}
        if row["n_demos"] == cfg.main_n_demos and row["split"] in shared:
            questions = right[(right["variant"] == row["variant"]) & (right["split"] == row["split"])]
            interval = estimate(questions.pivot_table("right", "seed", "scene").to_numpy(dtype=float)[None])
            row |= {"ci_low": interval.ci_low[0], "ci_high": interval.ci_high[0]}
        rows.append(row)
    return pd.DataFrame(rows)


def _calibration(judged: pd.DataFrame, bins: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return reliability bins and scores by variant and split, over users and seeds; bias: mean p - share valid.

    Scores have quartiles over seeds, `_q1` and `_q3`.
    """
    tables, rows = [], []
    for (variant, split), group in judged.groupby(["variant", "split"], observed=True, sort=False):
        p, valid = group["p"].to_numpy(), group["valid"].to_numpy()
        table = reliability(p, valid, bins).query("count > 0")
        tables.append(table.assign(variant=variant, split=split))
        row = {"variant": variant, "split": split} | _scores(p, valid, bins)
        seeds = (part[["p", "valid"]].to_numpy(float).T for _, part in group.groupby("seed"))
        for name, values in pd.DataFrame([_scores(p, valid == 1, bins) for p, valid in seeds]).items():
            row |= {f"{name}_q1": values.quantile(0.25), f"{name}_q3": values.quantile(0.75)}
        rows.append(row)
    columns = ["variant", "split", "low", "high", "count", "confidence", "frequency"]
    scores = [f"{name}{end}" for name in ("ece", "brier", "bias", "auroc") for end in ("", "_q1", "_q3")]
    return pd.concat(tables, ignore_index=True)[columns], pd.DataFrame(rows)[["variant", "split", *scores]]


def _comparisons(cfg: DictConfig, by_seed: pd.DataFrame) -> pd.DataFrame:
    """Return the tests fixed in advance: exact paired Wilcoxon over seeds, Holm-corrected within each family."""
    rows = []
    for group in cfg.evaluate.comparisons:
        n = cfg.main_n_demos if group.n_demos is None else group.n_demos
        for against, split in product(group.against, group.splits):
            if {(group.variant, split, n), (against, split, n)} <= set(by_seed.index):
                a, b = (by_seed.loc[(variant, split, n)].to_numpy() for variant in (group.variant, against))
                rows.append(
                    {
                        "family": group.family, "variant": group.variant, "against": against, "split": split,
                        "n_demos": n, "mean": a.mean(), "mean_against": b.mean(), "difference": (a - b).mean(),
                        "q1": np.quantile(a - b, 0.25), "q3": np.quantile(a - b, 0.75), "p": paired_wilcoxon(a, b),
                        "seeds": len(a),
                    }
                )  # fmt: skip
    if not rows:  # one variant alone
        return pd.DataFrame(columns=COMPARED)
    table = pd.DataFrame(rows)
    table["p_holm"] = table.groupby("family")["p"].transform(lambda p: holm(p.to_numpy()))
    table["significant"] = table["p_holm"] < LEVEL
    return table[COMPARED]


def _convergence(cfg: DictConfig) -> pd.DataFrame:
    """Return the means over seeds and users, at main_n_demos, of each variant with a decoder (convergence.csv)."""
    rows = []
    for variant in cfg.variants:
        fits = read_table(model_dir(cfg, variant) / "convergence.csv")
        fits = fits[(fits["n_demos"] == cfg.main_n_demos) & fits["user"].isin(cfg.evaluate.users)]
        rows.append({"variant": variant} | {name: fits[name].mean() for name in CONVERGENCE})
    return pd.DataFrame(rows).dropna(ignore_index=True)


def _metrics(cfg: DictConfig, summary: pd.DataFrame, convergence: pd.DataFrame) -> dict:
    """Return the accuracies on HEADLINE, and of the paper's model also in training scenes, where the paper judges it.

    One image-blind baseline stands beside them. With one demonstration: SHOWN alone. The tables have all other numbers.
    """
    main, one = (summary[summary["n_demos"] == n] for n in (cfg.main_n_demos, 1))
    main = main[(main["split"] == HEADLINE) | ((main["variant"] == PAPER) & (main["split"] == SEEN))]
    nested = {v: dict(zip(rows["split"], rows["mean"], strict=True)) for v, rows in main.groupby("variant", sort=False)}
    one = one[(one["split"] == HEADLINE) & one["variant"].isin(SHOWN)]
    errors = convergence[convergence["variant"] == PAPER].set_index("variant")[CONVERGENCE[:1]]
    return {
        "accuracy": nested,
        "accuracy_one_demo": {row.variant: {HEADLINE: row.mean} for row in one.itertuples()},
        "convergence": errors.to_dict("index"),
    }


if __name__ == "__main__":
    launch(main, "evaluate")
