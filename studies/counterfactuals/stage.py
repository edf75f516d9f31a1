"""Stage counterfactuals: attribute rejected paths to items, and find how far each item would have to move.

Every model's answers are compared with the truth. Models and world are structural causal models that differ only in
their mechanisms (pipeline.causal.mechanisms). Each question is do(O := o) in a scene whose path, user, table top and
render seed are recorded.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal.counterfactual import (
    NO_SINGLE_CAUSE,
    Removals,
    attribute,
    baselines,
    item_subsets,
    score_attributions,
    select_items,
)
from pipeline.causal.mechanisms import model_scm, recorded_noise, renderer, true_scm
from pipeline.causal.questions import allowed
from pipeline.causal.scm import SCM, Values
from pipeline.launch import launch
from pipeline.models.trained import check_weights, load_model
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts
from pipeline.world.render import Palette
from pipeline.world.rules import Margins, clearance, slack
from pipeline.world.source import ImageSource
from studies.counterfactuals.examples import choose, example_rows
from studies.counterfactuals.moves import crossing, outward_normal, score_moves, translate_item

FINE_STEPS = 10  # subdivisions of a step between two images, for the true smallest move


@dataclass(frozen=True)
class Moves:
    """One user's causes, each moved away from one path; distance 0 is the original position."""

    scene: np.ndarray  # (case,), as path and slot
    path: np.ndarray
    slot: np.ndarray
    distance: np.ndarray  # (step,) [m]
    layouts: Layouts  # (case * step)
    true_m: np.ndarray  # (case,) the smallest move that makes the path valid


@dataclass(frozen=True)
class Job:
    """The models of one variant and seed, and the units of the question, whose images are set."""

    cfg: DictConfig
    variant: str
    seed: int
    users: Sequence[str]
    noise: Values
    images: np.ndarray


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write attributions.parquet, summary.csv, moves.parquet, moves.csv, examples.csv and examples.npz."""
    check_weights(cfg)
    users = [user for user, margins in cfg.users.items() if any(m is not None for m in margins.values())]
    noise = read_noise(cfg)
    layouts, z_theta = noise["O"], noise["Z_theta"]
    palette = Palette(read_catalogue(Path(cfg.paths.data)), ImageSource.of(cfg.scenes.source))
    world, camera = true_scm(cfg.users), model_scm({}, renderer(palette))

    # Each scene unchanged, empty, without each item and with each item alone: do(O := subset of its items).
    subsets = item_subsets(layouts.present)
    units = take(noise, subsets.scene)
    kept = select_items(units["O"], subsets.kept)
    images = camera.do(O=kept).entail(units, "I")["I"]
    predictions = predict_versions(cfg, users, units, images, "counterfactuals")
    truth, answers = {}, {}
    for i, user in enumerate(users):
        truth[user] = subsets.by_question(world.do(O=kept, S=user).expectation("V", units))
        answers[user] = {variant: subsets.by_question(p[i]) for variant, p in predictions.items()}

    clearances = clearance(layouts, z_theta)
    attributions, summary, moves, move_summary = [], [], [], []
    for user in users:
        cause = attribute(truth[user].necessity)
        chances = baselines(cause, layouts.present, clearances)
        invalid, single = truth[user].factual == 0, cause != NO_SINGLE_CAUSE
        moved = choose_moves(cfg, noise, cause, cfg.users[user])
        least_moves = find_least_moves(cfg, noise, camera, user, moved, answers[user])
        for variant, answer in answers[user].items():
            names = {"variant": variant, "user": user}
            attributions.append(attribution_rows(cfg, names, answer, truth[user], layouts))
            true_shares = {"true_invalid": invalid.mean(), "true_single": single.sum() / max(invalid.sum(), 1)}
            summary.append(names | true_shares | score_attributions(answer, truth[user], chances))
            moves.append(move_rows(cfg, names, moved, *least_moves[variant]))
            move_summary.append(names | score_moves(*least_moves[variant], moved.true_m))
    write_table(out_dir / "attributions.parquet", pd.concat(attributions, ignore_index=True))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))
    write_table(out_dir / "moves.parquet", pd.concat(moves, ignore_index=True))
    write_table(out_dir / "moves.csv", pd.DataFrame(move_summary))

    example_variant = cfg.studies.counterfactuals.example_variant
    first_seed = {user: {variant: a.of_seed(0) for variant, a in answers[user].items()} for user in users}
    chosen = choose(truth, {user: first_seed[user][example_variant] for user in users})
    examples = [
        example_rows(kind, place, layouts, z_theta, user, {"truth": truth[user]} | first_seed[user])
        for kind, place in chosen.items()
        for user in users
    ]
    write_table(out_dir / "examples.csv", pd.concat(examples) if examples else pd.DataFrame({"example": []}))
    write_arrays(out_dir / "examples.npz", subsets.select_scenes(images, [scene for scene, _ in chosen.values()]))


def read_noise(cfg: DictConfig) -> Values:
    """Return the recorded noises of the split's first scenes: items, table top, render seed and random paths."""
    study, scenes = cfg.studies.counterfactuals, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool)
    layouts, appearance = scenes.layouts[pool][: study.scenes], scenes.appearances[pool][: study.scenes]
    rng = stream(study.root_seed, "counterfactual")
    return recorded_noise(layouts, appearance, random_z_theta(rng, len(layouts), study.paths))


def take(noise: Values, scene: np.ndarray) -> Values:
    """Return the units of these scenes."""
    return {name: values[scene] for name, values in noise.items()}


def predict_versions(
    cfg: DictConfig, users: Sequence[str], noise: Values, images: np.ndarray, desc: str
) -> dict[str, np.ndarray]:
    """Return by variant E[V | do(I := images), S = s] of every path: (user, seed, unit, path)."""
    variants, seeds = list(cfg.variants), list(cfg.protocol.seeds)
    seen = {name: noise[name] for name in ("S", "I", "Z_I", "Z_theta")}
    jobs = [Job(cfg, variant, seed, users, seen, images) for variant, seed in product(variants, seeds)]
    answers = np.array(map_jobs(answer, jobs, cfg.workers, desc))  # (variant * seed, user, unit, path)
    answers = answers.reshape(len(variants), len(seeds), *answers.shape[1:]).swapaxes(1, 2)
    return dict(zip(variants, answers, strict=True))


def answer(job: Job) -> np.ndarray:
    """Return E[V] by the models of one variant and seed: (user, unit, path)."""
    cfg = job.cfg
    models = {user: load_model(cfg, job.variant, user, job.seed, cfg.main_n_demos) for user in job.users}
    acted = model_scm(models).do(I=job.images)
    return np.array([acted.do(S=user).expectation("V", job.noise) for user in job.users])


def attribution_rows(
    cfg: DictConfig, names: dict[str, str], answer: Removals, truth: Removals, layouts: Layouts
) -> pd.DataFrame:
    """Return one row per seed and truly invalid path: attributed item and true cause; slot -1 means none."""
    scene, path = np.nonzero(truth.factual == 0)
    seeds = len(cfg.protocol.seeds)
    cause = attribute(truth.necessity)[scene, path]
    attributed = attribute(answer.necessity)[:, scene, path]  # (seed, row)
    symbols = np.append(np.array(SYMBOLS, dtype=object), "")  # of no item: ""
    columns = {
        "seed": np.repeat(np.array(cfg.protocol.seeds), len(scene)),
        "scene": np.tile(scene, seeds),
        "path": np.tile(path, seeds),
        "p": answer.factual[:, scene, path].ravel(),
        "rejected": answer.factual[:, scene, path].ravel() <= DECISION,
        "attributed": attributed.ravel(),
        "attributed_symbol": symbols[np.where(attributed < 0, len(SYMBOLS), layouts.symbol[scene, attributed])].ravel(),
        "cause": np.tile(cause, seeds),
        "cause_symbol": np.tile(symbols[np.where(cause < 0, len(SYMBOLS), layouts.symbol[scene, cause])], seeds),
    }
    return pd.DataFrame(names | columns)


def choose_moves(cfg: DictConfig, noise: Values, cause: np.ndarray, margins: Margins) -> Moves:
    """Choose, in each of the first scenes, the first invalid path that becomes valid by moving its single cause.

    The item moves away from the path along its normal. It must have an allowed position at every step, and the path
    must become valid before the end of the move.
    """
    study = cfg.studies.counterfactuals
    scene, path = np.nonzero(cause != NO_SINGLE_CAUSE)
    slot = cause[scene, path]

    def move(case: np.ndarray, distance: np.ndarray) -> tuple[Layouts, np.ndarray]:
        """Return the moved layouts, and the slack [m] (case, step) of each case's path in them."""
        layouts, z = noise["O"][scene[case]], noise["Z_theta"][scene[case], path[case]]
        moved = translate_item(layouts, slot[case], outward_normal(layouts, slot[case], z), distance)
        room = slack(moved, clearance(moved, np.repeat(z, len(distance), axis=0)[:, None]), margins)
        return moved, room.reshape(len(case), len(distance))

    distance = study.move_step * np.arange(study.move_steps + 1)
    moved, room = move(np.arange(len(scene)), distance)
    free = allowed(moved, np.repeat(slot, len(distance)), LayoutRules.of(cfg.scenes.layout)).reshape(room.shape)
    possible = np.flatnonzero(free.all(1) & (room > 0).any(1))
    case = possible[np.unique(scene[possible], return_index=True)[1]][: study.moved_scenes]
    fine = study.move_step / FINE_STEPS * np.arange(FINE_STEPS * study.move_steps + 1)
    true_m = crossing(fine, move(case, fine)[1], 0.0)
    return Moves(scene[case], path[case], slot[case], distance, move(case, distance)[0], true_m)


def find_least_moves(
    cfg: DictConfig, noise: Values, camera: SCM, user: str, moves: Moves, answers: dict[str, Removals]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by variant (seed, case): the smallest move [m] that the model accepts, and whether it rejects at 0."""
    if len(moves.scene) == 0:
        none = np.empty((len(cfg.protocol.seeds), 0))
        return dict.fromkeys(answers, (none, none.astype(bool)))
    index = np.arange(len(moves.layouts))
    index = index[index % len(moves.distance) > 0]  # all but the original scenes
    case = index // len(moves.distance)
    units = take(noise, moves.scene[case])
    units["Z_theta"] = noise["Z_theta"][moves.scene[case], moves.path[case]][:, None]
    images = camera.do(O=moves.layouts[index]).entail(units, "I")["I"]
    least_moves = {}
    for variant, p in predict_versions(cfg, [user], units, images, f"moves, {user}").items():
        before = answers[variant].factual[:, moves.scene, moves.path, None]
        after = p[0, ..., 0].reshape(*before.shape[:2], -1)  # (seed, case, step)
        p_valid = np.concatenate([before, after], axis=-1)
        least_moves[variant] = crossing(moves.distance, p_valid, DECISION), p_valid[..., 0] <= DECISION
    return least_moves


def move_rows(
    cfg: DictConfig, names: dict[str, str], moves: Moves, model_m: np.ndarray, rejected: np.ndarray
) -> pd.DataFrame:
    """Return one row per seed and case; lengths in metres, model_m NaN if no move is accepted."""
    seed, case = (i.ravel() for i in np.indices(model_m.shape))
    first_step = moves.layouts.symbol[:: len(moves.distance)]
    columns = {
        "seed": np.array(cfg.protocol.seeds)[seed],
        "scene": moves.scene[case],
        "path": moves.path[case],
        "slot": moves.slot[case],
        "symbol": np.array(SYMBOLS)[first_step[case, moves.slot[case]]],
        "true_m": moves.true_m[case],
        "rejected": rejected.ravel(),
        "model_m": model_m.ravel(),
    }
    return pd.DataFrame(names | columns)


if __name__ == "__main__":
    launch(main, "counterfactuals")
