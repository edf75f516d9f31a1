"""Stage ceiling: fit the paper's model to more scenes, and its head to the true items, and judge both in new scenes.

Each training set has scenes and paths of its own; fewer scenes are the first ones. Half of the paths are valid. Both
learners are also fitted to clear cases and judged on them. They have the rate and the width of stage train. The model
sees a batch of scenes a step, and has more steps where there are more scenes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_position_prior
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel, untrained
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, classification
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.scores import accuracy
from pipeline.training.loop import Losses, Schedule, minimise
from pipeline.training.sets import need_finite
from pipeline.training.vae.engines.simd import LANES
from pipeline.world.bezier import random_z_theta
from pipeline.world.clear_cases import Candidates
from pipeline.world.layout import LayoutRules, random_layouts
from pipeline.world.render import read_palette, render_scenes
from pipeline.world.source import ImageSource
from studies.ceiling.batches import fit_stack
from studies.ceiling.models import true_code

PERFECT = "perfect"
OWN, SEEN, NEW = "demonstrations", "seen_scenes", "new_scenes"


@dataclass(frozen=True)
class Labelled:
    """Scenes as images and as the truth, with one user's labelled paths."""

    images: UInt8[Array, "scene 100 100 3"]
    code: Float[Array, "scene number"]
    z_theta: Float[Array, "scene path 2"]  # [m]
    valid: Bool[Array, "scene path"]


@dataclass(frozen=True)
class Job(Labelled):
    """A training set of one user, with its learner, and what judges the learner by split; no images for `perfect`.

    clear_cm: least distance of all paths from the boundary of validity [cm].
    """

    user: str
    seed: int
    learner: str
    clear_cm: int
    judged: dict[str, Labelled]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet and summary.csv."""
    prior = read_position_prior(Path(cfg.paths.scenes))
    jobs = draw_jobs(cfg)
    parts = stacks(cfg, jobs)
    scored = map_jobs(partial(fit, cfg), parts, cfg.workers, "ceiling")
    rows = [
        row(job, job.learner, len(job.z_theta), split, right) | {"steps": steps(cfg, job.learner, len(job.z_theta))}
        for part, accuracies in zip(parts, scored, strict=True)
        for job, by_split in zip(part, accuracies, strict=True)
        for split, right in by_split.items()
    ]
    table = pd.DataFrame([*rows, *judge_blind(jobs, prior)])
    write_table(out_dir / "accuracy.parquet", table)
    key = ["learner", "scenes", "clear_cm", "split"]
    by_seed = table.groupby([*key, "seed"], sort=False)[["accuracy", "valid", "steps"]].mean().reset_index()
    first, third = partial(pd.Series.quantile, q=0.25), partial(pd.Series.quantile, q=0.75)
    columns = {"accuracy": ("accuracy", "mean"), "q1": ("accuracy", first), "q3": ("accuracy", third)}
    columns |= {"valid": ("valid", "mean"), "seeds": ("seed", "size"), "steps": ("steps", "first")}
    write_table(out_dir / "summary.csv", by_seed.groupby(key, sort=False).agg(**columns).reset_index())


def draw_jobs(cfg: DictConfig) -> list[Job]:
    """Draw all training sets: the largest number of scenes first, which takes longest."""
    study, n, jobs = cfg.studies.ceiling, cfg.main_n_demos, []
    seeds = list(cfg.protocol.seeds)[: max(study.seeds.values())]
    orders = [(NEW, study.new_scenes, study.new_scenes)]
    for i, seed in enumerate(seeds):
        most = {x: max(numbers) for x, numbers in study.scenes.items() if i < study.seeds[x]}
        pictures = max((count for x, count in most.items() if x != PERFECT), default=study.seen_scenes)
        orders.append((f"train-{seed}", max(most.values()), pictures))
    (new, new_images), *training = map_jobs(partial(draw_scenes, cfg), orders, cfg.workers, "scenes")
    seen = slice(study.seen_scenes)
    cases = list(product(cfg.evaluate.users, study.clear_cm))
    for (i, (pool, images)), (user, clear_cm) in product(enumerate(training), cases):
        z, labels = choose(cfg, orders[i + 1][0], pool, user, clear_cm)
        new_z, new_labels = choose(cfg, NEW, new, user, clear_cm)
        code = _code(cfg, pool)
        judged = {
            SEEN: Labelled(images[seen], code[seen], z[seen, n:], labels[seen, n:]),
            NEW: Labelled(new_images, _code(cfg, new), new_z[:, n:], new_labels[:, n:]),
        }
        fitted = [x for x in study.scenes if i < study.seeds[x]]
        for learner, count in ((x, count) for x in fitted for count in study.scenes[x]):
            pictures = images[: 0 if learner == PERFECT else count]
            data = pictures, code[:count], z[:count, :n], labels[:count, :n]
            jobs.append(Job(*data, user, seeds[i], learner, clear_cm, judged))
    return sorted(jobs, key=lambda job: -len(job.z_theta))


def stacks(cfg: DictConfig, jobs: Sequence[Job]) -> list[list[Job]]:
    """Return the jobs in parts that are fitted together: up to `LANES` of a variant and number of scenes, else one."""
    groups: dict[tuple[str, int], list[Job]] = {}
    for job in jobs:
        groups.setdefault((job.learner, len(job.z_theta)), []).append(job)
    sizes = {learner: LANES if learner in cfg.variants else 1 for learner, _ in groups}
    return [
        group[i : i + sizes[learner]]
        for (learner, _), group in groups.items()
        for i in range(0, len(group), sizes[learner])
    ]


def choose(cfg: DictConfig, name: str, pool: Candidates, user: str, clear_cm: int) -> tuple[Array, Array]:
    """Choose each scene's demonstrations, then the paths that judge a learner; return all with their labels."""
    study = cfg.studies.ceiling
    rng = stream(study.root_seed, "choose", name, user, clear_cm)
    return pool.choose(rng, cfg.users[user], clear_cm / 100, cfg.main_n_demos + study.paths)


def _code(cfg: DictConfig, pool: Candidates) -> Float[Array, "scene number"]:
    return true_code(pool.layouts, max(cfg.scenes.layout.items_per_scene))


def draw_scenes(cfg: DictConfig, order: tuple[str, int, int]) -> tuple[Candidates, UInt8[Array, "picture 100 100 3"]]:
    """Draw scenes as stage scenes does, with training items, and random paths in each; render the first scenes.

    order: name, number of scenes, number of pictures.
    """
    name, count, pictures = order
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    study, rules = cfg.studies.ceiling, LayoutRules.of(cfg.scenes.layout)
    rng = stream(study.root_seed, "scenes", name)
    layouts = random_layouts(rng, count, catalogue.footprints, catalogue.pool("train"), rules)
    textures, seeds = rng.choice(catalogue.texture_names("train"), count), rng.integers(2**31, size=count)
    first = slice(pictures)
    images = render_scenes(layouts[first], list(textures[first]), seeds[first].tolist(), palette)
    return Candidates.of(layouts, random_z_theta(rng, count, study.candidates)), images


def fit(cfg: DictConfig, jobs: Sequence[Job]) -> list[dict[str, float]]:
    """Fit one part of `stacks`; return each learner's accuracy on its own demonstrations and in each split."""
    learner, scenes = jobs[0].learner, len(jobs[0].z_theta)
    if learner == PERFECT:
        return [fit_head(cfg, job) for job in jobs]
    study, v = cfg.studies.ceiling, cfg.variants[learner]
    weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
    schedule = replace(Schedule.of(cfg.train), steps=steps(cfg, learner, scenes))
    rng = stream(study.root_seed, "batches", scenes)  # the same batches for all learners
    seeds = [_seed(cfg, job) for job in jobs]
    models = [_untrained(cfg.train.model, seed) for seed in seeds]
    images, z_theta, valid = ([getattr(job, x) for job in jobs] for x in ("images", "z_theta", "valid"))
    curve = fit_stack(models, images, z_theta, valid, weights, schedule, seeds, study.batch, rng)
    need_finite(curve.reshape(len(curve), -1), f"{learner}, {scenes} scenes")
    return [_judge(model, job) for model, job in zip(models, jobs, strict=True)]


def steps(cfg: DictConfig, learner: str, scenes: int) -> int:
    """Return the training steps: those of stage train for full batches, more for more scenes than fit into one."""
    study = cfg.studies.ceiling
    growth = 0 if learner == PERFECT else study.growth
    return round(cfg.train.steps * max(1, scenes / study.batch) ** growth)


def _judge(model: ValidityModel, job: Job) -> dict[str, float]:
    return _accuracies(job, lambda x: model.probability(x.images, x.z_theta))


def _accuracies(job: Job, p: Callable[[Labelled], Array]) -> dict[str, float]:
    return {split: accuracy(p(x).ravel(), x.valid.ravel()) for split, x in {OWN: job, **job.judged}.items()}


def fit_head(cfg: DictConfig, job: Job) -> dict[str, float]:
    """Fit the paper's classifier to the true codes of its scenes; return its accuracies."""
    head = _untrained({**cfg.train.model, "latent": job.code.shape[1]}, _seed(cfg, job))
    labels = torch.from_numpy(job.valid)

    def logit(code: Array, z_theta: Array) -> torch.Tensor:
        return head.logit(torch.from_numpy(code).float(), torch.from_numpy(z_theta).float())

    def loss() -> Losses:
        value = classification(logit(job.code, job.z_theta), labels)
        return value, [value]

    need_finite(minimise(loss, head.classifier.parameters(), Schedule.of(cfg.train)), f"{PERFECT}, seed {job.seed}")
    with torch.no_grad():
        return _accuracies(job, lambda x: logit(x.code, x.z_theta).sigmoid().numpy())


def _untrained(shape: Mapping[str, Any], seed: int) -> BetaVae:
    model = untrained(BetaVae, shape, seed)
    assert isinstance(model, BetaVae)
    return model


def _seed(cfg: DictConfig, job: Job) -> int:
    return job_seed(job.seed, job.user, cfg.main_n_demos, job.learner)


def judge_blind(jobs: list[Job], prior: dict[str, Float[Array, "side side"]]) -> Iterator[dict]:
    """Yield the accuracies of both image-blind baselines, for which the number of scenes is 0: any will do."""
    for job in {(job.user, job.seed, job.clear_cm): job for job in jobs}.values():  # the smallest of each
        seen = len(job.judged[SEEN].valid)
        demos = job.z_theta[:seen], job.valid[:seen]
        p = {(POSITION, s): baselines.position_only_of_half(prior[job.user], x.z_theta) for s, x in job.judged.items()}
        p[NEAREST, SEEN] = baselines.nearest_demonstration(*demos, job.judged[SEEN].z_theta)
        for (name, split), of_paths in p.items():
            yield row(job, name, 0, split, accuracy(of_paths.ravel(), job.judged[split].valid.ravel())) | {"steps": 0}


def row(job: Job, learner: str, scenes: int, split: str, right: float) -> dict:
    """Return a row of accuracy.parquet; `valid`: share of the judged paths that are valid."""
    key = {"learner": learner, "scenes": scenes, "clear_cm": job.clear_cm, "split": split}
    valid = job.judged[split].valid if split in job.judged else job.valid
    return key | {"user": job.user, "seed": job.seed, "accuracy": right, "valid": valid.mean()}


if __name__ == "__main__":
    launch(main, "ceiling")
