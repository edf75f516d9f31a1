"""Scenes of the confounded world, and models fitted in them: jobs for processes of their own.

Paths are random and labelled by the users' rules: no hand is simulated. A model begins as its own stage begins it, and
VAEs are fitted by the stacked engine, whatever `train.engine` is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.fitting import Fit, one_by_one
from pipeline.parallel import map_jobs
from pipeline.spec import clearance
from pipeline.spec.losses import Weights
from pipeline.spec.specification import Specification, to_tensor, untrained
from pipeline.spec.stacked import LANES, fit_stack
from pipeline.spec.things import find
from pipeline.spec.training import Schedule, job_seed
from pipeline.spec.vae import VaeSpecification
from pipeline.table.bezier import random_z_theta
from pipeline.table.confounded import Setting, confounded_layouts
from pipeline.table.items import Catalogue, read_catalogue
from pipeline.table.layout import LayoutRules, Layouts
from pipeline.table.render import Palette, render_scenes
from pipeline.table.rules import valid

FITTED = ("train", "path")  # the stages whose variants can be fitted here


@dataclass(frozen=True)
class Scenes:
    """What stands where, its pictures, and how many things the path model finds in them for each item there is."""

    layouts: Layouts
    images: UInt8[Array, "scene 100 100 3"]
    things_per_item: float


@dataclass(frozen=True)
class Draw:
    """Scenes to be drawn; those of one name share their chances, whatever the world (of confound.worlds)."""

    name: str
    world: str
    count: int
    split: str  # of the items


@dataclass(frozen=True)
class Pupil:
    """A model to be fitted: whose, from which seed's scenes."""

    user: str
    seed: int
    scenes: Scenes


@dataclass(frozen=True)
class _Batch:
    variant: str
    pupils: Sequence[Pupil]


def draw_all(cfg: DictConfig, draws: Sequence[Draw]) -> list[Scenes]:
    """Scenes laid out and pictured."""
    return map_jobs(partial(_draw, cfg), draws, cfg.workers, "confounded scenes")


def _draw(cfg: DictConfig, draw: Draw) -> Scenes:
    """One set of scenes; table top, light and camera do not depend on the world either."""
    c, (catalogue, palette) = cfg.confound, _inputs(cfg.paths.data)
    world = c.worlds[draw.world]
    rng = np.random.default_rng(job_seed(c.generator, "scenes", draw.name))
    rules, setting = LayoutRules.of(cfg.scenes.layout), Setting(world.together, c.present, c.glasses, *world.gap_m)
    layouts = confounded_layouts(rng, draw.count, catalogue.footprints, catalogue.pool(draw.split), rules, setting)
    textures, seeds = rng.choice(catalogue.texture_names("train"), draw.count), rng.integers(2**31, size=draw.count)
    images = render_scenes(layouts, list(textures), seeds.tolist(), palette)
    return Scenes(layouts, images, float(find(to_tensor(images)).present.sum() / layouts.present.sum()))


@lru_cache(maxsize=1)
def _inputs(data: str) -> tuple[Catalogue, Palette]:
    """The items and their pictures, read once per process."""
    catalogue = read_catalogue(Path(data))
    return catalogue, Palette(catalogue)


def demonstrations(
    cfg: DictConfig, layouts: Layouts, user: str, seed: int
) -> tuple[Float[Array, "scene n 2"], Bool[Array, "scene n"]]:
    """Random z_theta [m], study_n a scene, and whether each is valid: the same paths whatever stands there."""
    rng = np.random.default_rng(job_seed(cfg.confound.generator, "paths", user, seed))
    z = random_z_theta(rng, len(layouts), cfg.study_n)
    return z, valid(layouts, z, cfg.users[user])


def fit_and_ask(
    cfg: DictConfig,
    pupils: dict[str, list[Pupil]],
    images: UInt8[Array, "picture 100 100 3"],
    z_theta: Float[Array, "picture path 2"],
) -> dict[str, Float32[Array, "pupil picture path"]]:
    """Fit every variant's models; P(valid) of every path [m] in its picture by each of them."""
    at_once = {v: LANES if cfg.variants[v].stage == "train" else len(cfg.protocol.seeds) for v in pupils}
    batches = [_Batch(v, of[i : i + at_once[v]]) for v, of in pupils.items() for i in range(0, len(of), at_once[v])]
    answer = partial(_answer, cfg, images, z_theta)
    found = list(zip(batches, map_jobs(answer, batches, cfg.workers, "confound"), strict=True))
    return {v: np.concatenate([p for batch, p in found if batch.variant == v]) for v in pupils}


def _answer(cfg: DictConfig, images: Array, z_theta: Array, batch: _Batch) -> Float32[Array, "pupil picture path"]:
    """Fit one batch of models and ask them."""
    kind, fit = _trainer(cfg, batch.variant)
    seeds = [job_seed(p.seed, p.user, cfg.study_n, batch.variant) for p in batch.pupils]
    models = [untrained(kind, cfg.variants[batch.variant].model, seed) for seed in seeds]
    z, labels = zip(*(demonstrations(cfg, p.scenes.layouts, p.user, p.seed) for p in batch.pupils), strict=True)
    fit(models, [p.scenes.images for p in batch.pupils], z, labels, seeds=seeds)
    return np.stack([model.probability(images, z_theta) for model in models])


def _trainer(cfg: DictConfig, variant: str) -> tuple[type[Specification], Fit]:
    """What stage train or path fits of a variant, and how."""
    v, t, p = cfg.variants[variant], cfg.train, cfg.path
    if v.stage == "train":
        weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
        schedule = Schedule(t.steps, float(t.rate), float(t.weight_decay), t.curve_every)
        return VaeSpecification, partial(fit_stack, weights=weights, schedule=schedule)
    schedule = clearance.Schedule(p.steps, float(p.rate), float(p.weight_decay), p.curve_every, float(p.prior))
    return clearance.ClearanceModel, partial(one_by_one, clearance.fit, schedule=schedule)
