"""The contents of a recording: one model, its training data and the scenes to show, from the stages' outputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf
from scipy.special import logit

from pipeline.artifacts.demos import DEMO_KEY, demo_arrays, read_demos, read_trajectories
from pipeline.artifacts.files import data_version, read_arrays, read_table
from pipeline.artifacts.models import fitted_n_demos, model_dir, model_name, weights_path
from pipeline.artifacts.scenes import AddedItems, SceneSet, read_interventions, read_scenes, train_pool
from pipeline.models.base import ValidityModel
from pipeline.models.trained import load_model
from pipeline.world.bezier import lattice
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

REPAIR_COLUMNS = ["method", "variant", "user", "seed", "scene", "start", "valid_end", "accepted"]
CURVE_KEY = ["seed", "user", "n_demos", "step"]
EFFECT_COLUMNS = ["question", "variant", "user", "seed", "scene", "effect", "true_effect"]
RESOLUTION = 2.0**-24  # of P(valid) near 1 as float32; log-odds end at +-16.6
# values of `Shown.outcomes`: in truth, and to the model
REJECTED, ACCEPTED, FALSELY_VALID, FALSELY_INVALID = range(4)


@dataclass(frozen=True)
class Demonstrations:
    """One user's demonstrations in a training scene, the one scene of `layout`."""

    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    z: Float[Array, "demo 2"]  # the fitted paths [m]
    valid: Bool[Array, " demo"]
    samples: tuple[Array, ...]  # each one's trajectory (sample, 4): t [s], x, y, z [m]


@dataclass(frozen=True)
class Shown:
    """A new scene with the model's and the true validity."""

    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    predicted: Float[Array, "side side"]  # P(valid) on `bezier.lattice(side)` as [y, x]
    truth: Bool[Array, "side side"]

    @property
    def outcomes(self) -> UInt8[Array, "side side"]:
        """Return for each map cell whether it is valid, and whether the model (p > 0.5) is wrong about it."""
        accepted = self.predicted > 0.5
        wrong = np.where(accepted, FALSELY_VALID, FALSELY_INVALID)
        return np.where(accepted == self.truth, np.where(accepted, ACCEPTED, REJECTED), wrong).astype(np.uint8)

    @property
    def agreement(self) -> float:
        """Return the share of map cells on which model and truth agree."""
        return float(np.mean((self.predicted > 0.5) == self.truth))


@dataclass(frozen=True)
class Repairs(Shown):
    """One of the model's worst scenes, with its gradient repairs there."""

    start: tuple[int, ...]  # each repair's number in the scene
    z: Float[Array, "repair step 2"]  # the path [m] at every step, including the invalid start
    log_odds: Float[Array, "repair step"]  # of being valid, by the model
    slack: Float[Array, "repair step"]  # clearance in excess of the user's margins [m], inf without margins
    ends_valid: Bool[Array, " repair"]
    unsafe: int  # repairs that the model accepts although their end is invalid, of all in this scene


@dataclass(frozen=True)
class Intervention:
    """do(Z_I := E(I + o)): an item added to the first new scene, in the last occupied slot of `layout`."""

    symbol: str
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    predicted: Float[Array, "side side"]  # maps as in `Shown`
    truth: Bool[Array, "side side"]
    learned: float  # the effect on E[V] in this scene
    true: float
    learned_mean: float  # over `scenes` scenes
    true_mean: float
    scenes: int


@dataclass(frozen=True)
class Learning:
    """The model's training: its losses, and maps of the first new scene."""

    step: Int[Array, " step"]
    losses: Mapping[str, Float[Array, " step"]]  # the learning curve by term
    by_n: Mapping[int, Float[Array, "side side"]]  # of models fitted to that many demonstrations per scene
    by_step: Mapping[int, Float[Array, "side side"]]  # after that many training steps, including the last


@dataclass(frozen=True)
class Run:
    """One model, its training data, and the scenes to show."""

    variant: str
    user: str
    seed: int
    n_demos: int
    profile: str  # of conf/
    data: str  # md5 of data/
    root_seed: int  # of the scenes
    parameters: str  # what the fit read, as YAML
    margins: Margins  # the user's
    demonstrations: tuple[Demonstrations, ...]
    shown: tuple[Shown, ...]  # the first new scenes, the same for all models
    repairs: tuple[Repairs, ...]  # the model's worst new scenes, the worst first
    interventions: tuple[Intervention, ...]  # in the first new scene
    learning: Learning
    facts: dict[str, float]  # of all new scenes: accuracy, repairs, unsafe_repairs, verdicts, verdicts_right

    @property
    def name(self) -> str:
        """Return the recording's file name and id."""
        return model_name(self.variant, self.user, self.seed)

    @property
    def agreement(self) -> float:
        """Return the share of cells, over the maps of the first new scenes, on which model and truth agree."""
        return float(np.mean([scene.agreement for scene in self.shown]))

    def first_step(self, rank: int) -> int:
        """Return where the worst scene of that rank begins on repair_step: after those before it, with a gap each."""
        return rank * (self.repairs[0].log_odds.shape[1] + 1)


def grouped(runs: Sequence[Run], name: str) -> dict[str, list[Run]]:
    """Return the runs of each user, or of each variant, in their original order."""
    names = dict.fromkeys(getattr(run, name) for run in runs)
    return {wanted: [run for run in runs if getattr(run, name) == wanted] for wanted in names}


@dataclass(frozen=True)
class Sources:
    """Outputs of the stages for all models; `samples[offsets[i]:offsets[i + 1]]` belong to row i of `demos`."""

    scenes: SceneSet
    pool: str  # pool of the new scenes
    demos: pd.DataFrame
    samples: Array
    offsets: Array
    repairs: pd.DataFrame  # by gradient
    paths: dict[str, Float[Array, "start step 2"]]  # their steps [m], by model
    added: AddedItems
    effects: pd.DataFrame
    verdicts: pd.DataFrame  # of the effects, with `right`
    accuracy: pd.Series  # by variant, user and seed
    curves: dict[str, pd.DataFrame]  # by variant
    data: str  # md5 of data/


def read_sources(cfg: DictConfig) -> Sources:
    """Read all artefacts shown in recordings; InputError if any is missing."""
    folders = {name: Path(folder) for name, folder in cfg.paths.items() if folder}
    scenes, pool = read_scenes(folders["scenes"]), cfg.protocol.splits[cfg.repair.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    accuracy = read_table(folders["evaluate"] / "accuracy.parquet").query("split == @cfg.repair.split")
    accuracy = accuracy[accuracy["n_demos"] == cfg.main_n_demos].set_index(["variant", "user", "seed"])["accuracy"]
    repairs = read_table(folders["repair"] / "repairs.parquet", REPAIR_COLUMNS).query("method == 'gradient'")
    return Sources(
        scenes, pool, read_demos(folders["demos"]), *read_trajectories(folders["demos"]), repairs,
        read_arrays(folders["repair"] / "paths.npz"),
        read_interventions(folders["intervene"], scenes.layouts[pool]),
        read_table(folders["intervene"] / "effects.parquet", EFFECT_COLUMNS),
        read_table(folders["intervene"] / "summary.csv").query("kind == 'add'"), accuracy,
        {variant: read_table(model_dir(cfg, variant) / "curves.parquet") for variant in cfg.variants},
        data_version(cfg.paths.data),
    )  # fmt: skip


def assemble(cfg: DictConfig, sources: Sources, variant: str, user: str, seed: int) -> Run:
    """Return the contents of one model's recording, with predictions for every map cell, step and added item.

    Its worst scenes are those with most repairs that it accepts although they are invalid, then with most invalid ones.
    """
    n, margins, side = cfg.main_n_demos, cfg.users[user], cfg.record.map_side
    images, layouts = sources.scenes.images[sources.pool], sources.scenes.layouts[sources.pool]

    def own(table: pd.DataFrame) -> pd.DataFrame:
        return table[(table["variant"] == variant) & (table["user"] == user) & (table["seed"] == seed)]

    def maps(model: ValidityModel, images: Array) -> Float[Array, "scene side side"]:
        cells = np.broadcast_to(lattice(side), (len(images), side * side, 2))
        return model.probability(images, cells).reshape(-1, side, side)

    def true_map(layout: Layouts) -> Bool[Array, "side side"]:
        return valid(layout, lattice(side)[None], margins).reshape(side, side)

    by_n_demos = {k: load_model(cfg, variant, user, seed, k) for k in fitted_n_demos(cfg, variant)}
    model = by_n_demos[n]

    pool, demonstrations = train_pool(seed), []
    z, labels = demo_arrays(sources.demos, seed, user, n)
    number = {key: i for i, key in enumerate(sources.demos[DEMO_KEY].itertuples(index=False, name=None))}
    for scene in range(min(cfg.record.training_scenes, len(z))):
        image, layout = sources.scenes.images[pool][scene], sources.scenes.layouts[pool][scene : scene + 1]
        rows = [number[seed, user, scene, demo] for demo in range(n)]
        samples = tuple(sources.samples[sources.offsets[i] : sources.offsets[i + 1]] for i in rows)
        demonstrations.append(Demonstrations(scene, image, layout, z[scene], labels[scene], samples))

    table, paths, repairs = own(sources.repairs), sources.paths[model_name(variant, user, seed)], []
    unsafe, invalid = table["accepted"].astype(bool) & ~table["valid_end"], ~table["valid_end"]
    faults = pd.DataFrame({"scene": table["scene"], "unsafe": unsafe, "invalid": invalid}).groupby("scene").sum()
    worst = faults.sort_values(["unsafe", "invalid"], ascending=False, kind="stable").index[: cfg.record.worst]
    first = range(min(cfg.record.scenes, len(images)))
    views, scenes = {}, list(dict.fromkeys([*first, *worst.tolist()]))
    for scene, predicted in zip(scenes, maps(model, images[scenes]), strict=True):
        layout = layouts[scene : scene + 1]
        views[scene] = Shown(scene, images[scene], layout, predicted, true_map(layout))
    for scene in worst.tolist():
        rows = table["scene"].to_numpy() == scene
        order = np.lexsort((~invalid[rows], ~unsafe[rows]))[: cfg.record.repairs]  # the last key is the first
        chosen = np.flatnonzero(rows)[np.sort(order)]
        z, steps, of_chosen = paths[chosen], paths[chosen].reshape(1, -1, 2), table.iloc[chosen]
        p = model.probability(images[scene][None], steps).reshape(z.shape[:2]).astype(np.float64)
        layout = views[scene].layout
        slacks = slack(layout, clearance(layout, steps.astype(np.float64)), margins).reshape(z.shape[:2])
        start, ends = tuple(of_chosen["start"].tolist()), of_chosen["valid_end"].to_numpy(dtype=bool)
        log_odds = logit(p.clip(RESOLUTION, 1 - RESOLUTION))
        parts = {"start": start, "z": z, "log_odds": log_odds, "slack": slacks, "ends_valid": ends}
        repairs.append(Repairs(**vars(views[scene]), **parts, unsafe=int(faults.loc[scene, "unsafe"])))
    shown = tuple(views[scene] for scene in first)
    right = own(sources.verdicts.assign(seed=seed))["right"].astype(bool)
    facts = {
        "accuracy": round(float(sources.accuracy[variant, user, seed]), 4),
        "repairs": len(table), "unsafe_repairs": int(unsafe.sum()),
        "verdicts": len(right), "verdicts_right": int(right.sum()),
    }  # fmt: skip

    effects, interventions = own(sources.effects), []
    added = sources.added.images[:, 0]
    for i, (symbol, predicted) in enumerate(zip(SYMBOLS, maps(model, added), strict=True)):
        rows = effects[effects["question"] == f"add_{symbol}"].set_index("scene")[["effect", "true_effect"]]
        if len(rows):
            layout, (learned, true) = sources.added.layouts[i][:1], rows.loc[0].tolist()
            means = float(rows["effect"].mean()), float(rows["true_effect"].mean())
            after = (symbol, added[i], layout, predicted, true_map(layout))
            interventions.append(Intervention(*after, learned, true, *means, len(rows)))

    curve = sources.curves[variant].query("user == @user and seed == @seed and n_demos == @n").sort_values("step")
    losses = {str(term): curve[term].to_numpy() for term in curve.columns if term not in CURVE_KEY}
    by_n = {k: shown[0].predicted if m is model else maps(m, images[:1])[0] for k, m in by_n_demos.items()}
    step, by_step = curve["step"].to_numpy(), {}
    for checkpoint in sorted(cfg.checkpoints):
        if weights_path(model_dir(cfg, variant), user, seed, n, checkpoint).is_file():
            by_step[checkpoint] = maps(load_model(cfg, variant, user, seed, n, checkpoint), images[:1])[0]
    trained = int(step[-1]) + 1 if len(step) > 1 else 0  # curve points precede their step's update
    learning = Learning(step, losses, by_n, by_step | {trained: by_n[n]})

    read = ["variants", "users", "protocol", "n_demos", "main_n_demos", str(cfg.variants[variant].stage)]
    fit = OmegaConf.masked_copy(cfg, read)
    fit.variants = {variant: {k: value for k, value in fit.variants[variant].items() if k != "compared"}}  # by studies
    names = variant, user, seed, n, cfg.profile, sources.data, cfg.scenes.root_seed, OmegaConf.to_yaml(fit)
    parts = tuple(demonstrations), shown, tuple(repairs), tuple(interventions)
    return Run(*names, dict(margins), *parts, learning, facts)
