"""Stage record: a Rerun recording per variant, user and seed, an overview of them, and a digest of what each holds."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import read_demos, read_trajectories
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_table
from pipeline.artifacts.interventions import read_interventions
from pipeline.artifacts.models import model_dir, weights_path
from pipeline.artifacts.repairs import check_pool
from pipeline.artifacts.scenes import SceneSet, read_scenes
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.causal.counterfactual import keep
from pipeline.launch import launch
from pipeline.models.base import ValidityModel
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.writing import atomic_write
from pipeline.viewer.assemble import Belief, Demos, Example, Job, Repaired, Sources, contents
from pipeline.viewer.digest import digest
from pipeline.viewer.overview import write_overview
from pipeline.viewer.run import write_run
from pipeline.world.bezier import lattice

Array = np.ndarray
REPAIR_COLUMNS = ["method", "seed", "user", "scene", "start", "valid_end"]
EFFECT_COLUMNS = ["variant", "seed", "user", "scene", "symbol", "placement", "effect", "true_effect"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """runs/{variant}-{user}-s{seed}.rrd of every model at main_n_demos, overview.rrd of the first seed's, recordings.csv.

    recordings.csv has each recording's digest and, of a run, the share of its latent maps that agrees with the truth.
    """
    check_weights(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = check_pool(cfg, scenes)
    examples, caring = _examples(cfg, scenes), _caring(cfg)
    sources = Sources(
        scenes,
        pool,
        Demos(read_demos(Path(cfg.paths.demos)), *read_trajectories(Path(cfg.paths.demos))),
        read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool]),
        read_table(Path(cfg.paths.intervene) / "effects.parquet", EFFECT_COLUMNS),
        {variant: read_table(model_dir(cfg, variant) / "curves.parquet") for variant in cfg.variants},
    )
    jobs = _jobs(cfg, scenes.images[pool], sources.added.images[:, 0], {user: examples for user in caring})
    # In this process: Rerun has hung beside processes of torch, and starting them costs more than they save.
    beliefs = map_jobs(believe, jobs, 1, "latent maps")
    users = caring or list(cfg.users)
    rows, compared = [], []
    shutil.rmtree(out_dir / "runs", ignore_errors=True)  # of an earlier run into the same folder, of other models
    for job, belief in zip(tqdm(jobs, desc="recordings"), beliefs, strict=True):
        content = contents(sources, job, belief)
        path = out_dir / "runs" / f"{content.name}.rrd"
        atomic_write(path, lambda part, content=content: write_run(part, content))
        rows.append({"run": content.name, "sha256": digest(path), "agreement": content.agreement})
        if job.seed == cfg.protocol.seeds[0] and job.user in users:
            compared.append(content)
    compared.sort(key=lambda run: (*cfg.record.first, run.variant).index(run.variant))
    path = out_dir / "overview.rrd"
    atomic_write(path, lambda part: write_overview(part, compared))
    rows.append({"run": "overview", "sha256": digest(path)})
    write_table(out_dir / "recordings.csv", pd.DataFrame(rows))


def believe(job: Job) -> Belief:
    """What a model makes of every cell of its latent maps, every step of its repairs and every question asked of it."""
    fitted = {n: load_model(job.cfg, job.variant, job.user, job.seed, n) for n in job.cfg.n_demos}
    model, side = fitted[job.cfg.main_n_demos], job.cfg.record.map_side

    def maps(model: ValidityModel, images: Array) -> Array:
        cells = np.broadcast_to(lattice(side), (len(images), side * side, 2))
        return model.probability(images, cells).reshape(-1, side, side)

    steps = []
    for image, shown in zip(job.images, job.repaired, strict=True):
        p = model.probability(image[None], shown.z.reshape(1, -1, 2)) if len(shown.z) else np.zeros(0)
        steps.append(p.reshape(shown.z.shape[:2]))
    of_scenes = maps(model, job.images)
    first = job.images[:1]
    by_n = {n: of_scenes[0] if other is model else maps(other, first)[0] for n, other in fitted.items()}
    by_step = {step: maps(early, first)[0] for step, early in _checkpoints(job)}
    answers = [model.probability(x.images, np.tile(x.z, (len(x.images), 1, 1)))[:, 0] for x in job.examples]
    return Belief(of_scenes, tuple(steps), maps(model, job.added), by_n, by_step, tuple(answers))


def _checkpoints(job: Job) -> Iterator[tuple[int, ValidityModel]]:
    """The model as it was before each step of `cfg.checkpoints`, of those that its training had."""
    directory, which = model_dir(job.cfg, job.variant), (job.user, job.seed, job.cfg.main_n_demos)
    for step in sorted(job.cfg.checkpoints):
        if weights_path(directory, *which, step).is_file():
            yield step, load_model(job.cfg, job.variant, *which, step)


def _caring(cfg: DictConfig) -> list[str]:
    """The users who keep clear of something: all is valid to the others."""
    return [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]


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


if __name__ == "__main__":
    launch(main, "record")
