"""Stage counterfactuals: attribute rejected paths to items.

Every model's answers are compared with the truth. Models and world are structural causal models that differ only in
their mechanisms (pipeline.causal.mechanisms). Each question is do(O := o) in a scene whose path, user, table top and
render seed are recorded.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal import counterfactual
from pipeline.causal.counterfactual import NO_SINGLE_CAUSE, Removals, attribute
from pipeline.causal.mechanisms import model_scm, recorded_noise, renderer, true_scm
from pipeline.causal.scm import Values
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.settings import Count, Several, SharedSplit, StudyGroup, Whole, need, need_one, widest_margin
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.render import ImageSource, Palette
from pipeline.world.rules import clearance


class Settings(StudyGroup):
    split: SharedSplit
    scenes: Several
    paths: Count
    example_variant: str
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require a user with a margin, a known example variant, and enough scenes."""
    name, shared, users = "studies.counterfactuals", parameters.scenes.shared, parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")
    need_one(f"{name}.example_variant", study.example_variant, parameters.variants)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write summary.csv, examples.csv and examples.npz."""
    check_weights(cfg)
    users = [user for user, margins in cfg.users.items() if any(m is not None for m in margins.values())]
    noise = read_noise(cfg)
    layouts, z_theta = noise["O"], noise["Z_theta"]
    palette = Palette(read_catalogue(Path(cfg.paths.data)), ImageSource.of(cfg.scenes.source))
    world, camera = true_scm(cfg.users), model_scm({}, renderer(palette))

    # Each scene unchanged, empty and without each item: do(O := subset of its items).
    subsets = counterfactual.item_subsets(layouts.present)
    units = {name: values[subsets.scene] for name, values in noise.items()}
    kept = counterfactual.select_items(units["O"], subsets.kept)
    images = camera.do(O=kept).entail(units, "I")["I"]
    predictions = predict_all(cfg, users, images, units["Z_theta"], "counterfactuals")
    truth, answers = {}, {}
    for i, user in enumerate(users):
        truth[user] = subsets.by_question(world.do(O=kept, S=user).expectation("V", units))
        answers[user] = {variant: subsets.by_question(p[i]) for variant, p in predictions.items()}

    clearances, summary = clearance(layouts, z_theta), []
    for user in users:
        chances = counterfactual.baselines(attribute(truth[user].necessity), layouts.present, clearances)
        for variant, answer in answers[user].items():
            names = {"variant": variant, "user": user}
            summary.append(names | counterfactual.score_attributions(answer, truth[user], chances))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))

    wrong = cfg.studies.counterfactuals.example_variant
    chosen = choose(truth, {user: of_user[wrong].of_seed(0) for user, of_user in answers.items()})
    rows = [
        pd.DataFrame({"example": kind, "user": user, "variant": variant} | example_of(a, place, layouts, z_theta))
        for kind, place in chosen.items()
        for user in users
        for variant, a in {"truth": truth[user], **{v: a.of_seed(0) for v, a in answers[user].items()}}.items()
    ]
    write_table(out_dir / "examples.csv", pd.concat(rows) if rows else pd.DataFrame({"example": []}))
    shown = images[subsets.index[[scene for scene, _ in chosen.values()]]]  # (example, question, ...)
    write_arrays(out_dir / "examples.npz", {"factual": shown[:, 0], "empty": shown[:, 1], "without": shown[:, 2:]})


def read_noise(cfg: DictConfig) -> Values:
    """Return the recorded noises of the split's first scenes: items, table top, render seed and random paths."""
    study, scenes = cfg.studies.counterfactuals, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool)
    layouts, appearance = scenes.layouts[pool][: study.scenes], scenes.appearances[pool][: study.scenes]
    rng = stream(study.root_seed, "counterfactual")
    return recorded_noise(layouts, appearance, random_z_theta(rng, len(layouts), study.paths))


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
