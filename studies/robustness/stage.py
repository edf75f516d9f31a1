"""Stage robustness: how well models judge paths where pictures, tables or labels are worse than in training."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from pipeline.spec.strangeness import Looks, strange
from tqdm import tqdm

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import write_arrays, write_json
from pipeline.artifacts.scenes import SceneSet, read_position_prior, read_scenes, train_pool
from pipeline.artifacts.trained import ask, check_weights
from pipeline.causal.interventions import DIGITS
from pipeline.launch import launch
from pipeline.models import baselines as nulls
from pipeline.params import need
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import estimate
from pipeline.stats.scores import DECISION, expected_calibration_error
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import LayoutRules
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid
from studies.robustness.corruptions import PICTURES, cluttered, mislabelled
from studies.robustness.losses import change, kept, more_accepted, score

LABELS = "labels"
Answers = dict[str, Float[Array, "user seed scene path"]]  # variant -> P(valid)


@dataclass(frozen=True)
class Level:
    """The scenes, worse in one way to one degree."""

    disturbance: str
    strength: float | int | str | None  # None: as they are
    images: UInt8[Array, "scene 100 100 3"]
    truth: Bool[Array, "user scene path"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json, and examples.npz: the first scene as it is and under each disturbance at its strongest."""
    check_weights(cfg)
    scenes, catalogue = read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data))
    levels, z = _levels(cfg, scenes, catalogue)
    as_is, *worse = levels
    first, *others = _answers(cfg, levels, z)
    called = _called_strange(cfg, scenes, levels)
    disturbed: dict[str, list[dict]] = {}
    for level, answers, odd in zip(worse, others, called[1:], strict=True):
        entry = _entry(cfg, level.strength, answers, level.truth, first, as_is.truth)
        left = {variant: kept(answers[variant] > DECISION, level.truth, ~odd) for variant in cfg.variants}
        disturbed.setdefault(level.disturbance, []).append(entry | {"strange": _share(odd), "kept": left})
    disturbed[LABELS] = [
        _entry(cfg, share, answers, as_is.truth, first, as_is.truth)
        for share, answers in _mislabelled(cfg, scenes, as_is.images, z).items()
    ]
    metrics = {
        "order": list(disturbed),
        "undisturbed": {
            "valid": round(float(as_is.truth.mean()), DIGITS),
            "models": _scores(cfg, first, as_is.truth),
            "strange": _share(called[0]),
            "kept": {variant: kept(first[variant] > DECISION, as_is.truth, ~called[0]) for variant in cfg.variants},
        },
        "disturbed": disturbed,
        "users": list(cfg.evaluate.users),
        "seeds": len(cfg.protocol.seeds),
        "per_seed": cfg.scenes.per_seed,
        "scenes": z.shape[0],
        "paths": z.shape[1],
    }
    write_json(out_dir / "metrics.json", metrics)
    write_arrays(out_dir / "examples.npz", {level.disturbance: level.images[0] for level in levels})


def _levels(
    cfg: DictConfig, scenes: SceneSet, catalogue: Catalogue
) -> tuple[list[Level], Float[Array, "scene path 2"]]:
    """The scenes as they are and under every disturbance, the weakest first; and the paths [m], the same for all."""
    r, few = cfg.robustness, slice(cfg.robustness.scenes)
    pool, users = cfg.protocol.splits[cfg.robustness.split], list(cfg.evaluate.users)
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    queries, there = read_queries(Path(cfg.paths.demos)).get(pool), len(scenes.images[pool])
    if queries is None or not set(users) <= set(queries.valid):
        raise InputError(f"no queries of {', '.join(users)} in {pool}: run the demos stage again")
    need(cfg, "robustness.scenes", r.scenes <= there, f"at most {there}, as {pool} has")
    unseen = catalogue.texture_names("unseen")
    some = len(r.tables) > 0 and set(r.tables) <= set(unseen)
    need(cfg, "robustness.tables", some, f"some of {', '.join(unseen)}")
    images, layouts, looks = scenes.images[pool][few], scenes.layouts[pool][few], scenes.appearances[pool][few]
    z, truth = queries.z[few], np.stack([queries.valid[user][few] for user in users])
    textures, lights = looks["texture"].tolist(), looks["render_seed"].tolist()
    palette, rules = Palette(catalogue), LayoutRules.of(cfg.scenes.layout)
    split = str(catalogue.items["split"].iloc[layouts.item[layouts.present][0]])  # the scenes' own items'

    def rng(*names: str) -> np.random.Generator:
        return stream(r.root_seed, *names)

    levels = [Level("as_is", None, images, truth)]
    for name, strengths in r.pictures.items():
        for strength in strengths or ():
            levels.append(Level(name, strength, PICTURES[name](rng(name), images, float(strength)), truth))
    for table in r.tables:
        levels.append(Level("tables", table, render_scenes(layouts, [table] * len(z), lights, palette), truth))
    for more in r.clutter:
        fuller = cluttered(rng("clutter"), layouts, more, catalogue.footprints, catalogue.pool(split), rules)
        validity = np.stack([valid(fuller, z, cfg.users[user]) for user in users])
        levels.append(Level("clutter", more, render_scenes(fuller, textures, lights, palette), validity))
    return levels, z


def _answers(cfg: DictConfig, levels: list[Level], z: Float[Array, "scene path 2"]) -> list[Answers]:
    """What every variant and the null answer at each level; the null, which has no seeds, as if it had one."""
    users, prior = list(cfg.evaluate.users), read_position_prior(Path(cfg.paths.scenes))
    images, everywhere = np.concatenate([level.images for level in levels]), np.tile(z, (len(levels), 1, 1))
    found = ask(cfg, users, images, everywhere, "robustness")
    found[nulls.POSITION] = np.stack([nulls.position(prior[user], everywhere) for user in users])[:, None]
    parts = {variant: np.split(p, len(levels), axis=2) for variant, p in found.items()}
    return [{variant: of[i] for variant, of in parts.items()} for i in range(len(levels))]


def _called_strange(cfg: DictConfig, scenes: SceneSet, levels: list[Level]) -> list[Bool[Array, "seed scene"]]:
    """At each level, which pictures are unlike each seed's own training pictures."""
    own = [Looks.of(scenes.images[train_pool(seed)]) for seed in cfg.protocol.seeds]
    there = [Looks.of(level.images) for level in tqdm(levels, desc="looks")]
    return [np.stack([strange(of_seed, looks) for of_seed in own]) for looks in there]


def _share(odd: Bool[Array, "seed scene"]) -> dict[str, float]:
    """Share of the pictures that are strange, with its 95 % interval."""
    e = estimate(odd[None].astype(float))
    shares = {"mean": e.effect, "ci_low": e.ci_low, "ci_high": e.ci_high}
    return {name: round(float(np.clip(value[0], 0, 1)), DIGITS) for name, value in shares.items()}


def _mislabelled(cfg: DictConfig, scenes: SceneSet, images: np.ndarray, z: np.ndarray) -> dict[float, Answers]:
    """share -> variant -> P(valid) by models fitted to demonstrations of which that share is labelled wrongly."""
    demos, users, seeds = read_demos(Path(cfg.paths.demos)), list(cfg.evaluate.users), list(cfg.protocol.seeds)
    shares = cfg.robustness.mislabelled

    def training_set(share: float, user: str, seed: int) -> TrainingSet:
        paths, labels = demo_arrays(demos, seed, user, cfg.main_n_demos)
        rng = stream(cfg.robustness.root_seed, LABELS, user, seed)
        return TrainingSet(user, seed, scenes.images[train_pool(seed)], paths, mislabelled(rng, labels, float(share)))

    training_sets = {
        variant: [training_set(*of) for of in product(own, users, seeds)] for variant, own in shares.items()
    }
    found = refit_and_predict(cfg, training_sets, images, z, "mislabelled")
    by_share: dict[float, Answers] = {share: {} for share in sorted({x for own in shares.values() for x in own})}
    for variant, own in shares.items():
        answers = found[variant].reshape(len(own), len(users), len(seeds), *z.shape[:2])
        for share, p in zip(own, answers, strict=True):
            by_share[share][variant] = p
    return by_share


def _scores(cfg: DictConfig, answers: Answers, truth: np.ndarray) -> dict[str, dict]:
    """variant -> `score`, each user's accuracy by name, and the calibration error of all answers together."""
    cells = {}
    for variant, p in answers.items():
        cell, known = score(p > DECISION, truth), np.broadcast_to(truth[:, None], p.shape)
        by_user = dict(zip(cfg.evaluate.users, cell["by_user"], strict=True))
        ece = expected_calibration_error(p.ravel(), known.ravel(), cfg.evaluate.bins)
        cells[variant] = cell | {"by_user": by_user, "ece": round(ece, DIGITS)}
    return cells


def _entry(
    cfg: DictConfig,
    strength: float | int | str | None,
    answers: Answers,
    truth: np.ndarray,
    first: Answers,
    as_is: np.ndarray,
) -> dict[str, object]:
    """One strength of a disturbance: every variant's numbers, and what changes of its accuracy as it is."""
    models = _scores(cfg, answers, truth)
    for variant, p in answers.items():
        both = p > DECISION, truth, first[variant] > DECISION, as_is
        models[variant] |= {**change(*both), "more_accepted": more_accepted(*both)}
    return {"strength": strength, "valid": round(float(truth.mean()), DIGITS), "models": models}


if __name__ == "__main__":
    launch(main, "robustness")
