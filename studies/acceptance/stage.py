"""Stage acceptance: accept paths by conformal selection and by a fixed threshold, and count the invalid ones.

Conformal selection fits each model to part of its seed's training scenes and calibrates it in the others. The fixed
threshold, P(valid) > 1/2, uses a model fitted to all of them. All query paths of a split are the candidates of one
selection; a model that accepts none has an invalid share of 0.
"""

from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.demos import Queries, demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import POSITION, position_only
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.conformal import accept, p_values, score, share_by_scene
from pipeline.stats.crossed import estimate
from pipeline.stats.scores import DECISION
from pipeline.training.refit import TrainingSet, refit

RULES = CONFORMAL, THRESHOLD = "conformal", "threshold"
ALL = "all"  # in column `user` of summary.csv
TOLERANCE = 1e-12  # numerical tolerance when a share is compared with the level


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write summary.csv and curve.csv."""
    study, users, seeds = cfg.studies.acceptance, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    pairs = list(product(users, seeds))
    complete, queries = read_inputs(cfg, pairs)
    images = np.concatenate([images for images, _ in queries.values()])
    z_theta = np.concatenate([q.z for _, q in queries.values()])

    # Two models per user and seed: one of some scenes, for conformal selection, and one of all, for the threshold.
    fitted = {seed: choose_scenes(cfg, seed) for seed in seeds}
    training_sets = [part_of(complete[pair], fitted[pair[1]]) for pair in pairs] + [complete[pair] for pair in pairs]
    answers = refit(
        cfg, dict.fromkeys(study.variants, training_sets), partial(predict, complete, images, z_theta), "accept"
    )

    prior = read_position_prior(Path(cfg.paths.scenes))
    blind = [
        (position_only(prior[user], complete[user, seed].z_theta), position_only(prior[user], z_theta))
        for user, seed in pairs
    ]
    answers[POSITION] = 2 * blind  # fitted to no demonstrations

    summary, curve = [], []
    for variant, predictions in answers.items():
        of_some, of_all = predictions[: len(pairs)], predictions[len(pairs) :]
        end = 0
        for split, (_, q) in queries.items():
            paths = slice(end, end := end + len(q.z))
            conformal = [
                accept_conformally(complete[pair], fitted[pair[1]], p_demos, p_paths[paths], study.levels)
                for pair, (p_demos, p_paths) in zip(pairs, of_some, strict=True)
            ]
            threshold = [[p_paths[paths] > DECISION] * len(study.levels) for _, p_paths in of_all]
            valid = np.stack([q.valid[user] for user in users])  # (user, scene, path)
            for rule, accepted in ((CONFORMAL, conformal), (THRESHOLD, threshold)):
                choices = np.reshape(accepted, (len(users), len(seeds), len(study.levels), *valid.shape[1:]))
                outcome, names = count_outcome(choices, valid), {"variant": variant, "split": split, "rule": rule}
                curve.append(pd.DataFrame(names | curve_columns(outcome, study.levels)))
                summary += [names | row for row in summary_rows(outcome, study.level, study.levels, users)]
    write_table(out_dir / "curve.csv", pd.concat(curve, ignore_index=True))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))


def read_inputs(
    cfg: DictConfig, pairs: Sequence[tuple[str, int]]
) -> tuple[dict[tuple[str, int], TrainingSet], dict[str, tuple[np.ndarray, Queries]]]:
    """Return each user's and seed's demonstrations, and images and queries of the splits that all seeds share.

    InputError if a pool is missing, or if a seed's number of training scenes is not scenes.per_seed.
    """
    scenes, demos = read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))
    queries, splits = read_queries(Path(cfg.paths.demos)), {s: pool for s, pool in cfg.protocol.splits.items() if pool}
    scenes.check_has(*map(train_pool, cfg.protocol.seeds), *splits.values())
    complete = {}
    for user, seed in pairs:
        images = scenes.images[train_pool(seed)]
        if len(images) != cfg.scenes.per_seed:
            raise InputError(
                f"{len(images)} scenes {train_pool(seed)}: expected {cfg.scenes.per_seed}; run the scenes stage again"
            )
        complete[user, seed] = TrainingSet(user, seed, images, *demo_arrays(demos, seed, user, cfg.main_n_demos))
    return complete, {split: (scenes.images[pool], queries[pool]) for split, pool in splits.items()}


def choose_scenes(cfg: DictConfig, seed: int) -> np.ndarray:
    """Draw the training scenes that a seed's models are fitted to; the same for every user and variant."""
    rng = stream(cfg.studies.acceptance.root_seed, "scenes", seed)
    return np.sort(rng.permutation(cfg.scenes.per_seed)[: cfg.studies.acceptance.fitted])


def part_of(complete: TrainingSet, scenes: np.ndarray) -> TrainingSet:
    """Return the demonstrations in these scenes."""
    return TrainingSet(
        complete.user, complete.seed, complete.images[scenes], complete.z_theta[scenes], complete.valid[scenes]
    )


def predict(
    complete: dict[tuple[str, int], TrainingSet],
    images: np.ndarray,
    z_theta: np.ndarray,
    model: ValidityModel,
    training_set: TrainingSet,
) -> tuple[np.ndarray, np.ndarray]:
    """Return P(valid) of the demonstrations (scene, demo) of the model's user and seed, and of the query paths."""
    demos = complete[training_set.user, training_set.seed]
    return model.probability(demos.images, demos.z_theta), model.probability(images, z_theta)


def accept_conformally(
    complete: TrainingSet, fitted: np.ndarray, p_demos: np.ndarray, p_paths: np.ndarray, levels: Sequence[float]
) -> list[np.ndarray]:
    """Return which paths (scene, path) are accepted at each level, calibrated in the scenes that were not fitted."""
    held_out = np.setdiff1d(np.arange(len(p_demos)), fitted)
    labels = complete.valid[held_out].ravel()
    p = p_values(score(p_demos[held_out].ravel()), labels, score(p_paths.ravel()))
    return [accept(p, level).reshape(p_paths.shape) for level in levels]


def count_outcome(accepted: np.ndarray, valid: np.ndarray) -> dict[str, np.ndarray]:
    """Return the outcome of selections (user, seed, level, scene, path); each value is (user, seed, level, scene).

    invalid: share of invalid paths among the accepted ones, and power: share of valid paths that are accepted, both
    by `share_by_scene`; count: number of accepted paths.
    """
    truth = np.broadcast_to(valid[:, None, None], accepted.shape)
    count, correct = accepted.sum(-1), (accepted & truth).sum(-1)
    return {
        "invalid": share_by_scene(count - correct, count),
        "power": share_by_scene(correct, truth.sum(-1)),
        "count": count,
    }


def curve_columns(outcome: dict[str, np.ndarray], levels: Sequence[float]) -> dict[str, object]:
    """Return means over users at each level, with 95 % intervals over seeds and scenes."""
    columns: dict[str, object] = {"level": list(levels)}
    for name, prefix, values in (("invalid", "", outcome["invalid"]), ("power", "power_", outcome["power"])):
        e = estimate(np.moveaxis(values.mean(0), 1, 0))  # (level, seed, scene)
        columns |= {name: e.effect, f"{prefix}ci_low": e.ci_low.clip(0, 1), f"{prefix}ci_high": e.ci_high.clip(0, 1)}
    return columns | {"abstained": (outcome["count"].sum(-1) == 0).mean((0, 1))}


def summary_rows(outcome: dict[str, np.ndarray], level: float, levels: Sequence[float], users: list[str]) -> list[dict]:
    """Return one row for all users together and one per user, at the promised level.

    invalid (with q1 and q3 over models) and power as in `count_outcome`; accepted: paths per model; above: number of
    models whose share of invalid paths exceeds the level; abstained: number of models that accept nothing;
    invalid_where_any: mean over the other models.
    """
    at_level = {name: values[:, :, list(levels).index(level)] for name, values in outcome.items()}
    rows = []
    for user, chosen in [(ALL, slice(None)), *((user, slice(i, i + 1)) for i, user in enumerate(users))]:
        invalid, power, count = (at_level[name][chosen] for name in ("invalid", "power", "count"))
        by_model, accepts = invalid.mean(-1), count.sum(-1) > 0
        e = estimate(invalid.mean(0)[None])
        q1, q3 = np.quantile(by_model, (0.25, 0.75))
        rows.append(
            {
                "user": user,
                "level": level,
                "invalid": e.effect[0],
                "ci_low": max(e.ci_low[0], 0.0),
                "ci_high": min(e.ci_high[0], 1.0),
                "q1": q1,
                "q3": q3,
                "power": power.mean(),
                "accepted": count.sum(-1).mean(),
                "above": int((by_model > level + TOLERANCE).sum()),
                "abstained": int((~accepts).sum()),
                "models": by_model.size,
                "invalid_where_any": by_model[accepts].mean() if accepts.any() else np.nan,
            }
        )
    return rows


if __name__ == "__main__":
    launch(main, "acceptance")
