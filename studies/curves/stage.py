"""Stage curves: people who show S-shapes, whose paths are taken as curves or, forced, as the paper's parabolas.

Users and tables are those of the paper's experiment, with new demonstrations: Bezier curves of degree 4 between the
same ends, followed by the same hands. The clearance model is fitted to both, and judged by the truth of the curves.
"""

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline import library
from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, Versions, read_scenes, read_versions, train_pool
from pipeline.causal.interventions import verdicts
from pipeline.launch import launch
from pipeline.models.base import Z_RANGE_M, ValidityModel
from pipeline.models.clearance.clearance import PATH_SAMPLES
from pipeline.planning import bumps
from pipeline.planning.nearest import by_percept
from pipeline.planning.repair import Ascent, repair
from pipeline.runtime.settings import Count, Several, Size, StudyGroup, Weight, Whole, need
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import items_held
from pipeline.stats.scores import DECISION, accuracy_estimate
from pipeline.training.loop import TrainingSet
from pipeline.training.refit import refit
from pipeline.world import bezier_fit
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, bezier, curve
from pipeline.world.hand import ARC_POINTS, Hand, join, simulate, valid_trajectories
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, line_clearance, slack

DEGREE = 4
CURVES, PARABOLAS = SPACES = "curves", "parabolas"  # how a model is given the paths
VARIANT = "clearance"
GRADIENT, SEARCH = "gradient", "search"
SLIDE_M = 1e-3  # the oracle's displacement counts as at least this far
Points = Float[Array, "scene path point 2"]  # [m]


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Several
    paths: Count
    starts: Count
    rate: Size
    distance_penalty: Weight


def agree(study: Settings, parameters: Any) -> None:
    """Require enough scenes in the split, and the clearance model."""
    shared, name = parameters.scenes.shared, "studies.curves"
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")
    need(VARIANT in parameters.variants, "variants", list(parameters.variants), f"{VARIANT} among them")


class Starts(NamedTuple):
    """One user's invalid paths, the same for all models and methods, and the nearest valid ones."""

    scene: Array
    points: Float[Array, "start point 2"]
    oracle_m: Float[Array, " start"]  # least displacement that is truly valid; NaN where none was found


class Answer(NamedTuple):
    """Hold what one model says of all versions of the scenes, and its repairs."""

    p: Float[Array, "version scene path"]
    repairs: pd.DataFrame  # a row for each method and start


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.csv, verdicts.csv, repairs.csv, fits.csv, and shown.npz: paths, fits and repairs of a scene."""
    study, users = cfg.studies.curves, list(cfg.evaluate.users)
    scenes = read_scenes(Path(cfg.paths.scenes))
    versions = read_versions(cfg, scenes, study.scenes)
    random = s_shapes(stream(study.root_seed, "judged"), len(versions.layouts[0]), study.paths)
    points = bezier(random, PATH_SAMPLES)
    labels = np.stack([[is_valid(x, points, cfg.users[u]) for x in versions.layouts] for u in users])
    sets, residuals = demonstrations(cfg, scenes)
    starts = {u: invalid_starts(cfg, versions.layouts[0], points, v[0], u) for u, v in zip(users, labels, strict=True)}
    held = items_held(versions.layouts[0].item, versions.layouts[0].symbol)
    accuracy, judged, repairs = [], [], []
    for space, paths in ((CURVES, points), (PARABOLAS, forced(points))):
        ask = partial(answer, cfg, versions, space, paths, starts)
        answers = refit(cfg, {VARIANT: sets[space]}, ask, space)[VARIANT]
        p = np.stack([one.p for one in answers]).reshape(len(users), -1, *answers[0].p.shape)
        estimate = accuracy_estimate(p[:, :, 0] > DECISION, labels[:, 0], held)
        accuracy.append({"space": space} | estimate | {"valid": labels[:, 0].mean()})
        judged.append(verdicts(users, p, labels, versions.layouts).assign(space=space))
        repairs += [one.repairs.assign(space=space) for one in answers]
    write_table(out_dir / "fits.csv", residuals)
    write_table(out_dir / "accuracy.csv", pd.DataFrame(accuracy))
    write_table(out_dir / "verdicts.csv", pd.concat(judged, ignore_index=True))
    write_table(out_dir / "repairs.csv", summary(pd.concat(repairs, ignore_index=True)))
    first = sets[CURVES][0]
    shown = {"image": first.images[0], "curves": first.z_theta[0], "valid": first.valid[0]}
    write_arrays(out_dir / "shown.npz", shown | {"parabolas": curve(sets[PARABOLAS][0].z_theta[0], PATH_SAMPLES)})


def s_shapes(rng: np.random.Generator, *shape: int) -> Float[Array, "*shape control 2"]:
    """Draw curves of degree 4 between the paper's ends, the other control points [m] uniform on the z_theta square."""
    ends = [np.broadcast_to(end, (*shape, 1, 2)) for end in (P_INIT, P_F)]
    return np.concatenate([ends[0], rng.uniform(Z_LOW, Z_HIGH, (*shape, DEGREE - 1, 2)), ends[1]], axis=-2)


def is_valid(layouts: Layouts, points: Points, margins: Margins) -> Bool[Array, "scene path"]:
    """Return whether curves, given by their points [m], are truly valid to the user."""
    return slack(layouts, line_clearance(layouts, points), margins) > 0


def demonstrations(cfg: DictConfig, scenes: SceneSet) -> tuple[dict[str, list[TrainingSet]], pd.DataFrame]:
    """Return each judged user's and seed's demonstrations as curves and as parabolas, and how closely these fit."""
    hand, sets, residuals = Hand.of(cfg.demos.hand), {space: [] for space in SPACES}, []
    for user in cfg.evaluate.users:
        for seed in cfg.protocol.seeds:
            layouts, images = scenes.layouts[train_pool(seed)], scenes.images[train_pool(seed)]
            rng, shape = stream(cfg.studies.curves.root_seed, user, seed), (len(layouts), cfg.main_n_demos)
            intended = bezier(s_shapes(rng, *shape), ARC_POINTS).reshape(-1, ARC_POINTS, 2)
            samples, offsets = join([simulate(rng, path, hand) for path in intended])
            labels = valid_trajectories(layouts, samples, offsets, cfg.users[user])
            fits = [bezier_fit.fit_any(xy, DEGREE) for xy in np.split(samples[:, 1:3], offsets[1:-1])]
            parabolas = bezier_fit.fit(samples[:, 1:3], offsets, cfg.demos.poor_above_m)
            z_theta = parabolas.z_theta.reshape(*shape, 2).clip(*Z_RANGE_M)
            curves = bezier(np.stack([controls for controls, _, _ in fits]), PATH_SAMPLES)
            sets[CURVES].append(TrainingSet(user, seed, images, curves.reshape(*shape, PATH_SAMPLES, 2), labels))
            sets[PARABOLAS].append(TrainingSet(user, seed, images, z_theta, labels))
            for space, away in ((CURVES, [r for _, _, r in fits]), (PARABOLAS, parabolas.residual_m)):
                residuals.append({"user": user, "seed": seed, "space": space, "residual_m": float(np.mean(away))})
    return sets, pd.DataFrame(residuals)


def forced(points: Points) -> Float[Array, "scene path 2"]:
    """Return the z_theta [m] of the paper's path that is nearest to each curve."""
    flat = points.reshape(-1, points.shape[2], 2)
    offsets = np.arange(0, flat[..., 0].size + 1, points.shape[2])
    z_theta = bezier_fit.fit(flat.reshape(-1, 2), offsets, np.inf).z_theta.reshape(*points.shape[:2], 2)
    return z_theta.clip(*Z_RANGE_M)


def invalid_starts(cfg: DictConfig, layouts: Layouts, points: Points, valid: Array, user: str) -> Starts:
    """Return paths that are invalid to the user, evenly over the scenes, and the oracle's displacement of each."""
    study, margins = cfg.studies.curves, cfg.users[user]
    scene, path = np.nonzero(~valid)
    even = np.linspace(0, len(scene) - 1, min(study.starts, len(scene))).astype(int)
    scene, path = scene[even], path[even]

    def log_valid(one: int, curves: Array) -> Array:
        return np.where(is_valid(layouts[[one]], curves[None], margins)[0], 0.0, -np.inf)

    starts = points[scene, path]  # Bezier points lie closely enough
    found = [bumps.nearest(log_valid, int(s), start, 1.0) for s, start in zip(scene, starts, strict=True)]
    oracle = [bumps.displacement(offsets) if log_p == 0 else np.nan for offsets, log_p in found]
    return Starts(scene, starts, np.array(oracle, float))


def answer(
    cfg: DictConfig, versions: Versions, space: str, paths: Array, starts: dict[str, Starts], model: ValidityModel,
    training_set: TrainingSet,
) -> Answer:  # fmt: skip
    """Return P(valid) of the same curves in every version of the scenes, and repairs of one user's starts."""
    p = np.stack([model.probability(images, paths) for images in versions.images])
    own, margins, study = starts[training_set.user], cfg.users[training_set.user], cfg.studies.curves
    images, layouts = versions.images[0][own.scene], versions.layouts[0][own.scene]
    tried = {GRADIENT: by_gradient(model, images, space, own.points, study.rate)}
    if space == CURVES:
        tried[SEARCH] = by_search(model, images, own.points, study.distance_penalty)
    tables = []
    for method, (ends, accepted) in tried.items():
        truth = is_valid(layouts, ends[:, None], margins)[:, 0]
        moved = np.linalg.norm(ends - own.points, axis=-1).mean(-1)
        columns = {"method": method, "valid_end": truth, "accepted": accepted, "moved_m": moved}
        tables.append(pd.DataFrame(columns | {"oracle_m": own.oracle_m}))
    return Answer(p, pd.concat(tables))


def by_gradient(
    model: ValidityModel, images: Array, space: str, points: Float[Array, "start point 2"], rate: float
) -> tuple[Float[Array, "start point 2"], Bool[Array, " start"]]:
    """Return the nearest accepted point of gradient steps; the last one, where none is accepted."""
    given = points[:, None] if space == CURVES else forced(points[:, None])
    steps = repair(model, images, given, Ascent.of(library.REPAIR | ({"rate": rate} if space == CURVES else {})))
    moved = steps.z[:, 0].astype(float)
    curves = points[:, None] + bumps.basis() @ moved if space == CURVES else curve(moved, PATH_SAMPLES)
    away = np.linalg.norm(curves - curves[:, :1], axis=-1).mean(-1)  # (start, step)
    accepted = steps.p[:, 0] > library.ACCEPTED_ABOVE
    chosen = np.where(accepted.any(1), np.where(accepted, away, np.inf).argmin(1), -1)
    return curves[np.arange(len(curves)), chosen], np.any(accepted, axis=1)


@torch.no_grad()
def by_search(
    model: ValidityModel, images: Array, points: Float[Array, "start point 2"], penalty: float
) -> tuple[Float[Array, "start point 2"], Bool[Array, " start"]]:
    """Return what the search over displacements finds, and whether the model accepts it."""
    log_valid = by_percept(model, model.eval().see(images))
    found = [bumps.nearest(log_valid, i, start, penalty) for i, start in enumerate(points)]
    ends = np.stack([start + bumps.basis() @ offsets for start, (offsets, _) in zip(points, found, strict=True)])
    return ends, np.array([log_p > np.log(library.ACCEPTED_ABOVE) for _, log_p in found])


def summary(repairs: pd.DataFrame) -> pd.DataFrame:
    """Return for each space and method the shares of valid and unsafe repairs, and displacement over the oracle's."""
    possible = repairs["oracle_m"] > SLIDE_M
    repairs = repairs.assign(unsafe=repairs["accepted"] & ~repairs["valid_end"])
    repairs = repairs.assign(moved=repairs["moved_m"].where(possible), oracle=repairs["oracle_m"].where(possible))
    groups = repairs.groupby(["space", "method"], sort=False)
    table = groups.agg(starts=("valid_end", "size"), success=("valid_end", "mean"))
    table["displacement_ratio"] = groups["moved"].sum() / groups["oracle"].sum()
    return table.assign(unsafe=groups["unsafe"].mean()).reset_index()


if __name__ == "__main__":
    launch(main, "curves")
