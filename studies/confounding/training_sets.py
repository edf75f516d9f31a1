"""Scenes of the confounded world, and demonstrations in them: random paths, labelled by the users' rules."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.models.base import to_tensor
from pipeline.perception.objects import find
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import LayoutRules, Layouts
from pipeline.world.render import read_palette, render_scenes
from pipeline.world.rules import valid
from studies.confounding.world import Setting, confounded_layouts


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


def draw_all(cfg: DictConfig, draws: Sequence[Draw]) -> list[Scenes]:
    """Scenes laid out and pictured."""
    return map_jobs(partial(_draw, cfg), draws, cfg.workers, "confounded scenes")


def _draw(cfg: DictConfig, draw: Draw) -> Scenes:
    """One set of scenes; table top, light and camera do not depend on the world either."""
    c, (catalogue, palette) = cfg.confound, read_palette(cfg.paths.data)
    world = c.worlds[draw.world]
    rng = stream(c.root_seed, "scenes", draw.name)
    rules, setting = LayoutRules.of(cfg.scenes.layout), Setting(world.together, c.present, c.glasses, *world.gap_m)
    layouts = confounded_layouts(rng, draw.count, catalogue.footprints, catalogue.pool(draw.split), rules, setting)
    textures, seeds = rng.choice(catalogue.texture_names("train"), draw.count), rng.integers(2**31, size=draw.count)
    images = render_scenes(layouts, list(textures), seeds.tolist(), palette)
    return Scenes(layouts, images, float(find(to_tensor(images)).present.sum() / layouts.present.sum()))


def demonstrations(
    cfg: DictConfig, layouts: Layouts, user: str, seed: int
) -> tuple[Float[Array, "scene n 2"], Bool[Array, "scene n"]]:
    """Random z_theta [m], main_n_demos a scene, and whether each is valid: the same paths whatever stands there."""
    rng = stream(cfg.confound.root_seed, "paths", user, seed)
    z = random_z_theta(rng, len(layouts), cfg.main_n_demos)
    return z, valid(layouts, z, cfg.users[user])
