"""Demonstrations as people may give them, with more paths of the same kind that judge a fitted model.

Paths have few families of routes; a kind of them keeps a least distance from the boundary of validity. In each scene
half of the paths are valid where it allows that.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.models import baselines
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.training.loop import TrainingSet
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import Candidates

FEW = "few"  # routes, in tables and in names of random streams
OWN, HELD_OUT = "demonstrations", "held_out"  # splits: its own paths, others on its tables
NEW_ITEMS = "new_items"  # new tables with unseen items
POOLS = {"new_scenes": "val_scenes", NEW_ITEMS: "val_items"}
Labelled = tuple[Float[Array, "scene path 2"], Bool[Array, "scene path"]]


@dataclass(frozen=True)
class JudgedSet(TrainingSet):
    """Demonstrations of one kind, and labelled paths of the same kind by split."""

    clear_cm: int
    judged: dict[str, Labelled]

    @property
    def key(self) -> dict[str, str | int]:
        """Return what distinguishes it from others, as columns of a table."""
        n = self.z_theta.shape[1]
        return {"routes": FEW, "clear_cm": self.clear_cm, "n_demos": n, "user": self.user, "seed": self.seed}

    def first(self, n: int) -> "JudgedSet":
        """Return it with only the first `n` demonstrations of each scene; the other paths stay."""
        own = self.z_theta[:, :n], self.valid[:, :n]
        return replace(self, z_theta=own[0], valid=own[1], judged=self.judged | {OWN: own})


def draw_judged_sets(cfg: DictConfig, scenes: SceneSet) -> Iterator[JudgedSet]:
    """Yield main_n_demos demonstrations of every kind and user in each seed's scenes, with the paths that judge them.

    Kinds and users share candidates (conf/readings.yaml), so that they differ by nothing else.
    """
    readings, n = cfg.readings, cfg.main_n_demos

    def candidates(pool: str) -> Candidates:
        layouts = scenes.layouts[pool]
        rng, shape = stream(readings.root_seed, FEW, pool), (len(layouts), readings.candidates)
        random_z_theta(rng, *shape)  # paths of any route, which nobody asks for: without them all numbers would change
        centre = np.array(readings.families, float)[rng.integers(len(readings.families), size=shape)]
        bearing, reach = rng.uniform(-np.pi, np.pi, shape), readings.family_radius * np.sqrt(rng.random(shape))
        around = np.stack([np.cos(bearing), np.sin(bearing)], -1)
        return Candidates.of(layouts, centre + reach[..., None] * around)

    drawn = {split: (pool, candidates(pool)) for split, pool in POOLS.items()}
    for seed in cfg.protocol.seeds:
        pool = train_pool(seed)
        here = candidates(pool)
        for clear_cm, (user, margins) in product(readings.clear_cm, cfg.users.items()):
            clear = margins, clear_cm / 100
            draw = partial(stream, readings.root_seed, "choose")
            z, valid = here.choose(draw(pool, user, clear_cm), *clear, n + readings.held_out)
            own = z[:, :n], valid[:, :n]
            judged = {OWN: own, HELD_OUT: (z[:, n:], valid[:, n:])}
            for split, (name, some) in drawn.items():
                judged[split] = some.choose(draw(name, user, clear_cm), *clear, readings.held_out)
            yield JudgedSet(user, seed, scenes.images[pool], *own, clear_cm, judged)


def judge(
    scenes: Mapping[str, Array], model: ValidityModel, judged_set: TrainingSet
) -> dict[str, Float[Array, " scene"]]:
    """Return the share of paths in each scene on which the model is right, by split; scenes: images by pool."""
    assert isinstance(judged_set, JudgedSet)
    images = {split: scenes[POOLS[split]] if split in POOLS else judged_set.images for split in judged_set.judged}
    return {s: right(model.probability(images[s], z), v) for s, (z, v) in judged_set.judged.items()}


def judge_blind(prior: Float[Array, "side side"], judged_set: JudgedSet) -> Iterator[dict]:
    """Yield rows with the accuracy of both image-blind baselines."""
    for split, (z, valid) in judged_set.judged.items():
        every = bool(judged_set.valid.all())  # to this user all paths are valid
        p = {POSITION: (baselines.position_only if every else baselines.position_only_of_half)(prior, z)}
        if split == HELD_OUT:
            p[NEAREST] = baselines.nearest_demonstration(judged_set.z_theta, judged_set.valid, z)
        for variant, of_variant in p.items():
            yield row(judged_set, variant, split, right(of_variant, valid))


def right(p: Float[Array, "scene path"], valid: Bool[Array, "scene path"]) -> Float[Array, " scene"]:
    """Return the share of each scene's paths on the correct side of p = 0.5."""
    return ((p > DECISION) == valid).mean(1)


def row(judged_set: JudgedSet, variant: str, split: str, by_scene: Float[Array, " scene"]) -> dict:
    """Return a row of a table of accuracies, with each scene's; `valid`: share of the judged paths that are valid."""
    valid, accuracy = judged_set.judged[split][1].mean(), by_scene.mean()
    key = judged_set.key | {"split": split, "variant": variant}
    return key | {"accuracy": accuracy, "valid": valid, "by_scene": by_scene}
