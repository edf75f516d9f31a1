"""Stage solutions: ask whether users' valid paths cluster, whether models find their overlap, and how samples vary."""

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from scipy.stats import t as student

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.baselines import POSITION, position_only
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import Estimates, estimate, linearised
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import P_F, P_INIT, lattice, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins, valid
from studies.solutions.clusters import MEASURES, SAME_TABLE, Paths, best_accuracy, measures, nearest_label, routes

HOLDS, FAILS, OPEN = "holds", "fails", "open"
INTERVAL = ["mean", "ci_low", "ci_high"]
TRUTH, RANDOM, TYPICAL = "truth", "random_path", "training_mean"  # sources beside variants and the position prior
Sets = Bool[Array, "user seed scene path"]  # paths that a source calls valid; one seed where all seeds agree


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write clusters.csv, shown.csv, overlap.csv, overlap_scenes.csv, sampling.csv and verdicts.csv."""
    study, users, seeds = cfg.studies.solutions, list(cfg.users), list(cfg.protocol.seeds)
    fitted = cfg.copy()
    fitted.variants = {variant: cfg.variants[variant] for variant in study.variants}
    check_weights(fitted)
    scenes, prior = read_scenes(Path(cfg.paths.scenes)), read_position_prior(Path(cfg.paths.scenes))
    pool, training = cfg.protocol.splits[study.split], [train_pool(seed) for seed in seeds]
    scenes.check_has(pool, *training)

    # Clusters: the demonstrations are the truth, no model takes part.
    cells = lattice(len(prior[users[0]]))
    before = np.stack([true_sets(cfg, scenes.layouts[name], cells) for name in training], axis=1)  # (user, seed, ...)
    demos = read_demos(Path(cfg.paths.demos))
    clusters, shown = cluster_tables(cfg, demos, before, np.stack([prior[user].ravel() for user in users]))
    write_table(out_dir / "clusters.csv", clusters)
    write_table(out_dir / "shown.csv", shown)

    # Overlap and samples: the same random paths in new scenes for every source.
    layouts = scenes.layouts[pool]
    z_theta = random_z_theta(stream(study.root_seed, "candidates"), len(layouts), study.candidates)
    truth = true_sets(cfg, layouts, z_theta)[:, None]
    p = predict_all(fitted, users, scenes.images[pool], z_theta, "solutions")
    sets = {variant: p[variant] > DECISION for variant in study.variants}
    sets[POSITION] = np.stack([position_only(prior[user], z_theta) for user in users])[:, None] > DECISION
    overlap, by_scene, gains = overlap_tables(users, sets, truth, before)
    sets |= {RANDOM: np.ones_like(truth), TRUTH: truth}
    sampling, sample_gains = sampling_table(cfg, layouts, z_theta, sets, truth)
    write_table(out_dir / "overlap.csv", overlap)
    write_table(out_dir / "overlap_scenes.csv", by_scene)
    write_table(out_dir / "sampling.csv", sampling)
    write_table(out_dir / "verdicts.csv", verdicts(clusters, gains | sample_gains))


def true_sets(
    cfg: DictConfig, layouts: Layouts, z_theta: Float[Array, "*scene path 2"]
) -> Bool[Array, "user scene path"]:
    """Return which paths are truly valid to each user; without a dimension for scenes, the same paths in each."""
    paths = np.broadcast_to(z_theta, (len(layouts), *z_theta.shape[-2:]))
    return np.stack([valid(layouts, paths, margins) for margins in cfg.users.values()])


def cluster_tables(
    cfg: DictConfig,
    demos: pd.DataFrame,
    training: Bool[Array, "user seed scene cell"],
    prior: Float[Array, "user cell"],
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return a row per measure, with its 95 % interval over seeds and p, and the valid paths of the first seed.

    prior: validity averaged over scenes. The last two rows are a perfect clusterer's: of z_theta alone, and of z_theta
    with the table known.
    """
    study, users, by_seed, shown = cfg.studies.solutions, list(cfg.users), [], []
    for seed in cfg.protocol.seeds:
        rng = stream(study.root_seed, "permutations", seed)
        mine = demos[(demos["seed"] == seed) & demos["user"].isin(users)].sort_values("scene")
        valid_to = mine[mine["valid"]]
        by_user = measures(paths_of(valid_to, users), study.neighbours, rng, study.permutations)
        labels = [
            nearest_label(*demo_arrays(demos, seed, u, cfg.demos.per_scene), rng, study.permutations)
            for u in cfg.evaluate.users
        ]
        by_seed.append(np.column_stack([by_user, np.mean(labels, axis=0)]))
        shown.append(valid_to[["user", "z_x", "z_y"]])
    values = np.stack(by_seed)  # (seed, draw, measure)
    mean = values.mean(0)
    p = (1 + (mean[1:] >= mean[0]).sum(0)) / (study.permutations + 1)
    rows = [
        {"measure": name} | over_seeds(values[:, 0, i]) | {"chance": mean[1:, i].mean(), "p": p[i]}
        for i, name in enumerate((*MEASURES, SAME_TABLE))
    ]
    tables = [best_accuracy(training[:, i].astype(float)) for i in range(len(cfg.protocol.seeds))]
    perfect = {"position": [best_accuracy(prior)] * len(tables), "table known": tables}
    chance = {"chance": 1 / len(users)}
    rows += [{"measure": f"perfect, {name}"} | over_seeds(np.array(x)) | chance for name, x in perfect.items()]
    return pd.DataFrame(rows), shown[0]


def paths_of(demos: pd.DataFrame, users: list[str]) -> Paths:
    """Return the demonstrations, sorted by scene, with users as numbers."""
    user = pd.Categorical(demos["user"], users).codes.astype(int)
    return Paths(demos[["z_x", "z_y"]].to_numpy(), demos["scene"].to_numpy(), user)


def over_seeds(values: Float[Array, " seed"]) -> dict[str, float]:
    """Return the mean and Student's 95 % interval over seeds."""
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return {"mean": values.mean(), "ci_low": values.mean() - half, "ci_high": values.mean() + half}


def jaccard(a: Bool[Array, "*set path"], b: Bool[Array, "*set path"]) -> Float[Array, "*set"]:
    """Return the intersection over the union of two sets of paths; 0 if both are empty."""
    return (a & b).sum(-1) / np.maximum((a | b).sum(-1), 1)


def overlap_tables(
    users: list[str], sets: Mapping[str, Sets], truth: Sets, training: Bool[Array, "user seed scene cell"]
) -> tuple[pd.DataFrame, pd.DataFrame, dict[tuple[str, str], Estimates]]:
    """Return each source's error of the overlap of two users' valid sets, the overlaps by scene, and the gains.

    The blind guess TYPICAL is a seed's mean true overlap in its training scenes. A gain is the decrease of the error by
    a variant, averaged over pairs of users, against that guess.
    """
    rows, scenes, errors = [], [], {}
    for i, j in combinations(range(len(users)), 2):
        true = jaccard(truth[i], truth[j])  # (1, scene)
        typical = jaccard(training[i], training[j]).mean(-1, keepdims=True)  # (seed, 1)
        overlaps = {source: jaccard(x[i], x[j]) for source, x in sets.items()} | {TYPICAL: typical}
        for source, overlap in overlaps.items():
            overlap = np.broadcast_to(overlap, (len(typical), true.shape[1]))
            error, r = np.abs(overlap - true), np.nan_to_num([correlation(x, true[0]) for x in overlap])
            errors.setdefault(source, []).append(error)
            row = {"variant": source, "first": users[i], "second": users[j], "truth": true.mean()}
            interval = estimate(error[None])
            row |= {"overlap": overlap.mean(), "error": error.mean(), "ci_low": interval.ci_low[0]}
            rows.append(row | {"ci_high": interval.ci_high[0], "correlation": r.mean()})
            part = {"variant": source, "first": users[i], "second": users[j], "scene": range(true.shape[1])}
            scenes.append(pd.DataFrame(part | {"truth": true[0], "overlap": overlap.mean(0)}))
    blind = np.mean(errors.pop(TYPICAL), axis=0)
    gains = {("overlap", v): estimate((blind - np.mean(x, axis=0))[None]) for v, x in errors.items() if v != POSITION}
    return pd.DataFrame(rows), pd.concat(scenes, ignore_index=True), gains


def correlation(a: Float[Array, " scene"], b: Float[Array, " scene"]) -> float:
    """Return Pearson's correlation; NaN if either is constant, up to rounding."""
    return float(np.corrcoef(a, b)[0, 1]) if min(np.ptp(a), np.ptp(b)) > 1e-9 else np.nan


def sampling_table(
    cfg: DictConfig, layouts: Layouts, z_theta: Float[Array, "scene path 2"], sets: Mapping[str, Sets], truth: Sets
) -> tuple[pd.DataFrame, dict[tuple[str, str], Estimates]]:
    """Return the share of valid samples and of routes found, by source and user, and the gains.

    A sample is one of the first `draws` candidates that a source accepts. A gain is against the position prior, the
    mean over users. Users to whom every path is valid are left out: they have one route.
    """
    users, draws, seeds = list(cfg.users), cfg.studies.solutions.draws, len(cfg.protocol.seeds)
    rows, scores = [], {}
    for user in cfg.evaluate.users:
        u = users.index(user)
        sides = left_of_items(layouts, z_theta, cfg.users[user])
        all_routes = routes(sides, truth[u, 0])  # (scene,)
        for source, accepted in sets.items():
            samples = accepted[u] & (accepted[u].cumsum(-1) <= draws)  # (seed, scene, path)
            good = samples & truth[u]
            found = routes(sides, good)  # (seed, scene)
            counts = {"valid": (good.sum(-1), samples.sum(-1)), "routes": (found, np.tile(all_routes, (len(found), 1)))}
            row: dict[str, object] = {"variant": source, "user": user}
            for measure, pair in counts.items():
                each = linearised(*(np.broadcast_to(x, (1, seeds, len(layouts))).astype(float) for x in pair))
                scores.setdefault((measure, source), []).append(each)
                interval = estimate(each)
                row |= {measure: interval.effect[0], f"{measure}_low": interval.ci_low[0]}
                row[f"{measure}_high"] = interval.ci_high[0]
            rows.append(row | {"routes_found": found.mean(), "routes_all": all_routes.mean()})
    means = {key: np.mean(each, axis=0) for key, each in scores.items()}
    gains = {(m, v): estimate(x - means[m, POSITION]) for (m, v), x in means.items() if v in cfg.variants}
    return pd.DataFrame(rows), gains


def left_of_items(
    layouts: Layouts, z_theta: Float[Array, "scene path 2"], margins: Margins
) -> Bool[Array, "scene path slot"]:
    """Return whether each path leaves the centre of each item that the user avoids on its left; else False.

    In barycentric coordinates of the triangle P_INIT, z_theta, P_F the path is z**2 = 4 * init * f, so a point lies
    between it and the straight line if z**2 < 4 * init * f.
    """
    chord = P_F - P_INIT
    across = np.array([-chord[1], chord[0]])  # to the left of the straight line
    (c_along, c_left), (z_along, z_left) = (
        ((x - P_INIT) @ chord / (chord @ chord), (x - P_INIT) @ across)
        for x in (layouts.centre[:, None], z_theta[:, :, None])
    )
    z = c_left / np.where(z_left == 0, np.finfo(float).tiny, z_left)  # (scene, path, slot)
    f = c_along - z * z_along
    between = (z > 0) & (f > 0) & (1 - z - f > 0) & (z**2 < 4 * f * (1 - z - f))
    avoided = np.array([margins[symbol] is not None for symbol in SYMBOLS] + [False])[layouts.symbol]
    return ((c_left > 0) ^ between) & avoided[:, None]


def verdicts(clusters: pd.DataFrame, gains: Mapping[tuple[str, str], Estimates]) -> pd.DataFrame:
    """Return a verdict on each measure of the first variant: `ours` with its interval must lie above `bar`."""
    table = clusters.set_index("measure")
    near, silhouette, perfect = (table.loc[name] for name in (MEASURES[0], MEASURES[2], "perfect, position"))
    same = table.loc[SAME_TABLE]
    rows = [
        ("clusters in a table", SAME_TABLE, same["chance"], *same[INTERVAL], True),
        ("clusters by user", "user named", near["chance"], *near[INTERVAL], bool(perfect["mean"] > near["chance"])),
        (
            "clusters by user",
            "silhouette",
            0.0,
            *silhouette[INTERVAL],
            False,
        ),  # true demonstrations: no model can do better
    ]
    measured = list(dict.fromkeys(measure for measure, _ in gains))
    first = next(iter(gains))[1]
    for measure in measured:
        ours, *others = (gain for (name, _), gain in gains.items() if name == measure)
        claim = "overlap" if measure == "overlap" else "varied samples"
        interval = ours.effect[0], ours.ci_low[0], ours.ci_high[0]
        rows.append((claim, f"gain in {measure}", 0.0, *interval, any(x.ci_low[0] > 0 for x in others)))
    frame = pd.DataFrame(rows, columns=["claim", "measure", "bar", "ours", "ci_low", "ci_high", "reachable"])
    return frame.assign(
        variant=first, verdict=[judge(*row) for row in frame[["bar", "ci_low", "ci_high", "reachable"]].to_numpy()]
    )


def judge(bar: float, low: float, high: float, reachable: bool) -> str:
    """Return the verdict: the interval lies above the bar, or below one that can be reached, else it is open."""
    return HOLDS if low > bar else FAILS if high < bar and reachable else OPEN


if __name__ == "__main__":
    launch(main, "solutions")
