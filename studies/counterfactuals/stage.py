"""Stage counterfactuals: attribute rejected paths to items, and find how far each item would have to move.

Every model's answers are compared with the truth. Models and world are structural causal models that differ only in
their mechanisms (pipeline.causal.mechanisms). Each question is do(O := o) in a scene whose path, user, table top and
render seed are recorded.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from omegaconf import DictConfig
from pydantic import Field

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal import counterfactual
from pipeline.causal.counterfactual import NO_SINGLE_CAUSE, Removals, attribute, mean_with_interval
from pipeline.causal.mechanisms import model_scm, recorded_noise, renderer, true_scm
from pipeline.causal.scm import SCM, Values
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.settings import Count, Several, SharedSplit, StudyGroup, Whole, need, need_one, widest_margin
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import curve, random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, allowed
from pipeline.world.render import ImageSource, Palette
from pipeline.world.rules import SAMPLES, Margins, clearance, slack

FINE_STEPS = 10  # subdivisions of a step between two images, for the true smallest move


class Settings(StudyGroup):
    split: SharedSplit
    scenes: Several
    paths: Count
    moved_scenes: Several
    move_step: Annotated[float, Field(gt=0, le=0.1)]
    move_steps: Count
    example_variant: str
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require a user with a margin, a known example variant, and enough scenes."""
    name, shared, users = "studies.counterfactuals", parameters.scenes.shared, parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")
    need(study.moved_scenes <= study.scenes, f"{name}.moved_scenes", study.moved_scenes, f"at most {name}.scenes")
    need_one(f"{name}.example_variant", study.example_variant, parameters.variants)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write summary.csv, moves.csv, examples.csv and examples.npz."""
    check_weights(cfg)
    users = [user for user, margins in cfg.users.items() if any(m is not None for m in margins.values())]
    noise = read_noise(cfg)
    layouts, z_theta = noise["O"], noise["Z_theta"]
    palette = Palette(read_catalogue(Path(cfg.paths.data)), ImageSource.of(cfg.scenes.source))
    world, camera = true_scm(cfg.users), model_scm({}, renderer(palette))

    # Each scene unchanged, empty, without each item and with each item alone: do(O := subset of its items).
    subsets = counterfactual.item_subsets(layouts.present)
    units = take(noise, subsets.scene)
    kept = counterfactual.select_items(units["O"], subsets.kept)
    images = camera.do(O=kept).entail(units, "I")["I"]
    predictions = predict_all(cfg, users, images, units["Z_theta"], "counterfactuals")
    truth, answers = {}, {}
    for i, user in enumerate(users):
        truth[user] = subsets.by_question(world.do(O=kept, S=user).expectation("V", units))
        answers[user] = {variant: subsets.by_question(p[i]) for variant, p in predictions.items()}

    clearances, summary, moves = clearance(layouts, z_theta), [], []
    for user in users:
        cause = attribute(truth[user].necessity)
        chances = counterfactual.baselines(cause, layouts.present, clearances)
        for variant, answer in answers[user].items():
            names = {"variant": variant, "user": user}
            summary.append(names | counterfactual.score_attributions(answer, truth[user], chances))
        moves += move_rows(cfg, noise, camera, user, cause, answers[user])
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))
    write_table(out_dir / "moves.csv", pd.DataFrame(moves))

    wrong = cfg.studies.counterfactuals.example_variant
    chosen = choose(truth, {user: of_user[wrong].of_seed(0) for user, of_user in answers.items()})
    rows = [
        pd.DataFrame({"example": kind, "user": user, "variant": variant} | example_of(a, place, layouts, z_theta))
        for kind, place in chosen.items()
        for user in users
        for variant, a in {"truth": truth[user], **{v: a.of_seed(0) for v, a in answers[user].items()}}.items()
    ]
    write_table(out_dir / "examples.csv", pd.concat(rows) if rows else pd.DataFrame({"example": []}))
    write_arrays(out_dir / "examples.npz", subsets.select_scenes(images, [scene for scene, _ in chosen.values()]))


def read_noise(cfg: DictConfig) -> Values:
    """Return the recorded noises of the split's first scenes: items, table top, render seed and random paths."""
    study, scenes = cfg.studies.counterfactuals, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool)
    layouts, appearance = scenes.layouts[pool][: study.scenes], scenes.appearances[pool][: study.scenes]
    rng = stream(study.root_seed, "counterfactual")
    return recorded_noise(layouts, appearance, random_z_theta(rng, len(layouts), study.paths))


def take(noise: Values, scene: Int[Array, " unit"]) -> Values:
    """Return the units of these scenes."""
    return {name: values[scene] for name, values in noise.items()}


def move_rows(
    cfg: DictConfig, noise: Values, camera: SCM, user: str, cause: Array, answers: Mapping[str, Removals]
) -> list[dict[str, Any]]:
    """Return by variant how well it finds the smallest move of a single cause that makes the path valid."""
    study = cfg.studies.counterfactuals
    distance = study.move_step * np.arange(study.move_steps + 1)
    scene, path, moved, true_m = choose_moves(cfg, noise, cause, distance, cfg.users[user])
    index = np.arange(len(moved))
    index = index[index % len(distance) > 0]  # all but the original scenes
    case, p_moved = index // len(distance), {}
    if len(scene) > 0:
        images = camera.do(O=moved[index]).entail(take(noise, scene[case]), "I")["I"]
        z_theta = noise["Z_theta"][scene[case], path[case]][:, None]
        p_moved = predict_all(cfg, [user], images, z_theta, f"moves, {user}")
    rows = []
    for variant, by_question in answers.items():
        p = by_question.factual[:, scene, path, None]  # (seed, case, step)
        if len(scene) > 0:
            p = np.concatenate([p, p_moved[variant][0, ..., 0].reshape(*p.shape[:2], -1)], axis=-1)
        scores = score_moves(crossing(distance[: p.shape[-1]], p, DECISION), p[..., 0] <= DECISION, true_m)
        rows.append({"variant": variant, "user": user} | scores)
    return rows


def choose_moves(
    cfg: DictConfig, noise: Values, cause: Int[Array, "scene path"], distance: Float[Array, " step"], margins: Margins
) -> tuple[Int[Array, " case"], Int[Array, " case"], Layouts, Float[Array, " case"]]:
    """Choose, in each of the first scenes, the first invalid path that becomes valid by moving its single cause.

    The item moves away from the path along its normal. It must have an allowed position at every step, and the path
    must become valid before the end of the move. Return scene, path, moved layouts (case * step) and the smallest move.
    """
    study = cfg.studies.counterfactuals
    scene, path = np.nonzero(cause != NO_SINGLE_CAUSE)
    slot, layouts, z_theta = cause[scene, path], noise["O"][scene], noise["Z_theta"][scene, path]
    direction = outward_normal(layouts, slot, z_theta)

    def move(case: Array, distance: Array) -> tuple[Layouts, Array]:
        """Return the moved layouts, and the slack [m] (case, step) of each case's path in them."""
        moved = translate_item(layouts[case], slot[case], direction[case], distance)
        room = slack(moved, clearance(moved, np.repeat(z_theta[case], len(distance), axis=0)[:, None]), margins)
        return moved, room.reshape(len(case), len(distance))

    moved, room = move(np.arange(len(scene)), distance)
    free = allowed(moved, np.repeat(slot, len(distance)), LayoutRules.of(cfg.scenes.layout)).reshape(room.shape)
    possible = np.flatnonzero(free.all(1) & (room > 0).any(1))
    case = possible[np.unique(scene[possible], return_index=True)[1]][: study.moved_scenes]
    fine = study.move_step / FINE_STEPS * np.arange(FINE_STEPS * study.move_steps + 1)
    return scene[case], path[case], move(case, distance)[0], crossing(fine, move(case, fine)[1], 0.0)


def outward_normal(layouts: Layouts, slot: Array, z_theta: Float[Array, "case 2"]) -> Float[Array, "case 2"]:
    """Return the unit normal of each path at its point nearest to the item in `slot`, on the item's side."""
    points, case = curve(z_theta, SAMPLES), np.arange(len(slot))
    offset = layouts.centre[case, slot][:, None] - points  # (case, sample, 2)
    nearest = case, np.linalg.norm(offset, axis=-1).argmin(-1)
    tangent = np.gradient(points, axis=1)[nearest]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1) / np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.where((normal * offset[nearest]).sum(-1, keepdims=True) < 0, -normal, normal)


def translate_item(layouts: Layouts, slot: Array, direction: Float[Array, "case 2"], distance: Array) -> Layouts:
    """Return each scene with the item in `slot` moved by each distance [m]: (case * step), steps varying fastest."""
    case = np.repeat(np.arange(len(layouts)), len(distance))
    moved = layouts[case]
    moved.centre[np.arange(len(case)), slot[case]] += direction[case] * np.tile(distance, len(layouts))[:, None]
    return moved


def crossing(distance: Float[Array, " step"], value: Float[Array, "*b step"], threshold: float) -> Float[Array, "*b"]:
    """Return the first distance at which `value` exceeds the threshold, linear between steps; NaN if none does."""
    above = value > threshold
    after = above.argmax(-1)[..., None]
    before = np.maximum(after - 1, 0)
    low, high = (np.take_along_axis(value, i, -1)[..., 0] for i in (before, after))
    share = (threshold - low) / np.where(high > low, high - low, 1.0)
    start, end = distance[before[..., 0]], distance[after[..., 0]]
    return np.where(above.any(-1), start + np.clip(share, 0.0, 1.0) * (end - start), np.nan)


def score_moves(
    model_m: Float[Array, "seed case"], rejected: Bool[Array, "seed case"], true_m: Float[Array, " case"]
) -> dict[str, float]:
    """Return scores of the models' smallest moves [m] (NaN: none found) against the true ones.

    All but cases and true_m refer to the cases that a model rejects before the move. found: share for which some move
    makes the path valid to the model. For these: error_m, mean absolute error; constant_error_m, that of the median.
    """
    row = {"cases": float(len(true_m)), "rejected": rejected.mean() if rejected.size else np.nan}
    if len(true_m) > 1:
        row["true_m"] = true_m.mean()
    if len(true_m) > 1 and rejected.any():
        found = rejected & np.isfinite(model_m)
        row |= mean_with_interval("found", np.isfinite(model_m), rejected)
        row |= mean_with_interval("error_m", np.abs(model_m - true_m), found)
        row |= {"constant_error_m": counterfactual.mean(np.abs(true_m - np.median(true_m)), found)}
    return row


# Examples, by rules fixed before the results were seen


def choose(truth: Mapping[str, Removals], model: Mapping[str, Removals]) -> dict[str, tuple[int, int]]:
    """Return scene and path of each kind of example, given removals by user; kinds without a match are left out.

    - disagree: the first two users both reject the path, but because of different items.
    - one_accepts: the first user rejects it because of a single item, the second accepts it.
    - model_wrong: the model rejects an invalid path but attributes it to another item than the cause.

    Each example is the first path of the first scene that no other example uses.
    """
    rejected = np.stack([t.factual == 0 for t in truth.values()])  # (user, scene, path)
    cause = np.stack([attribute(t.necessity) for t in truth.values()])
    wrong = np.stack([m.factual <= DECISION for m in model.values()])
    wrong &= np.stack([attribute(m.necessity) for m in model.values()]) != cause
    caused, fitting = cause != NO_SINGLE_CAUSE, {}
    if len(truth) > 1:
        fitting["disagree"] = rejected[0] & rejected[1] & (cause[0] != cause[1])
        fitting["one_accepts"] = rejected[0] & caused[0] & ~rejected[1]
    fitting["model_wrong"] = (wrong & caused).any(0)
    chosen: dict[str, tuple[int, int]] = {}
    for kind, paths in fitting.items():
        scene, path = np.nonzero(paths)
        free = np.flatnonzero(~np.isin(scene, [taken for taken, _ in chosen.values()]))
        if len(free):
            chosen[kind] = int(scene[free[0]]), int(path[free[0]])
    return chosen


def example_of(answer: Removals, place: tuple[int, int], layouts: Layouts, z_theta: Array) -> dict[str, Any]:
    """Return the path and each item of the scene [m], with P(valid) as it is and without the item."""
    slots, (z_x, z_y) = np.flatnonzero(layouts.present[place[0]]), z_theta[place]
    x, y = layouts.centre[place[0], slots].T
    item = {"slot": slots, "symbol": np.array(SYMBOLS)[layouts.symbol[place[0], slots]], "x_m": x, "y_m": y}
    return {"z_x": z_x, "z_y": z_y} | item | {"p": answer.factual[place], "p_without": answer.without[place][slots]}


if __name__ == "__main__":
    launch(main, "counterfactuals")
