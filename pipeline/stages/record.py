"""Stage record: a Rerun recording per variant, user and seed, an overview of them, and a digest of what each holds."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.added import Added, read_added
from pipeline.artifacts.demos import DEMO_KEY, demo_arrays, read_demos, read_recordings
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_table, write_whole
from pipeline.artifacts.models import model_dir, weights_path
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.causal.counterfactual import DECISION, NOBODY, blame, keep
from pipeline.causal.scm import chance_of_change
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.params import InputError
from pipeline.recording.contents import Counterfactual, Demonstrations, Intervention, Learning, Repairs, Run
from pipeline.recording.digest import digest
from pipeline.recording.overview import write_overview
from pipeline.recording.run import write_run
from pipeline.spec.specification import Specification
from pipeline.table.bezier import lattice
from pipeline.table.layout import SYMBOLS, Layouts
from pipeline.table.rules import clearance, slack, valid

Array = np.ndarray
REPAIR_COLUMNS = ["method", "seed", "user", "scene", "start", "valid_end"]
EFFECT_COLUMNS = ["variant", "seed", "user", "scene", "symbol", "placement", "effect", "true_effect"]
CURVE_KEY = ["seed", "user", "n", "step"]


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


def main(cfg: DictConfig, out_dir: Path) -> None:
    """runs/{variant}-{user}-s{seed}.rrd of every model at study_n, overview.rrd of the first seed's, recordings.csv.

    recordings.csv has each recording's digest and, of a run, the share of its latent maps that agrees with the truth.
    """
    _check(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = _pool(cfg, scenes)
    demos = Demos(read_demos(Path(cfg.paths.demos)), *read_recordings(Path(cfg.paths.demos)))
    added = read_added(Path(cfg.paths.intervene), scenes.layouts[pool].symbol.shape[1])
    examples, caring = _examples(cfg, scenes), _caring(cfg)
    jobs = _jobs(cfg, scenes.images[pool], added.images[:, 0], {user: examples for user in caring})
    effects = read_table(Path(cfg.paths.intervene) / "effects.parquet", EFFECT_COLUMNS)
    curves = {variant: read_table(model_dir(cfg, variant) / "curves.parquet") for variant in cfg.variants}
    # In this process: Rerun has hung beside processes of torch, and starting them costs more than they save.
    beliefs = map_jobs(believe, jobs, 1, "latent maps")
    truths = {user: _truth(cfg, scenes, pool, user) for user in cfg.users}
    users = caring or list(cfg.users)
    rows, compared = [], []
    for job, belief in zip(tqdm(jobs, desc="recordings"), beliefs, strict=True):
        content = Run(
            variant=job.variant,
            user=job.user,
            seed=job.seed,
            n=cfg.study_n,
            margins=dict(cfg.users[job.user]),
            demonstrations=_demonstrations(cfg, scenes, demos, job.user, job.seed),
            repairs=_repairs(job, belief, scenes, pool, truths[job.user]),
            interventions=_interventions(job, belief, added, effects),
            counterfactuals=tuple(map(partial(_counterfactual, job), job.examples, belief.answers)),
            learning=_learning(job, belief, curves[job.variant]),
        )
        path = out_dir / "runs" / f"{content.name}.rrd"
        write_whole(path, lambda part, content=content: write_run(part, content))
        rows.append({"run": content.name, "sha256": digest(path), "agreement": content.agreement})
        if job.seed == cfg.protocol.seeds[0] and job.user in users:
            compared.append(content)
    compared.sort(key=lambda run: (*cfg.record.first, run.variant).index(run.variant))
    path = out_dir / "overview.rrd"
    write_whole(path, lambda part: write_overview(part, compared))
    rows.append({"run": "overview", "sha256": digest(path)})
    write_table(out_dir / "recordings.csv", pd.DataFrame(rows))


def believe(job: Job) -> Belief:
    """What a model makes of every cell of its latent maps, every step of its repairs and every question asked of it."""
    fitted = {n: load_model(job.cfg, job.variant, job.user, job.seed, n) for n in job.cfg.n}
    model, side = fitted[job.cfg.study_n], job.cfg.record.map_side

    def maps(model: Specification, images: Array) -> Array:
        cells = np.broadcast_to(lattice(side), (len(images), side * side, 2))
        return model.probability(images, cells).reshape(-1, side, side)

    steps = []
    for image, shown in zip(job.images, job.repaired, strict=True):
        p = model.probability(image[None], shown.z.reshape(1, -1, 2)) if len(shown.z) else np.zeros(0)
        steps.append(p.reshape(shown.z.shape[:2]))
    of_scenes = maps(model, job.images)
    first = job.images[:1]
    by_n = {n: of_scenes[0] if other is model else maps(other, first)[0] for n, other in fitted.items()}
    by_step = {step: maps(early, first)[0] for step, early in _snapshots(job)}
    answers = [model.probability(x.images, np.tile(x.z, (len(x.images), 1, 1)))[:, 0] for x in job.examples]
    return Belief(of_scenes, tuple(steps), maps(model, job.added), by_n, by_step, tuple(answers))


def _snapshots(job: Job) -> Iterator[tuple[int, Specification]]:
    """The model as it was before each step of `cfg.snapshots`, of those that its training had."""
    directory, which = model_dir(job.cfg, job.variant), (job.user, job.seed, job.cfg.study_n)
    for step in sorted(job.cfg.snapshots):
        if weights_path(directory, *which, step).is_file():
            yield step, load_model(job.cfg, job.variant, *which, step)


def _check(cfg: DictConfig) -> None:
    """Raise InputError for the first value of conf/record out of its range, or the first model missing."""
    for name, low in (("scenes", 1), ("repairs", 1), ("training_scenes", 1), ("map_side", 2)):
        value = cfg.record[name]
        if not (isinstance(value, int) and value >= low):
            raise InputError(f"record.{name} is {value!r}: expected a whole number from {low}")
    unknown = [variant for variant in cfg.record.first if variant not in cfg.variants]
    if unknown:
        raise InputError(f"record.first names {unknown[0]!r}: expected some of {', '.join(cfg.variants)}")
    check_weights(cfg)


def _caring(cfg: DictConfig) -> list[str]:
    """The users who keep clear of something: all is valid to the others."""
    return [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]


def _pool(cfg: DictConfig, scenes: SceneSet) -> str:
    """The pool the repairs were made in and intervened on."""
    pool = cfg.protocol.splits.get(cfg.repair.split)
    if cfg.protocol.splits.get(cfg.intervene.split) != pool:
        raise InputError(
            f"intervene.split is {cfg.intervene.split!r}, repair.split {cfg.repair.split!r}: expected the same scenes, "
            "since a recording shows both"
        )
    if pool is None or pool not in scenes.images:
        raise InputError(
            f"repair.split {cfg.repair.split!r} stands for scenes {pool!r}: "
            f"expected one of {', '.join(scenes.images)}; run the scenes stage"
        )
    return pool


def _examples(cfg: DictConfig, scenes: SceneSet) -> tuple[Example, ...]:
    """The worked examples of stage counterfactual."""
    directory, pool = Path(cfg.paths.counterfactual), cfg.protocol.splits[cfg.counterfactual.split]
    told, images = read_json(directory / "metrics.json")["examples"], read_arrays(directory / "examples.npz")
    examples = []
    for i, example in enumerate(told):
        layout = scenes.layouts[pool][[example["scene"]]]
        slots = np.flatnonzero(layout.present[0])
        absent = np.eye(layout.present.shape[1], dtype=bool)[slots]
        kept = layout.present & ~np.concatenate([np.zeros_like(absent[:1]), absent])  # (1 + item, slot)
        pictures = np.concatenate([images["whole"][i][None], images["without"][i][slots]])
        tables = keep(layout[np.zeros(len(kept), dtype=int)], kept)
        examples.append(Example(example["kind"], example["scene"], pictures, tables, np.array(example["z_theta"])))
    return tuple(examples)


def _jobs(cfg: DictConfig, images: Array, added: Array, examples: dict[str, tuple[Example, ...]]) -> list[Job]:
    """Every model, with the repairs and the examples (by user) to show of it."""
    table = read_table(Path(cfg.paths.repair) / "repairs.parquet", REPAIR_COLUMNS)
    paths = read_arrays(Path(cfg.paths.repair) / "paths.npz")
    shown = images[: cfg.record.scenes]
    jobs = []
    for variant in cfg.variants:
        for user in cfg.users:
            of_user = table[(table["method"] == variant) & (table["user"] == user)]
            for seed in cfg.protocol.seeds:
                rows, name = of_user[of_user["seed"] == seed], f"{variant}-{user}-s{seed}"
                if name not in paths or len(paths[name]) != len(rows):
                    raise InputError(
                        f"{cfg.paths.repair}: {len(rows)} repairs of {name}, {len(paths.get(name, []))} paths; "
                        "run the repair stage again"
                    )
                repaired = tuple(_repaired(cfg, rows, paths[name], scene) for scene in range(len(shown)))
                jobs.append(Job(cfg, variant, user, seed, shown, repaired, added, examples.get(user, ())))
    return jobs


def _repaired(cfg: DictConfig, rows: pd.DataFrame, paths: Array, scene: int) -> Repaired:
    """The first repairs of one scene."""
    at = np.flatnonzero(rows["scene"].to_numpy() == scene)[: cfg.record.repairs]
    chosen = rows.iloc[at]
    return Repaired(chosen["start"].to_numpy(), paths[at], chosen["valid_end"].to_numpy(dtype=bool))


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
    pool, n = train_pool(seed), cfg.study_n
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


def _interventions(job: Job, belief: Belief, added: Added, effects: pd.DataFrame) -> tuple[Intervention, ...]:
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
    item = int(blame(chance_of_change(False, p[:1], p[1:])))
    return None if item == NOBODY else item


def _learning(job: Job, belief: Belief, curves: pd.DataFrame) -> Learning:
    """The losses of the model shown, and the first scene's map by every n and along the training."""
    of_model = (curves["user"] == job.user) & (curves["seed"] == job.seed) & (curves["n"] == job.cfg.study_n)
    rows = curves[of_model].sort_values("step")
    terms = {str(term): rows[term].to_numpy() for term in rows.columns if term not in CURVE_KEY}
    steps = rows["step"].to_numpy()
    trained = steps[-1] + 1 if belief.by_step else 0  # a curve's points lie before their updates
    by_step = {**belief.by_step, int(trained): belief.by_n[job.cfg.study_n]}
    return Learning(steps, terms, belief.by_n, by_step)


if __name__ == "__main__":
    launch(main, "record")
