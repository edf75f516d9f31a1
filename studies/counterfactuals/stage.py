"""Stage counterfactuals: attribute rejected paths to items.

Every model's answers are compared with the truth. Models and world are structural causal models that differ only in
their mechanisms (pipeline.causal.mechanisms). Each question is do(O := o) in a scene whose path, user, table top and
render seed are recorded.
"""

from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal import counterfactual
from pipeline.causal.counterfactual import attribute
from pipeline.causal.mechanisms import model_scm, recorded_noise, renderer, true_scm
from pipeline.causal.scm import Values
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.settings import Count, Several, SharedSplit, StudyGroup, Whole, need, widest_margin
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import items_held
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.render import ImageSource, Palette
from pipeline.world.rules import clearance


class Settings(StudyGroup):
    split: SharedSplit
    scenes: Several
    paths: Count
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require a user with a margin, and enough scenes."""
    name, shared, users = "studies.counterfactuals", parameters.scenes.shared, parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write summary.csv."""
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
    items = items_held(layouts.item, layouts.symbol)
    for user in users:
        chances = counterfactual.baselines(attribute(truth[user].necessity), layouts.present, clearances)
        for variant, answer in answers[user].items():
            names = {"variant": variant, "user": user}
            summary.append(names | counterfactual.score_attributions(answer, truth[user], chances, items))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))


def read_noise(cfg: DictConfig) -> Values:
    """Return the recorded noises of the split's first scenes: items, table top, render seed and random paths."""
    study, scenes = cfg.studies.counterfactuals, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool)
    layouts, appearance = scenes.layouts[pool][: study.scenes], scenes.appearances[pool][: study.scenes]
    rng = stream(study.root_seed, "counterfactual")
    return recorded_noise(layouts, appearance, random_z_theta(rng, len(layouts), study.paths))


if __name__ == "__main__":
    launch(main, "counterfactuals")
