"""Stage record: a Rerun recording per variant, user and seed, an overview of them, and a digest of what each holds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import DEMO_KEY, demo_arrays, read_demos, read_recordings
from pipeline.artifacts.files import read_arrays, read_table, write_table, write_whole
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.params import InputError
from pipeline.recording.contents import Demonstrations, Repairs, Run
from pipeline.recording.digest import digest
from pipeline.recording.overview import write_overview
from pipeline.recording.run import write_run
from pipeline.table.bezier import lattice
from pipeline.table.rules import valid

Array = np.ndarray
REPAIR_COLUMNS = ["method", "seed", "user", "scene", "start", "valid_end"]


@dataclass(frozen=True)
class Repaired:
    """The repairs shown in one scene: start numbers, z (repair, step, 2) [m], ends_valid (repair,)."""

    start: Array
    z: Array
    ends_valid: Array


@dataclass(frozen=True)
class Job:
    """One model and the paths it is asked about."""

    cfg: DictConfig
    variant: str
    user: str
    seed: int
    images: Array  # (scene, 100, 100, 3) of the scenes shown
    repaired: tuple[Repaired, ...]  # one a scene

    @property
    def name(self) -> str:
        """The key of paths.npz."""
        return f"{self.variant}-{self.user}-s{self.seed}"


@dataclass(frozen=True)
class Belief:
    """A model's P(valid): map (scene, side, side) as [y, x], and per scene (repair, step) along its repairs."""

    maps: Array
    steps: tuple[Array, ...]


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
    jobs = _jobs(cfg, scenes.images[pool])
    # In this process: Rerun has hung beside processes of torch, and starting them costs more than they save.
    beliefs = map_jobs(believe, jobs, 1, "latent maps")
    truths = {user: _truth(cfg, scenes, pool, user) for user in cfg.users}
    users = _compared_users(cfg)
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
    """What a model makes of every cell of its latent maps and of every step of its repairs."""
    model = load_model(job.cfg, job.variant, job.user, job.seed, job.cfg.study_n)
    side, count = job.cfg.record.map_side, len(job.images)
    cells = np.broadcast_to(lattice(side), (count, side * side, 2))
    maps = model.probability(job.images, cells).reshape(count, side, side)
    steps = []
    for image, shown in zip(job.images, job.repaired, strict=True):
        p = model.probability(image[None], shown.z.reshape(1, -1, 2)) if len(shown.z) else np.zeros(0)
        steps.append(p.reshape(shown.z.shape[:2]))
    return Belief(maps, tuple(steps))


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


def _compared_users(cfg: DictConfig) -> list[str]:
    """The users of the overview: whoever keeps clear of something, since all is valid to the others."""
    caring = [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]
    return caring or list(cfg.users)


def _pool(cfg: DictConfig, scenes: SceneSet) -> str:
    """The pool the repairs were made in."""
    pool = cfg.protocol.splits.get(cfg.repair.split)
    if pool is None or pool not in scenes.images:
        raise InputError(
            f"repair.split {cfg.repair.split!r} stands for scenes {pool!r}: "
            f"expected one of {', '.join(scenes.images)}; run the scenes stage"
        )
    return pool


def _jobs(cfg: DictConfig, images: Array) -> list[Job]:
    """Every model, with the repairs to show of it."""
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
                jobs.append(Job(cfg, variant, user, seed, shown, repaired))
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
    return tuple(
        Repairs(
            scene=scene,
            image=job.images[scene],
            layout=scenes.layouts[pool][scene : scene + 1],
            predicted=belief.maps[scene],
            truth=truth[scene],
            start=tuple(int(start) for start in shown.start),
            z=shown.z,
            p=belief.steps[scene],
            ends_valid=shown.ends_valid,
        )
        for scene, shown in enumerate(job.repaired)
    )


if __name__ == "__main__":
    launch(main, "record")
