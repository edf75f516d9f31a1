"""What a recording shows of one model: its demonstrations, repairs, what-ifs and learning, beside the truth."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.demos import DEMO_KEY, demo_arrays
from pipeline.artifacts.interventions import AddedItems
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.causal.counterfactual import NO_SINGLE_CAUSE, attribute
from pipeline.causal.scm import chance_of_change
from pipeline.runtime.errors import InputError
from pipeline.stats.scores import DECISION
from pipeline.viewer.contents import Counterfactual, Demonstrations, Intervention, Learning, Repairs, Run
from pipeline.world.bezier import lattice
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import clearance, slack, valid

Array = np.ndarray
CURVE_KEY = ["seed", "user", "n_demos", "step"]


@dataclass(frozen=True)
class Repaired:
    """The repairs shown in one scene: start numbers, z (repair, step, 2) [m], ends_valid (repair,)."""

    start: Array
    z: Array
    ends_valid: Array


@dataclass(frozen=True)
class Example:
    """A worked example of stage counterfactual: images (1 + item, 100, 100, 3) as it stands and without each item.

    layouts: the same tables; z [m] (2,): the path asked about.
    """

    kind: str
    scene: int
    images: Array
    layouts: Layouts
    z: Array


@dataclass(frozen=True)
class Job:
    """One model and the paths it is asked about."""

    cfg: DictConfig
    variant: str
    user: str
    seed: int
    images: Array  # (scene, 100, 100, 3) of the scenes shown
    repaired: tuple[Repaired, ...]  # one a scene
    added: Array  # (symbol, 100, 100, 3): the first of the scenes with one item more
    examples: tuple[Example, ...]

    @property
    def name(self) -> str:
        """The key of paths.npz."""
        return f"{self.variant}-{self.user}-s{self.seed}"


@dataclass(frozen=True)
class Belief:
    """A model's P(valid): maps (scene, side, side) as [y, x], and per scene (repair, step) along its repairs.

    added (symbol, side, side): the first scene's map with one item more; by_n, by_step (side, side): its map as it is,
    by the models fitted to each n and along the training; answers: per example (question,).
    """

    maps: Array
    steps: tuple[Array, ...]
    added: Array
    by_n: dict[int, Array]
    by_step: dict[int, Array]
    answers: tuple[Array, ...]


@dataclass(frozen=True)
class Demos:
    """The demos stage's outputs; `samples[offsets[i]:offsets[i + 1]]` is the recording of row i of `table`."""

    table: pd.DataFrame
    samples: Array
    offsets: Array


@dataclass(frozen=True)
class Sources:
    """What the stages wrote, of all models: the scenes and the pool shown of them, effects, curves by variant."""

    scenes: SceneSet
    pool: str
    demos: Demos
    added: AddedItems
    effects: pd.DataFrame
    curves: dict[str, pd.DataFrame]


def contents(sources: Sources, job: Job, belief: Belief) -> Run:
    """All that the recording of one model holds."""
    cfg = job.cfg
    truth = _truth(cfg, sources.scenes, sources.pool, job.user)
    return Run(
        variant=job.variant,
        user=job.user,
        seed=job.seed,
        n=cfg.main_n_demos,
        margins=dict(cfg.users[job.user]),
        demonstrations=_demonstrations(cfg, sources.scenes, sources.demos, job.user, job.seed),
        repairs=_repairs(job, belief, sources.scenes, sources.pool, truth),
        interventions=_interventions(job, belief, sources.added, sources.effects),
        counterfactuals=tuple(_counterfactual(job, x, p) for x, p in zip(job.examples, belief.answers, strict=True)),
        learning=_learning(job, belief, sources.curves[job.variant]),
    )


def _truth(cfg: DictConfig, scenes: SceneSet, pool: str, user: str) -> Array:
    """The user's rule on the maps' lattice: (scene, side, side) as [y, x]."""
    side = cfg.record.map_side
    layouts = scenes.layouts[pool][: cfg.record.scenes]
    cells = np.broadcast_to(lattice(side), (len(layouts), side * side, 2))
    return valid(layouts, cells, cfg.users[user]).reshape(-1, side, side)


def _demonstrations(
    cfg: DictConfig, scenes: SceneSet, demos: Demos, user: str, seed: int
) -> tuple[Demonstrations, ...]:
    """What the model was fitted to, in the first of its training scenes."""
    pool, n = train_pool(seed), cfg.main_n_demos
    z, truth = demo_arrays(demos.table, seed, user, n)
    row = {key: i for i, key in enumerate(demos.table[DEMO_KEY].itertuples(index=False, name=None))}
    shown = []
    for scene in range(min(cfg.record.training_scenes, len(z))):
        rows = [row[seed, user, scene, demo] for demo in range(n)]
        samples = tuple(demos.samples[demos.offsets[i] : demos.offsets[i + 1]] for i in rows)
        shown.append(
            Demonstrations(
                scene,
                scenes.images[pool][scene],
                scenes.layouts[pool][scene : scene + 1],
                z[scene],
                truth[scene],
                samples,
            )
        )
    return tuple(shown)


def _repairs(job: Job, belief: Belief, scenes: SceneSet, pool: str, truth: Array) -> tuple[Repairs, ...]:
    """The scenes shown, with what the model and the truth say in each."""
    repairs = []
    for scene, shown in enumerate(job.repaired):
        layout = scenes.layouts[pool][scene : scene + 1]
        paths = shown.z.reshape(1, -1, 2).astype(np.float64)
        room = slack(layout, clearance(layout, paths), job.cfg.users[job.user])
        repairs.append(
            Repairs(
                scene=scene,
                image=job.images[scene],
                layout=layout,
                predicted=belief.maps[scene],
                truth=truth[scene],
                start=tuple(int(start) for start in shown.start),
                z=shown.z,
                p=belief.steps[scene],
                slack=room.reshape(shown.z.shape[:2]),
                ends_valid=shown.ends_valid,
            )
        )
    return tuple(repairs)


def _interventions(job: Job, belief: Belief, added: AddedItems, effects: pd.DataFrame) -> tuple[Intervention, ...]:
    """Each symbol added to the first scene, and its first placement's effects there and in all scenes."""
    side = job.cfg.record.map_side
    of_model = (effects["variant"] == job.variant) & (effects["user"] == job.user) & (effects["seed"] == job.seed)
    rows = effects[of_model & (effects["placement"] == 0)]
    interventions = []
    for i, symbol in enumerate(SYMBOLS):
        of_symbol = rows[rows["symbol"] == symbol].set_index("scene")[["effect", "true_effect"]]
        if 0 not in of_symbol.index:
            raise InputError(
                f"{job.cfg.paths.intervene}: no effect of a {symbol} on {job.name}; run stage intervene again"
            )
        layout = added.layouts[i][:1]
        interventions.append(
            Intervention(
                symbol=symbol,
                image=job.added[i],
                layout=layout,
                predicted=belief.added[i],
                truth=valid(layout, lattice(side)[None], job.cfg.users[job.user]).reshape(side, side),
                learned=float(of_symbol.loc[0, "effect"]),
                true=float(of_symbol.loc[0, "true_effect"]),
                learned_mean=float(of_symbol["effect"].mean()),
                true_mean=float(of_symbol["true_effect"].mean()),
                scenes=len(of_symbol),
            )
        )
    return tuple(interventions)


def _counterfactual(job: Job, example: Example, p: Array) -> Counterfactual:
    """A worked example as the model and the truth answer it."""
    paths = np.tile(example.z, (len(example.images), 1, 1))
    truth = valid(example.layouts, paths, job.cfg.users[job.user])[:, 0]
    return Counterfactual(
        kind=example.kind,
        scene=example.scene,
        image=example.images[0],
        layout=example.layouts[:1],
        z=example.z,
        without=example.images[1:],
        p=p,
        truth=truth,
        blamed=_blamed(p),
        culprit=_blamed(truth.astype(np.float64)),
    )


def _blamed(p: Array) -> int | None:
    """The item whose absence is most probably necessary; p (1 + item,): P(valid) as it stands and without each."""
    if p[0] > DECISION:
        return None
    item = int(attribute(chance_of_change(False, p[:1], p[1:])))
    return None if item == NO_SINGLE_CAUSE else item


def _learning(job: Job, belief: Belief, curves: pd.DataFrame) -> Learning:
    """The losses of the model shown, and the first scene's map by every n and along the training."""
    of_model = (curves["user"] == job.user) & (curves["seed"] == job.seed) & (curves["n_demos"] == job.cfg.main_n_demos)
    rows = curves[of_model].sort_values("step")
    terms = {str(term): rows[term].to_numpy() for term in rows.columns if term not in CURVE_KEY}
    steps = rows["step"].to_numpy()
    trained = steps[-1] + 1 if len(steps) > 1 else 0  # a curve's points lie before their updates; a constant has one
    by_step = {**belief.by_step, int(trained): belief.by_n[job.cfg.main_n_demos]}
    return Learning(steps, terms, belief.by_n, by_step)
