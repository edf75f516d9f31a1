"""Stage confound: what association and what intervention say of a symbol that only stands beside the cause.

Models are fitted in a world where glasses stand beside plates (`studies.confounding.world`) and asked, as stage
intervene asks the ordinary ones, what an added item changes in ordinary scenes.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_arrays, write_json
from pipeline.artifacts.interventions import read_interventions
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.causal.interventions import DIGITS, by_user, study, tally
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.stats.crossed import quartiles
from pipeline.stats.scores import accuracy
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import valid
from studies.confounding.association import association, before_and_after, passes_near, shift
from studies.confounding.training_sets import Draw, Scenes, demonstrations, draw_all

CONFOUNDED, CONTROL = "confounded", "control"  # the world the results are about, and the one without a common cause
POOLS = ("ordinary", CONFOUNDED, CONTROL)  # new scenes in which models are judged
TABLES = (*POOLS, *SYMBOLS)  # what is asked about: those, and the ordinary ones with each symbol added


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json and examples.npz."""
    c, seeds, scenes = cfg.confound, list(cfg.protocol.seeds), read_scenes(Path(cfg.paths.scenes))
    draws = [Draw(train_pool(seed), world, cfg.scenes.per_seed, "train") for world in c.worlds for seed in seeds]
    *drawn, confounded, control = draw_all(cfg, [*draws, *_test_draws(cfg, scenes)])
    ordinary = _ordinary_association(cfg, scenes)
    worlds = {world: drawn[i * len(seeds) : (i + 1) * len(seeds)] for i, world in enumerate(c.worlds)}
    layouts, images, z = _tables(cfg, scenes, [confounded, control])
    answers = _answers(cfg, worlds, images, z)
    truth = np.stack([[valid(table, z, cfg.users[user]) for table in layouts] for user in c.users])
    judged = {world: _world(cfg, world, worlds[world], answers, truth) for world in worlds}
    result = judged[CONFOUNDED]
    metrics = {name: result[name] for name in ("interventions", "verdicts", "confounding", "accuracy")} | {
        "association": {"ordinary": ordinary, CONFOUNDED: result["association"]},
        "null": {u: {p: _commonest(truth[i, TABLES.index(p)]) for p in POOLS} for i, u in enumerate(c.users)},
        "worlds": judged,
        "near_m": c.near_m,
        "seeds": len(seeds),
        "scenes": z.shape[0],
        "paths": z.shape[1],
    }
    write_json(out_dir / "metrics.json", metrics)
    write_arrays(out_dir / "examples.npz", {name: world[0].images[: c.examples] for name, world in worlds.items()})


def _test_draws(cfg: DictConfig, scenes: SceneSet) -> list[Draw]:
    """New scenes of this world and of its control, as many as the ordinary ones and of the same split's items."""
    pool = cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    layouts = scenes.layouts[pool]
    split = read_catalogue(Path(cfg.paths.data)).items["split"].iloc[layouts.item[layouts.present][0]]
    return [Draw(pool, world, len(layouts), str(split)) for world in (CONFOUNDED, CONTROL)]


def _tables(cfg: DictConfig, scenes: SceneSet, own: list[Scenes]) -> tuple[list[Layouts], np.ndarray, np.ndarray]:
    """TABLES' layouts and images (table, scene, 100, 100, 3), and z_theta [m] (scene, path, 2), the same for all."""
    pool, directory = cfg.protocol.splits[cfg.intervene.split], Path(cfg.paths.intervene)
    added, z = read_interventions(directory, scenes.layouts[pool]), read_arrays(directory / "images.npz")["z_theta"]
    layouts = [scenes.layouts[pool], *(s.layouts for s in own), *added.layouts]
    if len({len(z), *map(len, layouts)}) != 1:
        raise InputError(f"{directory} holds {len(z)} scenes, {pool} {len(layouts[0])}: run the intervene stage again")
    return layouts, np.stack([scenes.images[pool], *(s.images for s in own), *added.images]), z


def _answers(cfg: DictConfig, worlds: dict[str, list[Scenes]], images: np.ndarray, z: np.ndarray) -> dict[str, dict]:
    """variant -> world -> P(valid) (user, seed, table, scene, path) by models fitted there."""
    c, seeds = cfg.confound, cfg.protocol.seeds

    def training_set(user: str, seed: int, own: Scenes) -> TrainingSet:
        return TrainingSet(user, seed, own.images, *demonstrations(cfg, own.layouts, user, seed))

    training_sets = {
        variant: [training_set(u, s, own) for w in of for u in c.users for s, own in zip(seeds, worlds[w], strict=True)]
        for variant, of in c.variants.items()
    }
    pictures, everywhere = images.reshape(-1, *images.shape[2:]), np.tile(z, (len(images), 1, 1))
    found = refit_and_predict(cfg, training_sets, pictures, everywhere, "confound")
    shape = (len(c.users), len(seeds), *images.shape[:2], z.shape[1])
    return {v: dict(zip(of, found[v].reshape(len(of), *shape), strict=True)) for v, of in c.variants.items()}


def _confounded_association(cfg: DictConfig, world: list[Scenes]) -> dict:
    """user -> symbol -> `association` over the demonstrations of all seeds."""
    pairs = list(zip([scenes.layouts for scenes in world], cfg.protocol.seeds, strict=True))
    return {u: _associations(cfg, [(x, *demonstrations(cfg, x, u, s)) for x, s in pairs]) for u in cfg.confound.users}


def _ordinary_association(cfg: DictConfig, scenes: SceneSet) -> dict:
    """The same over the demonstrations of stage demos."""
    demos, n = read_demos(Path(cfg.paths.demos)), cfg.main_n_demos
    pairs = [(scenes.layouts[train_pool(seed)], seed) for seed in cfg.protocol.seeds]
    return {u: _associations(cfg, [(x, *demo_arrays(demos, s, u, n)) for x, s in pairs]) for u in cfg.confound.users}


def _associations(cfg: DictConfig, sets: Sequence[tuple[Layouts, np.ndarray, np.ndarray]]) -> dict:
    """symbol -> `association` over several sets of layouts, z_theta and valid."""
    invalid = np.concatenate([~labels for _, _, labels in sets])
    found = {}
    for i, symbol in enumerate(SYMBOLS):
        near = np.concatenate([passes_near(layouts, z, i, cfg.confound.near_m) for layouts, z, _ in sets])
        found[symbol] = association(invalid, near)
    return found


def _world(cfg: DictConfig, world: str, drawn: list[Scenes], answers: dict[str, dict], truth: np.ndarray) -> dict:
    """What labels say in a world, and models fitted there in ordinary scenes and new ones."""
    users, setting = list(cfg.confound.users), cfg.confound.worlds[world]
    by_variant = {variant: by_world[world] for variant, by_world in answers.items() if world in by_world}
    controls = {v: answers[v][CONTROL] for v in by_variant if CONTROL in answers[v] and world != CONTROL}
    cells = {variant: study(*_effects(p), *_effects(truth.astype(float))) for variant, p in by_variant.items()}
    return {
        "together": setting.together,
        "gap_m": list(setting.gap_m),
        "association": _confounded_association(cfg, drawn),
        "things_per_item": round(float(np.mean([scenes.things_per_item for scenes in drawn])), DIGITS),
        "interventions": {variant: by_user(users, of) for variant, of in cells.items()},
        "verdicts": {variant: tally(of) for variant, of in cells.items()},
        "confounding": {v: by_user(users, _confounding(by_variant[v], control)) for v, control in controls.items()},
        "accuracy": {variant: _accuracy(users, p, truth) for variant, p in by_variant.items()},
    }


def _effects(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E[V] before and after each symbol is added to the ordinary scenes, (user * symbol, ..., scene)."""
    return before_and_after(p, TABLES.index("ordinary"), [TABLES.index(symbol) for symbol in SYMBOLS])


def _confounding(p: np.ndarray, control: np.ndarray) -> list[dict]:
    """What the common cause adds to each effect: a world's models against the control's, seed by seed."""
    effects, of_control = (after - before for before, after in (_effects(p), _effects(control)))
    return shift(effects, of_control)


def _accuracy(users: list[str], p: np.ndarray, truth: np.ndarray) -> dict:
    """user -> pool -> accuracy in its new scenes: mean and quartiles over seeds."""
    found: dict[str, dict] = {user: {} for user in users}
    for (i, user), pool in product(enumerate(users), POOLS):
        at = TABLES.index(pool)
        by_seed = np.array([accuracy(of_seed.ravel(), truth[i, at].ravel()) for of_seed in p[i, :, at]])
        found[user][pool] = {name: round(value, DIGITS) for name, value in quartiles(by_seed).items()}
    return found


def _commonest(labels: np.ndarray) -> float:
    """Accuracy of the one answer that is right most often."""
    share = float(labels.mean())
    return round(max(share, 1 - share), DIGITS)


if __name__ == "__main__":
    launch(main, "confound")
