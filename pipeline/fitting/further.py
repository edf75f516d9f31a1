"""Further training scenes of a seed, and demonstrations in them: as stages scenes and demos make them."""

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.errors import InputError
from pipeline.fitting.trainers import Lesson
from pipeline.streams import stream
from pipeline.table.bezier import random_z_theta
from pipeline.table.fit import fit
from pipeline.table.layout import LayoutRules, Layouts, random_layouts
from pipeline.table.recordings import Hand, join, keeps, simulate
from pipeline.table.render import read_palette, render_scenes


def taught(cfg: DictConfig, scenes: SceneSet, demos: pd.DataFrame, seed: int, count: int) -> list[Lesson]:
    """Demonstrations of each of evaluate.users in all of a seed's own scenes, then in further ones up to `count`.

    InputError if its own scenes are not as many as scenes.per_seed, or have not their demonstrations.
    """
    own, pool = cfg.scenes.per_seed, train_pool(seed)
    if len(scenes.images.get(pool, ())) != own:
        raise InputError(f"{pool} has not the {own} scenes of scenes.per_seed: run the scenes stage again")
    layouts, images = further_scenes(cfg, seed, max(count - own, 0))
    everything = np.concatenate([scenes.images[pool], images])
    lessons = []
    for user in cfg.evaluate.users:
        z, labels = demo_arrays(demos, seed, user, cfg.study_n)
        if len(z) != own:
            raise InputError(f"demonstrations of {user} are not of {pool}'s {own} scenes: run the demos stage again")
        more_z, more_labels = demonstrations(cfg, layouts, user, seed)
        z, labels = np.concatenate([z, more_z]), np.concatenate([labels, more_labels])
        lessons.append(Lesson(user, seed, everything, z, labels))
    return lessons


def further_scenes(cfg: DictConfig, seed: int, count: int) -> tuple[Layouts, UInt8[Array, "scene 100 100 3"]]:
    """Scenes of training items on training table tops, and their pictures; the first ones whatever the `count`."""
    catalogue, palette = read_palette(cfg.paths.data)
    layouts, textures, lights = (_generator(cfg, name, seed) for name in ("layouts", "textures", "lights"))
    rules, pool = LayoutRules.of(cfg.scenes.layout), catalogue.pool("train")
    drawn = random_layouts(layouts, count, catalogue.footprints, pool, rules)
    names, seeds = textures.choice(catalogue.texture_names("train"), count), lights.integers(2**31, size=count)
    return drawn, render_scenes(drawn, list(names), seeds.tolist(), palette)


def demonstrations(
    cfg: DictConfig, layouts: Layouts, user: str, seed: int
) -> tuple[Float[Array, "scene n 2"], Bool[Array, "scene n"]]:
    """Recordings of a hand, study_n a scene: the z_theta [m] fitted to each, and whether it kept the user's margins."""
    hand, rng = Hand.of(cfg.demos.hand), _generator(cfg, "recordings", user, seed)
    if not len(layouts):
        return np.empty((0, cfg.study_n, 2)), np.empty((0, cfg.study_n), bool)
    recordings = [simulate(rng, random_z_theta(rng), hand) for _ in range(len(layouts) * cfg.study_n)]
    samples, offsets = join([recording.astype(np.float32).astype(float) for recording in recordings])  # as stored
    fits = fit(samples[:, 1:3], offsets, cfg.demos.poor_above_m)
    return fits.z_theta.reshape(len(layouts), -1, 2), keeps(layouts, samples, offsets, dict(cfg.users[user]))


def _generator(cfg: DictConfig, *names: str | int) -> np.random.Generator:
    """A stream of its own for whatever `names` name."""
    return stream(cfg.efficiency.generator, *names)
