"""Read the outputs of the stages, and assemble the contents of one model's recording."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import DEMO_KEY, demo_arrays, read_demos, read_trajectories
from pipeline.artifacts.files import data_version, read_arrays, read_table
from pipeline.artifacts.models import fitted_n_demos, model_dir, model_name, weights_path
from pipeline.artifacts.scenes import AddedItems, SceneSet, read_interventions, read_scenes, train_pool
from pipeline.models.base import ValidityModel
from pipeline.models.trained import load_model
from pipeline.runtime.errors import InputError
from pipeline.viewer.contents import Demonstrations, Intervention, Learning, Repairs, Run
from pipeline.world.bezier import lattice
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import clearance, slack, valid

CURVE_KEY = ["seed", "user", "n_demos", "step"]
REPAIR_COLUMNS = ["method", "variant", "user", "seed", "scene", "start", "valid_end"]
EFFECT_COLUMNS = ["question", "variant", "user", "seed", "scene", "effect", "true_effect"]


@dataclass(frozen=True)
class Sources:
    """Outputs of the stages for all models.

    `samples[offsets[i]:offsets[i + 1]]` is the trajectory of row i of `demos`.
    """

    scenes: SceneSet
    pool: str  # pool of the new scenes
    demos: pd.DataFrame
    samples: Array
    offsets: Array
    repairs: pd.DataFrame
    paths: dict[str, Array]
    added: AddedItems
    effects: pd.DataFrame
    curves: dict[str, pd.DataFrame]  # by variant
    data: str  # md5 of data/


def read_sources(cfg: DictConfig) -> Sources:
    """Read all artefacts shown in recordings; InputError if any is missing or if they disagree."""
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[cfg.repair.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    return Sources(
        scenes,
        pool,
        read_demos(Path(cfg.paths.demos)),
        *read_trajectories(Path(cfg.paths.demos)),
        *_read_repairs(cfg),
        read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool]),
        read_table(Path(cfg.paths.intervene) / "effects.parquet", EFFECT_COLUMNS),
        {variant: read_table(model_dir(cfg, variant) / "curves.parquet") for variant in cfg.variants},
        data_version(cfg.paths.data),
    )


def _read_repairs(cfg: DictConfig) -> tuple[pd.DataFrame, dict[str, Float[Array, "start step 2"]]]:
    """Return the gradient repairs, and each model's paths [m] by name; InputError if they do not agree."""
    folder = Path(cfg.paths.repair)
    table = read_table(folder / "repairs.parquet", REPAIR_COLUMNS).query("method == 'gradient'")
    paths = read_arrays(folder / "paths.npz")
    counts = table.groupby(["variant", "user", "seed"]).size().to_dict()
    for key in product(cfg.variants, cfg.users, cfg.protocol.seeds):
        name, expected, count = model_name(*key), counts.get(key, 0), len(paths.get(model_name(*key), ()))
        if count != expected:
            raise InputError(f"{folder}: {expected} repairs of {name}, {count} paths; run the repair stage again")
    return table, paths


def assemble(cfg: DictConfig, sources: Sources, variant: str, user: str, seed: int) -> Run:
    """Return the contents of one model's recording, with predictions for every map cell, step and added item."""
    by_n_demos = {n: load_model(cfg, variant, user, seed, n) for n in fitted_n_demos(cfg, variant)}
    model = by_n_demos[cfg.main_n_demos]
    repairs = _repairs(cfg, sources, model, variant, user, seed)
    first = sources.scenes.images[sources.pool][:1]
    by_n = {n: repairs[0].predicted if m is model else _maps(cfg, m, first)[0] for n, m in by_n_demos.items()}
    return Run(
        variant=variant,
        user=user,
        seed=seed,
        n_demos=cfg.main_n_demos,
        profile=cfg.profile,
        data=sources.data,
        root_seed=cfg.scenes.root_seed,
        parameters=_parameters(cfg, variant),
        margins=dict(cfg.users[user]),
        demonstrations=_demonstrations(cfg, sources, user, seed),
        repairs=repairs,
        interventions=_interventions(cfg, sources, model, variant, user, seed),
        learning=_learning(cfg, sources, by_n, variant, user, seed),
    )


def _parameters(cfg: DictConfig, variant: str) -> str:
    """Return as YAML what a variant's fit read."""
    stage = str(cfg.variants[variant].stage)
    names = ["variants", "users", "protocol", "n_demos", "main_n_demos", stage]
    kept = OmegaConf.masked_copy(cfg, names)
    kept.variants = {variant: cfg.variants[variant]}
    return OmegaConf.to_yaml(kept)


def _maps(cfg: DictConfig, model: ValidityModel, images: Array) -> Float[Array, "scene side side"]:
    """Return the model's P(valid) over z_theta as [y, x], for each image."""
    side = cfg.record.map_side
    cells = np.broadcast_to(lattice(side), (len(images), side * side, 2))
    return model.probability(images, cells).reshape(-1, side, side)


def _true_map(cfg: DictConfig, layout: Layouts, user: str) -> Array:
    """Return the user's true validity over z_theta as [y, x], for the one scene in `layout`."""
    side = cfg.record.map_side
    return valid(layout, lattice(side)[None], cfg.users[user]).reshape(side, side)


def _demonstrations(cfg: DictConfig, sources: Sources, user: str, seed: int) -> tuple[Demonstrations, ...]:
    """Return the demonstrations in the first of the model's training scenes."""
    pool, n = train_pool(seed), cfg.main_n_demos
    z, truth = demo_arrays(sources.demos, seed, user, n)
    row = {key: i for i, key in enumerate(sources.demos[DEMO_KEY].itertuples(index=False, name=None))}
    shown = []
    for scene in range(min(cfg.record.training_scenes, len(z))):
        image, layout = sources.scenes.images[pool][scene], sources.scenes.layouts[pool][scene : scene + 1]
        rows = [row[seed, user, scene, demo] for demo in range(n)]
        samples = tuple(sources.samples[sources.offsets[i] : sources.offsets[i + 1]] for i in rows)
        shown.append(Demonstrations(scene, image, layout, z[scene], truth[scene], samples))
    return tuple(shown)


def _repairs(
    cfg: DictConfig, sources: Sources, model: ValidityModel, variant: str, user: str, seed: int
) -> tuple[Repairs, ...]:
    """Return the first new scenes with the first repairs in each."""
    table = sources.repairs
    rows = table[(table["variant"] == variant) & (table["user"] == user) & (table["seed"] == seed)]
    paths = sources.paths[model_name(variant, user, seed)]
    images = sources.scenes.images[sources.pool][: cfg.record.scenes]
    repairs = []
    for scene, (image, predicted) in enumerate(zip(images, _maps(cfg, model, images), strict=True)):
        layout = sources.scenes.layouts[sources.pool][scene : scene + 1]
        chosen = np.flatnonzero(rows["scene"].to_numpy() == scene)[: cfg.record.repairs]
        z, steps = paths[chosen], paths[chosen].reshape(1, -1, 2)
        p = model.probability(image[None], steps) if len(z) else np.zeros(0)
        slacks = slack(layout, clearance(layout, steps.astype(np.float64)), cfg.users[user])
        repairs.append(
            Repairs(
                scene=scene,
                image=image,
                layout=layout,
                predicted=predicted,
                truth=_true_map(cfg, layout, user),
                start=tuple(rows["start"].iloc[chosen].tolist()),
                z=z,
                p=p.reshape(z.shape[:2]),
                slack=slacks.reshape(z.shape[:2]),
                ends_valid=rows["valid_end"].iloc[chosen].to_numpy(dtype=bool),
            )
        )
    return tuple(repairs)


def _interventions(
    cfg: DictConfig, sources: Sources, model: ValidityModel, variant: str, user: str, seed: int
) -> tuple[Intervention, ...]:
    """Return each symbol that a question adds, in the first new scene, with its effects there and in all scenes."""
    table = sources.effects
    rows = table[(table["variant"] == variant) & (table["user"] == user) & (table["seed"] == seed)]
    images = sources.added.images[:, 0]
    interventions = []
    for i, (symbol, predicted) in enumerate(zip(SYMBOLS, _maps(cfg, model, images), strict=True)):
        question = f"add_{symbol}"
        if question not in set(table["question"]):
            continue
        effects = rows[rows["question"] == question].set_index("scene")[["effect", "true_effect"]]
        layout = sources.added.layouts[i][:1]
        interventions.append(
            Intervention(
                symbol=symbol,
                image=images[i],
                layout=layout,
                predicted=predicted,
                truth=_true_map(cfg, layout, user),
                learned=float(effects.loc[0, "effect"]),
                true=float(effects.loc[0, "true_effect"]),
                learned_mean=float(effects["effect"].mean()),
                true_mean=float(effects["true_effect"].mean()),
                scenes=len(effects),
            )
        )
    return tuple(interventions)


def _learning(
    cfg: DictConfig, sources: Sources, by_n: dict[int, Array], variant: str, user: str, seed: int
) -> Learning:
    """Return the model's losses, and the first new scene's map by number of demonstrations and by training step."""
    n, table, first = cfg.main_n_demos, sources.curves[variant], sources.scenes.images[sources.pool][:1]
    of_model = (table["user"] == user) & (table["seed"] == seed) & (table["n_demos"] == n)
    rows = table[of_model].sort_values("step")
    losses = {str(term): rows[term].to_numpy() for term in rows.columns if term not in CURVE_KEY}
    step = rows["step"].to_numpy()
    by_step = {}
    for checkpoint in sorted(cfg.checkpoints):
        if weights_path(model_dir(cfg, variant), user, seed, n, checkpoint).is_file():
            by_step[checkpoint] = _maps(cfg, load_model(cfg, variant, user, seed, n, checkpoint), first)[0]
    trained = int(step[-1]) + 1 if len(step) > 1 else 0  # curve points precede their step's update
    return Learning(step, losses, by_n, by_step | {trained: by_n[n]})
