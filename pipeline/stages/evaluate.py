"""Stage evaluate: score every variant and the image-blind baselines on all queries, and compare variants."""

from collections import Counter
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import asked, demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import read_table, write_json, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, fitted_n_demos, model_dir
from pipeline.artifacts.scenes import read_position_prior, train_pool
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Count, Demonstrations, Group, Names, Some, need, need_some
from pipeline.stats.crossed import Items, estimate, quartiles
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error, reliability
from pipeline.stats.tests import LEVEL, MIN_PAIRS, SMALLEST_GAIN, holm, paired_wilcoxon, verdict

MODEL = ["user", "n_demos", "seed", "split"]
QUERY = [*MODEL, "scene", "query"]
COMPARED = [
    "family", "variant", "against", "split", "n_demos", "mean", "mean_against", "difference", "q1", "q3", "ci_low",
    "ci_high", "ci90_low", "ci90_high", "verdict", "p", "p_holm", "significant", "seeds",
]  # fmt: skip
CONVERGENCE = ["reconstruction_over_flat", "own_demonstrations", "passed"]
HEADLINE, SEEN = "new_items", "seen_scenes"  # splits of the headlines; HEADLINE has unseen items
INTERVALS = ["ci_low", "ci_high", "ci90_low", "ci90_high"]
PAPER, SHOWN = "full", ("full", "clearance")  # variants with more headlines than others
MAX_TESTS = 25  # with 10 seeds the smallest p is 2/1024: under Holm's correction more tests could never be significant


class Comparison(Group):
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
    groups, bins = predictions.groupby(["variant", *MODEL], observed=True, sort=False), cfg.evaluate.bins
    accuracies = pd.DataFrame(dict(zip(["variant", *MODEL], key, strict=True)) | _scores(x, bins) for key, x in groups)
    judged = predictions[predictions["user"].isin(cfg.evaluate.users)]
    scored = accuracies[accuracies["user"].isin(cfg.evaluate.users)]
    by_seed = scored.groupby(["variant", "split", "n_demos", "seed"], sort=False)["accuracy"].mean().unstack(sort=False)
    right = judged.assign(right=(judged["p"] > DECISION) == judged["valid"])
    by_scene = right.groupby(["variant", "split", "n_demos", "seed", "scene"], observed=True)["right"].mean()
    items = {HEADLINE: _items(cfg)}
    summary, convergence = _summary(cfg, by_seed, by_scene, items), _convergence(cfg)
    calibration, scores = _calibration(judged[judged["n_demos"] == cfg.main_n_demos], bins)
    write_table(out_dir / "accuracy.parquet", accuracies)
    write_table(out_dir / "accuracy.csv", summary)
    write_table(out_dir / "calibration.csv", calibration)
    write_table(out_dir / "scores.csv", scores)
    write_table(out_dir / "comparisons.csv", _comparisons(cfg, by_seed, by_scene, items))
    write_table(out_dir / "convergence.csv", convergence)
    write_json(out_dir / "metrics.json", _metrics(cfg, summary, convergence))


def _truth(cfg: DictConfig) -> pd.DataFrame:
    """Return all queries of every model with path [m] and label; InputError if a pool or user has none."""
    queries, parts = read_queries(Path(cfg.paths.demos)), []
    splits = cfg.protocol.splits.items()
    for user, n, seed, (split, shared) in product(cfg.users, cfg.n_demos, cfg.protocol.seeds, splits):
        z, valid = asked(queries, shared or train_pool(seed), user)
        scene, query = np.indices(valid.shape).reshape(2, -1)
        x, y = z.reshape(-1, 2).T
        part = {"scene": scene, "query": query, "valid": valid.ravel(), "z_x": x, "z_y": y}
        parts.append(pd.DataFrame(part).assign(user=user, n_demos=n, seed=seed, split=split))
    return pd.concat(parts, ignore_index=True).astype({"user": "category", "split": "category"})


def _predictions(cfg: DictConfig, variant: str, truth: pd.DataFrame) -> pd.DataFrame:
    """Return a variant's p of every query; InputError for the first model with missing or different queries."""
    path = model_dir(cfg, variant) / "predictions.parquet"
    table = read_table(path, PREDICTION_COLUMNS)
    truth = truth[truth["n_demos"].isin(fitted_n_demos(cfg, variant))]
    for name in ("user", "split"):
        table[name] = pd.Categorical(table[name], truth[name].cat.categories)
    merged = truth.merge(table, on=QUERY, how="left", suffixes=("", "_predicted"))
    wrong = ~merged["p"].between(0, 1) | (merged["valid"] != merged["valid_predicted"]) | merged.duplicated(QUERY)
    if wrong.any():
        first = "user {}, {} demonstrations, seed {}, split {}".format(*merged.loc[wrong.idxmax(), MODEL])
        again = f"run stage {cfg.variants[variant].stage} for {variant} again ({path})"
        expected = "expected each query's p in [0, 1] and label"
        raise InputError(f"{variant} lacks predictions, or has others, for {first}: {expected}; {again}")
    return merged[[*QUERY, "p", "valid"]].assign(variant=variant, p=merged["p"].astype(float))


def _baselines(cfg: DictConfig, truth: pd.DataFrame) -> list[pd.DataFrame]:
    """Return the image-blind baselines' predictions: nearest_demonstration in seen scenes, and position_only."""
    prior, demos = read_position_prior(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    nearest, position = [], []
    for (user, n, seed, split), rows in truth.groupby(MODEL, observed=True, sort=False):
        z, rows = rows[["z_x", "z_y"]].to_numpy(), rows[[*QUERY, "valid"]]
        position.append(rows.assign(variant=POSITION, p=baselines.position_only(prior[user], z)))
        if cfg.protocol.splits[split] is None:
            z = z.reshape(rows["scene"].nunique(), -1, 2)
            p = baselines.nearest_demonstration(*demo_arrays(demos, seed, user, n), z)
            nearest.append(rows.assign(variant=NEAREST, p=p.ravel()))
    return [*nearest, *position]


def _items(cfg: DictConfig) -> Items:
    """Return the unseen items that each scene of HEADLINE holds, (scene, item), by kind."""
    layouts = read_table(Path(cfg.paths.scenes) / "layouts.parquet")
    rows = layouts[layouts["pool"] == cfg.protocol.splits[HEADLINE]]
    kinds = rows.assign(kind=1 + rows["symbol"])
    return kinds.pivot_table("kind", "scene", "item", "max", fill_value=0).to_numpy(dtype=int)


def _scores(rows: pd.DataFrame, bins: int) -> dict[str, float]:
    """Return the scores of predictions; bias: mean p - share valid; auroc is NaN if all labels are equal."""
    p, valid = rows["p"].to_numpy(), rows["valid"].to_numpy()
    return {
        "accuracy": accuracy(p, valid), "auroc": auroc(p, valid), "brier": brier(p, valid),
        "ece": expected_calibration_error(p, valid, bins), "bias": p.mean() - valid.mean(), "count": len(p),
    }  # fmt: skip


def _summary(cfg: DictConfig, by_seed: pd.DataFrame, by_scene: pd.Series, items: Mapping[str, Items]) -> pd.DataFrame:
    """Return mean accuracy and quartiles over seeds by variant, split and number of demonstrations.

    At main_n_demos, splits shared by all seeds have a 95 % interval over seeds crossed with scenes, and `items` of a
    split if they are chance.
    """
    rows = []
    for key, values in by_seed.iterrows():
        row = dict(zip(by_seed.index.names, key, strict=True)) | quartiles(values.to_numpy())
        row |= {"ci_low": np.nan, "ci_high": np.nan, "seeds": len(values)}
        if row["n_demos"] == cfg.main_n_demos and cfg.protocol.splits[row["split"]] is not None:
            right = by_scene[row["variant"], row["split"], row["n_demos"]].unstack().to_numpy()
            interval = estimate(right[None], items=items.get(str(row["split"])))
            row |= {"ci_low": interval.ci_low[0], "ci_high": interval.ci_high[0]}
        rows.append(row)
    return pd.DataFrame(rows)


def _calibration(judged: pd.DataFrame, bins: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return reliability bins and scores by variant and split, over users and seeds; _q1, _q3: quartiles over seeds."""
    tables, rows = [], []
    for (variant, split), group in judged.groupby(["variant", "split"], observed=True, sort=False):
        table = reliability(group["p"].to_numpy(), group["valid"].to_numpy(), bins).query("count > 0")
        tables.append(table.assign(variant=variant, split=split))
        scores = _scores(group, bins)
        by_seed = pd.DataFrame([_scores(part, bins) for _, part in group.groupby("seed")])
        row = {"variant": variant, "split": split}
        for name in ("ece", "brier", "bias", "auroc"):
            q1, q3 = by_seed[name].quantile([0.25, 0.75])
            row |= {name: scores[name], f"{name}_q1": q1, f"{name}_q3": q3}
        rows.append(row)
    columns = ["variant", "split", "low", "high", "count", "confidence", "frequency"]
    return pd.concat(tables, ignore_index=True)[columns], pd.DataFrame(rows)


def _comparisons(
    cfg: DictConfig, by_seed: pd.DataFrame, by_scene: pd.Series, items: Mapping[str, Items]
) -> pd.DataFrame:
    """Return the tests fixed in advance: exact paired Wilcoxon over seeds, Holm-corrected within each family.

    ci_, ci90_: intervals of the mean difference, from MIN_PAIRS seeds: over seeds, crossed with scenes and `items` in
    splits shared by all seeds. verdict: on a difference of SMALLEST_GAIN. A difference in a shared split is significant
    only if its 95 % interval lies beyond 0, too, since the test takes scenes as certain.
    """
    rows = []
    for group in cfg.evaluate.comparisons:
        n = cfg.main_n_demos if group.n_demos is None else group.n_demos
        for against, split in product(group.against, group.splits):
            if {(group.variant, split, n), (against, split, n)} <= set(by_seed.index):
                a, b = (by_seed.loc[(variant, split, n)].to_numpy() for variant in (group.variant, against))
                row = [group.family, group.variant, against, split, n, a.mean(), b.mean(), (a - b).mean()]
                shared = cfg.protocol.splits[split] is not None
                effects = (a - b)[None, :]  # seeds alone are chance
                if shared:
                    sides = (by_scene[variant, split, n].unstack().to_numpy() for variant in (group.variant, against))
                    effects = np.subtract(*sides)
                ends = [np.nan] * len(INTERVALS)
                if len(a) >= MIN_PAIRS:
                    difference = estimate(effects[None], items=items.get(split))
                    ends = [getattr(difference, end)[0] for end in INTERVALS]
                row += [*np.quantile(a - b, [0.25, 0.75]), *ends, verdict(*ends, smallest=SMALLEST_GAIN)]
                rows.append([*row, paired_wilcoxon(a, b), len(a)])
    table = pd.DataFrame(rows, columns=[name for name in COMPARED if name not in ("p_holm", "significant")])
    table["p_holm"] = table.groupby("family")["p"].transform(lambda p: holm(p.to_numpy()))
    shared = table["split"].map(dict(cfg.protocol.splits)).notna()
    certain = (table["ci_low"] > 0) | (table["ci_high"] < 0)
    table["significant"] = (table["p_holm"] < LEVEL) & (certain | ~shared)
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
    many, one = {}, {}
    for row in summary.itertuples():
        headline = row.split == HEADLINE
        if row.n_demos == cfg.main_n_demos and (headline or (row.variant, row.split) == (PAPER, SEEN)):
            many.setdefault(row.variant, {})[row.split] = row.mean
        if row.n_demos == 1 and headline and row.variant in SHOWN:
            one[row.variant] = {HEADLINE: row.mean}
    errors = convergence[convergence["variant"] == PAPER].set_index("variant")[CONVERGENCE[:1]]
    return {"accuracy": many, "accuracy_one_demo": one, "convergence": errors.to_dict("index")}


if __name__ == "__main__":
    launch(main, "evaluate")
