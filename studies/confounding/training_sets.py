"""Draw scenes of each world, and demonstrations in them: random paths labelled by the users' rules."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import LayoutRules, Layouts
from pipeline.world.render import read_palette, render_scenes
from pipeline.world.rules import valid
from pipeline.world.source import ImageSource
from studies.confounding.world import Confounding, confounded_layouts


@dataclass(frozen=True)
class Scenes:
    """Layouts and their images."""

    layouts: Layouts
    images: UInt8[Array, "scene 100 100 3"]


@dataclass(frozen=True)
class Draw:
    """A request for scenes; requests of the same name share their random numbers in all worlds."""

    name: str
    world: str
    count: int
    split: str  # split of the items


def draw_all(cfg: DictConfig, draws: Sequence[Draw]) -> list[Scenes]:
    """Lay out and render the scenes of every request."""
    return map_jobs(partial(_draw, cfg), draws, cfg.workers, "confounded scenes")


def _draw(cfg: DictConfig, draw: Draw) -> Scenes:
    """Draw one set of scenes; textures, lights and cameras do not depend on the world."""
    study = cfg.studies.confounding
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    rng = stream(study.root_seed, "scenes", draw.name)
    rules = LayoutRules.of(cfg.scenes.layout)
    confounding = Confounding(study.worlds[draw.world], study.present, study.glasses, *study.gap_m)
    layouts = confounded_layouts(rng, draw.count, catalogue.footprints, catalogue.pool(draw.split), rules, confounding)
    textures, seeds = rng.choice(catalogue.texture_names("train"), draw.count), rng.integers(2**31, size=draw.count)
    return Scenes(layouts, render_scenes(layouts, list(textures), seeds.tolist(), palette))


def demonstrations(
    cfg: DictConfig, layouts: Layouts, user: str, seed: int
) -> tuple[Float[Array, "scene n 2"], Bool[Array, "scene n"]]:
    """Draw main_n_demos random z_theta [m] per scene and label them; the paths do not depend on the layouts."""
    rng = stream(cfg.studies.confounding.root_seed, "paths", user, seed)
    z_theta = random_z_theta(rng, len(layouts), cfg.main_n_demos)
    return z_theta, valid(layouts, z_theta, cfg.users[user])
