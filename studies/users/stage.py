"""Stage users: whose paths are these, and do users' solutions cluster, overlap and vary in z_theta, as the paper says?

Whose paths: all variants, an image-blind baseline and an ideal observer name the user behind labelled paths in new
scenes. Clusters: demonstrations alone, no model takes part. Overlap and samples: the same random paths in new scenes
for the paper's model, the clearance model and image-blind guesses.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from scipy.spatial.distance import cdist
from scipy.stats import entropy
from sklearn.metrics import mutual_info_score

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import SceneSet, read_position_prior, read_scenes, train_pool
from pipeline.causal.identify import identify
from pipeline.launch import launch
from pipeline.models.base import to_tensor
from pipeline.models.baselines import NEAREST, POSITION, nearest_demonstration, position_only
from pipeline.models.trained import check_weights, load_model, predict_all
from pipeline.runtime.settings import Count, SharedSplit, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import Estimates, Items, estimate, items_held, linearised
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import P_F, P_INIT, lattice, random_z_theta
from pipeline.world.catalogue import random_scenes
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts
from pipeline.world.render import ImageSource, read_palette, render_scenes
from pipeline.world.rules import Margins, valid

IDEAL, TRUTH, RANDOM, TYPICAL = "ideal", "truth", "random_path", "training_mean"  # beside variants and POSITION
KNOWN, CERTAIN_FLOOR = (POSITION, IDEAL), 1e-6  # whose probabilities are known, not learned, and their clipping
MEASURES = "nearest neighbours", "silhouette"  # of clusters by user
SAME_TABLE = "nearest label"  # the measure of clusters of valid and invalid paths
HOLDS, FAILS, OPEN = "holds", "fails", "open"
CODED, BINS, LEVELS = 500, 10, 5  # scenes whose codes are measured; bins of a dimension, of an item's coordinate

Sets = Bool[Array, "user seed scene path"]  # paths that a source calls valid; one seed where all seeds agree


class Settings(StudyGroup):
    split: SharedSplit
    paths: Count
    draws: Count
    paths_seed: Whole

    root_seed: Whole
    neighbours: Count
    permutations: Count
    candidates: Count
    samples: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require several users, the two models that are compared, and numbers of paths that there are."""
    name, users = "studies.users", parameters.users
    need(len(users) > 1, "users", list(users), "at least two, to tell one from the other")
    both, variants = {"full", "clearance"}, list(parameters.variants)
    need(both <= set(variants), "variants", variants, f"full and clearance among them: {name} is about them")
    most = f"at most {name}.candidates = {study.candidates}"
    need(study.samples <= study.candidates, f"{name}.samples", study.samples, most)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write curve.csv and training.csv of whose paths they are, and the claims' tables.

    These are clusters.csv, overlap.csv, sampling.csv, verdicts.csv and codes.csv.
    """
    check_weights(cfg)
    study, users, seeds = cfg.studies.users, list(cfg.users), list(cfg.protocol.seeds)
    scenes, prior = read_scenes(Path(cfg.paths.scenes)), read_position_prior(Path(cfg.paths.scenes))
    pool, training = cfg.protocol.splits[study.split], [train_pool(seed) for seed in seeds]
    scenes.check_has(pool, *training)
    images, layouts = scenes.images[pool], scenes.layouts[pool]

    # Whose paths are they?
    held = items_held(layouts.item, layouts.symbol)
    right = named(cfg, images, layouts, prior, stream(study.paths_seed, "identify"))
    curves = [by_path(variant, each.mean(0), held) for variant, each in right.items()]
    write_table(out_dir / "curve.csv", pd.concat(curves, ignore_index=True))
    demos = read_demos(Path(cfg.paths.demos))
    write_table(out_dir / "training.csv", training_table(cfg, scenes, prior, demos))

    # Clusters: the demonstrations are the truth.
    cells = lattice(len(prior[users[0]]))
    before = np.stack([true_sets(cfg, scenes.layouts[name], cells) for name in training], axis=1)  # (user, seed, ...)
    clusters = cluster_tables(cfg, demos, before, np.stack([prior[user].ravel() for user in users]))
    write_table(out_dir / "clusters.csv", clusters)

    # Overlap and samples: by the paper's model, and by the clearance model, which shows what can be reached.
    fitted = cfg.copy()
    fitted.variants = {v: s for v, s in cfg.variants.items() if s.compared and s.stage != "irl"}
    z_theta = random_z_theta(stream(study.root_seed, "candidates"), len(layouts), study.candidates)
    truth = true_sets(cfg, layouts, z_theta)[:, None]
    sets = {v: p > DECISION for v, p in predict_all(fitted, users, images, z_theta, "overlap").items()}
    sets[POSITION] = np.stack([position_only(prior[user], z_theta) for user in users])[:, None] > DECISION
    overlap, gains = overlap_tables(users, sets, truth, before, held)
    sets |= {RANDOM: np.ones_like(truth), TRUTH: truth}
    sampling, sample_gains = sampling_table(cfg, layouts, z_theta, sets, truth, held)
    write_table(out_dir / "overlap.csv", overlap)
    write_table(out_dir / "sampling.csv", sampling)
    write_table(out_dir / "verdicts.csv", verdicts(clusters, gains | sample_gains))
    write_table(out_dir / "codes.csv", codes_table(cfg))


def true_sets(cfg: DictConfig, layouts: Layouts, z_theta: Float[Array, "*b path 2"]) -> Bool[Array, "user scene path"]:
    """Return which paths are truly valid to each user; without a dimension for scenes, the same paths in each."""
    paths = np.broadcast_to(z_theta, (len(layouts), *z_theta.shape[-2:]))
    return np.stack([valid(layouts, paths, margins) for margins in cfg.users.values()])


# Whose paths are they?


def named(
    cfg: DictConfig,
    images: UInt8[Array, "scene 100 100 3"],
    layouts: Layouts,
    prior: Mapping[str, Array],
    rng: np.random.Generator,
    shown: Sequence[tuple[Array, Array]] = (),
) -> dict[str, Float[Array, "user path seed scene"]]:
    """Return how often each observer names the user after 1, 2, ... random paths, labelled by that user's rule.

    shown: each user's demonstrations in these scenes, for the nearest of them.
    """
    study, users = cfg.studies.users, list(cfg.users)
    z_theta = random_z_theta(rng, len(layouts), study.draws * study.paths)
    labels = true_sets(cfg, layouts, z_theta)
    p = predict_all(cfg, users, images, z_theta, "identification")
    p[POSITION] = np.stack([position_only(prior[user], z_theta) for user in users])[:, None]
    p[IDEAL] = labels[:, None].astype(float)
    if shown:
        p[NEAREST] = np.stack([nearest_demonstration(*of_user, z_theta) for of_user in shown])[:, None]
    # After Laplace, the n labels that a model was fitted to support no more certainty than (n + 1) / (n + 2).
    learned_floor, draws = 1 / (cfg.scenes.per_seed * cfg.main_n_demos + 2), (study.draws, study.paths)
    floor = {name: CERTAIN_FLOOR if name in KNOWN else learned_floor for name in p}
    labels = labels.reshape(*labels.shape[:-1], *draws)
    return {name: identify(x.reshape(*x.shape[:-1], *draws), labels, floor[name]) for name, x in p.items()}


def training_table(cfg: DictConfig, scenes: SceneSet, prior: Mapping[str, Array], demos: pd.DataFrame) -> pd.DataFrame:
    """Return who is named by further paths of the tables that each model was fitted to, by the number of paths."""
    right = dict[str, list[Array]]()
    for seed in cfg.protocol.seeds:
        of_seed, pool = cfg.copy(), train_pool(seed)
        of_seed.protocol.seeds = [seed]
        rng = stream(cfg.studies.users.paths_seed, "held out", seed)
        shown = [demo_arrays(demos, seed, user, cfg.main_n_demos) for user in cfg.users]
        for variant, each in named(of_seed, scenes.images[pool], scenes.layouts[pool], prior, rng, shown).items():
            right.setdefault(variant, []).append(each.mean((0, 2, 3)))
    curves = [by_path(v, np.stack(of, axis=-1)[:, None]) for v, of in right.items()]
    return pd.concat(curves, ignore_index=True)  # intervals are over training sets


def by_path(variant: str, right: Float[Array, "path seed scene"], items: Items = None) -> pd.DataFrame:
    """Return a row for each number k of paths: the share of users named, with its 95 % interval within [0, 1]."""
    e, key = estimate(right, items=items), {"variant": variant, "k": 1 + np.arange(len(right))}
    return pd.DataFrame(key | {"accuracy": e.effect, "ci_low": e.ci_low.clip(0, 1), "ci_high": e.ci_high.clip(0, 1)})


# Clusters


def cluster_tables(
    cfg: DictConfig, demos: pd.DataFrame, training: Sets, prior: Float[Array, "user path"]
) -> pd.DataFrame:
    """Return a row per measure, with its 95 % interval over seeds and p.

    training: validity of z_theta on a lattice; prior: its mean over scenes. The last two rows are those of a perfect
    clusterer: of z_theta alone, and of z_theta with the table known.
    """
    study, users, by_seed = cfg.studies.users, list(cfg.users), []
    for seed in cfg.protocol.seeds:
        rng = stream(study.root_seed, "permutations", seed)
        own = demos[(demos["seed"] == seed) & demos["user"].isin(users)].sort_values("scene")
        own = own[own["valid"]]
        z_theta, scene = own[["z_x", "z_y"]].to_numpy(), own["scene"].to_numpy()
        number = pd.Categorical(own["user"], users).codes.astype(int)
        by_user = measures(z_theta, scene, number, study.neighbours, rng, study.permutations)
        arrays = [demo_arrays(demos, seed, user, cfg.demos.per_scene) for user in cfg.evaluate.users]
        labels = [nearest_label(*of_user, rng, study.permutations) for of_user in arrays]
        by_seed.append(np.column_stack([by_user, np.mean(labels, axis=0)]))
    values = np.stack(by_seed)  # (seed, draw, measure); draw 0: as shown
    shuffled, actual = values.mean(0)[1:], values.mean(0)[0]
    p = (1 + (shuffled >= actual).sum(0)) / (study.permutations + 1)
    table = over_seeds([*MEASURES, SAME_TABLE], values[:, 0]).assign(chance=shuffled.mean(0), p=p)
    perfect = [(best_accuracy(prior), best_accuracy(of_seed.astype(float))) for of_seed in training.swapaxes(0, 1)]
    perfect = over_seeds(["perfect, position", "perfect, table known"], np.array(perfect))
    return pd.concat([table, perfect.assign(chance=1 / len(users))], ignore_index=True)


def over_seeds(names: list[str], values: Float[Array, "seed measure"]) -> pd.DataFrame:
    """Return the mean of each measure with Student's 95 % interval over seeds."""
    e = estimate(values.T[:, None])
    return pd.DataFrame({"measure": names, "mean": e.effect, "ci_low": e.ci_low, "ci_high": e.ci_high})


def measures(
    z_theta: Float[Array, "path 2"],
    scene: Int[Array, " path"],
    user: Int[Array, " path"],
    neighbours: int,
    rng: np.random.Generator,
    permutations: int,
) -> Float[Array, "draw measure"]:
    """Return MEASURES of valid paths, sorted by scene (draw 0), and after permutations of the users within each scene.

    user: a number from 0. Each user weighs the same, whatever its number of paths. Silhouette after Rousseeuw (1987).
    """
    distances = cdist(z_theta, z_theta)
    near = np.argsort(np.where(scene[:, None] == scene, np.inf, distances), axis=1, kind="stable")[:, :neighbours]
    orders = [np.arange(len(scene)), *(np.lexsort((rng.random(len(scene)), scene)) for _ in range(permutations))]
    rows = []
    for order in orders:
        drawn = user[order]
        member = np.eye(user.max() + 1)[drawn]  # (path, user)
        count, away = member.sum(0), distances @ member
        guess = (member[near].sum(1) / count).argmax(1)
        recall = np.mean([(guess[drawn == u] == u).mean() for u in np.unique(drawn)])
        within = away[np.arange(len(drawn)), drawn] / np.maximum(count[drawn] - 1, 1)
        between = np.where(member > 0, np.inf, away / count).min(1)
        rows.append((recall, float(((between - within) / np.maximum(between, within)).mean())))
    return np.array(rows)


def nearest_label(
    z_theta: Float[Array, "scene path 2"], valid: Bool[Array, "scene path"], rng: np.random.Generator, permutations: int
) -> Float[Array, " draw"]:
    """Return the share of paths with the label of the nearest other one in their scene, then after permutations."""
    distances = np.linalg.norm(z_theta[:, :, None] - z_theta[:, None], axis=-1)
    near = (distances + np.diag(np.full(valid.shape[1], np.inf))).argmin(-1)
    draws = [valid, *(rng.permuted(valid, axis=1) for _ in range(permutations))]
    return np.array([(np.take_along_axis(labels, near, 1) == labels).mean() for labels in draws])


def best_accuracy(share: Float[Array, "user *scene cell"]) -> float:
    """Return the mean recall of the best guess of the user from a path drawn from its valid set.

    share: validity of each cell to each user, true (0 or 1) or its mean over scenes. Scenes without a valid path to
    some user are left out.
    """
    total = share.sum(-1, keepdims=True)
    use = (total > 0).all(0)[..., 0]
    density = (share / np.where(total > 0, total, 1))[:, use] if use.ndim else share / total
    return float((density.max(0) / len(share)).sum(-1).mean())


# Overlap


def jaccard(a: Bool[Array, "*set path"], b: Bool[Array, "*set path"]) -> Float[Array, "*set"]:
    """Return the intersection over the union of two sets of paths; 0 if both are empty."""
    return (a & b).sum(-1) / np.maximum((a | b).sum(-1), 1)


def overlap_tables(
    users: list[str],
    sets: Mapping[str, Sets],
    truth: Sets,
    training: Bool[Array, "user seed scene cell"],
    items: Items,
) -> tuple[pd.DataFrame, dict[tuple[str, str], Estimates]]:
    """Return each source's error of the overlap of two users' valid sets, and the gains.

    The blind guess TYPICAL is a seed's mean true overlap in its training scenes. A gain is the decrease of the error by
    a variant, averaged over pairs of users, against that guess.
    """
    rows, errors = [], {}
    for i, j in combinations(range(len(users)), 2):
        true = jaccard(truth[i], truth[j])  # (1, scene)
        typical = jaccard(training[i], training[j]).mean(-1, keepdims=True)  # (seed, 1)
        overlaps = {source: jaccard(x[i], x[j]) for source, x in sets.items()} | {TYPICAL: typical}
        for source, overlap in overlaps.items():
            overlap = np.broadcast_to(overlap, (len(typical), true.shape[1]))
            error, vary = np.abs(overlap - true), [min(np.ptp(x), np.ptp(true[0])) > 1e-9 for x in overlap]
            r = [np.corrcoef(x, true[0])[0, 1] if varies else 0.0 for x, varies in zip(overlap, vary, strict=True)]
            errors.setdefault(source, []).append(error)
            key = {"variant": source, "first": users[i], "second": users[j]}
            row = key | {"truth": true.mean(), "overlap": overlap.mean()}
            row |= estimate(error[None], items=items).row("error", "ci_low", "ci_high")
            rows.append(row | {"correlation": np.mean(r)})
    blind = np.mean(errors.pop(TYPICAL), axis=0)
    gains = {
        ("overlap", v): estimate((blind - np.mean(x, axis=0))[None], items=items)
        for v, x in errors.items()
        if v != POSITION
    }
    return pd.DataFrame(rows), gains


# Samples


def sampling_table(
    cfg: DictConfig,
    layouts: Layouts,
    z_theta: Float[Array, "scene path 2"],
    sets: Mapping[str, Sets],
    truth: Sets,
    items: Items,
) -> tuple[pd.DataFrame, dict[tuple[str, str], Estimates]]:
    """Return the share of valid samples and of routes found, by source and user, and the gains.

    A sample is one of the first `samples` candidates that a source accepts. A gain is against the position prior, the
    mean over users. Users to whom every path is valid are left out: they have one route.
    """
    users, draws, seeds = list(cfg.users), cfg.studies.users.samples, len(cfg.protocol.seeds)
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
                row |= estimate(each, items=items).row(measure, f"{measure}_low", f"{measure}_high")
            rows.append(row | {"routes_found": found.mean(), "routes_all": all_routes.mean()})
    means = {key: np.mean(each, axis=0) for key, each in scores.items()}
    gains = {(m, v): estimate(x - means[m, POSITION], items=items) for (m, v), x in means.items() if v in cfg.variants}
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


def routes(sides: Bool[Array, "scene path slot"], chosen: Bool[Array, "*seed scene path"]) -> Int[Array, "*seed scene"]:
    """Return the number of distinct routes among the chosen paths: sides on which a path passes the items."""
    code = (sides * 2 ** np.arange(sides.shape[-1])).sum(-1)  # (scene, path)
    return np.stack([(chosen & (code == value)).any(-1) for value in np.unique(code)]).sum(0)


# The code z_image


def codes_table(cfg: DictConfig) -> pd.DataFrame:
    """Return how far single dimensions of z_image hold single facts of a scene, by variant: a mean and its interval.

    The measure is the mutual information gap (Chen et al., 2018, "Isolating sources of disentanglement"): of the two
    dimensions that tell most of a fact, the difference, over the fact's entropy. 0 if two tell as much, 1 if one alone
    tells all. `shuffled`: the same after the facts were given to other scenes.
    """
    study, first = cfg.studies.users, cfg.evaluate.users[0]
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    rng = stream(study.root_seed, "codes")
    layouts, looks = random_scenes(rng, CODED, catalogue, "train", LayoutRules.of(cfg.scenes.layout))
    images = render_scenes(layouts, looks["texture"].tolist(), looks["render_seed"].tolist(), palette)
    facts = [pd.factorize(looks["texture"], sort=True)[0], layouts.present.sum(1)]
    facts += [(layouts.symbol == symbol).any(1).astype(int) for symbol in range(len(SYMBOLS))]
    facts += list((LEVELS * layouts.centre[:, 0].clip(0, 0.999)).astype(int).T)
    order, rows = rng.permutation(CODED), []
    for variant in (name for name, of in cfg.variants.items() if of.kind == "vae"):
        models = [load_model(cfg, variant, first, seed, cfg.main_n_demos) for seed in cfg.protocol.seeds]
        codes = [model.perceive(to_tensor(images)).detach().numpy() for model in models]
        gaps = np.array([[gap(z, fact) for fact in facts] for z in codes]).mean(1)
        chance = np.mean([[gap(z, fact[order]) for fact in facts] for z in codes])
        interval = estimate(gaps[None, None]).row()
        rows.append({"variant": variant, "beta": cfg.variants[variant].beta} | interval | {"shuffled": chance})
    return pd.DataFrame(rows)


def gap(codes: Float[Array, "scene dimension"], fact: Int[Array, " scene"]) -> float:
    """Return the mutual information gap of a fact; each dimension is cut at its quantiles."""
    told = []
    for x in codes.T:
        counts = np.zeros((fact.max() + 1, BINS), dtype=int)
        np.add.at(counts, (fact, np.searchsorted(np.quantile(x, np.arange(1, BINS) / BINS), x)), 1)
        told.append(mutual_info_score(None, None, contingency=counts))
    second, best = sorted(told)[-2:]
    return (best - second) / entropy(np.bincount(fact))


# Verdicts


def verdicts(clusters: pd.DataFrame, gains: Mapping[tuple[str, str], Estimates]) -> pd.DataFrame:
    """Return a verdict on each measure of the first variant: `ours` with its interval must lie above `bar`."""
    table = clusters.set_index("measure")
    near, silhouette, perfect, same = (table.loc[name] for name in (*MEASURES, "perfect, position", SAME_TABLE))
    interval, reachable = ["mean", "ci_low", "ci_high"], bool(perfect["mean"] > near["chance"])
    rows = [
        ("clusters in a table", SAME_TABLE, same["chance"], *same[interval], True),
        ("clusters by user", "user named", near["chance"], *near[interval], reachable),
        ("clusters by user", "silhouette", 0.0, *silhouette[interval], False),  # of the truth: no model does better
    ]
    for measure in dict.fromkeys(measure for measure, _ in gains):
        ours, *others = (gain for (name, _), gain in gains.items() if name == measure)
        claim = "overlap" if measure == "overlap" else "varied samples"
        reached = any(x.ci_low[0] > 0 for x in others)
        rows.append((claim, f"gain in {measure}", 0.0, *ours.row().values(), reached))
    frame = pd.DataFrame(rows, columns=["claim", "measure", "bar", "ours", "ci_low", "ci_high", "reachable"])
    given = frame[["bar", "ci_low", "ci_high", "reachable"]].to_numpy()
    return frame.assign(variant=next(iter(gains))[1], verdict=[judge(*row) for row in given])


def judge(bar: float, low: float, high: float, reachable: bool) -> str:
    """Return the verdict: the interval lies above the bar, or below one that can be reached, else it is open."""
    return HOLDS if low > bar else FAILS if high < bar and reachable else OPEN


if __name__ == "__main__":
    launch(main, "users")
