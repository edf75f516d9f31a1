"""Stage ceiling: fit the paper's model to more scenes, and with a better input, and judge it in new scenes.

Each training set has scenes and paths of its own; fewer scenes are the first ones. Every learner is fitted as in stage
train: the same schedule, width and labels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_position_prior
from pipeline.config.settings import NEAREST, POSITION
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel, untrained
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, classification
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.scores import accuracy
from pipeline.training.loop import Losses, Schedule, minimise
from pipeline.training.refit import TrainingSet, refit
from pipeline.training.runner import need_finite
from pipeline.training.vae.engines import reference
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import LayoutRules, Layouts, random_layouts
from pipeline.world.render import read_palette, render_scenes
from pipeline.world.rules import valid
from studies.ceiling.models import Coordinates, PathDrawn, true_code

PERFECT = "perfect"
CHANGED = {"coordinates": Coordinates, "path_drawn": PathDrawn}
OWN, SEEN, NEW = "demonstrations", "seen_scenes", "new_scenes"


@dataclass(frozen=True)
class Labelled:
    """Scenes as images and as the truth, with one user's labelled paths."""

    images: UInt8[Array, "scene 100 100 3"]
    code: Float[Array, "scene number"]
    z_theta: Float[Array, "scene path 2"]  # [m]
    valid: Bool[Array, "scene path"]


@dataclass(frozen=True)
class Job(TrainingSet):
    """A training set, with its learner, the truth about its scenes, and what judges the learner by split."""

    learner: str
    code: Float[Array, "scene number"]
    judged: dict[str, Labelled]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet and summary.csv."""
    study, prior = cfg.studies.ceiling, read_position_prior(Path(cfg.paths.scenes))
    jobs = draw_jobs(cfg)
    of = {learner: [job for job in jobs if job.learner == learner] for learner in study.scenes}
    scored = refit(cfg, {x: of[x] for x in of if x in cfg.variants}, judge, "ceiling, as in stage train")
    for name, fit in ((PERFECT, fit_head), *dict.fromkeys(CHANGED, fit_changed).items()):
        scored[name] = map_jobs(partial(fit, cfg), of.get(name, []), cfg.workers, f"ceiling, {name}")
    rows = [
        {"learner": learner, "scenes": len(job.z_theta), "split": split, "user": job.user, "seed": job.seed}
        | {"accuracy": right, "valid": job.judged[split].valid.mean() if split in job.judged else job.valid.mean()}
        for learner, accuracies in scored.items()
        for job, by_split in zip(of[learner], accuracies, strict=True)
        for split, right in by_split.items()
    ]
    table = pd.DataFrame(rows + judge_blind(jobs, prior))
    write_table(out_dir / "accuracy.parquet", table)
    key = ["learner", "scenes", "split"]
    by_seed = table.groupby([*key, "seed"], sort=False)[["accuracy", "valid"]].mean().reset_index()
    first, third = partial(pd.Series.quantile, q=0.25), partial(pd.Series.quantile, q=0.75)
    columns = {"accuracy": ("accuracy", "mean"), "q1": ("accuracy", first), "q3": ("accuracy", third)}
    columns |= {"valid": ("valid", "mean"), "seeds": ("seed", "size")}
    write_table(out_dir / "summary.csv", by_seed.groupby(key, sort=False).agg(**columns).reset_index())


def draw_jobs(cfg: DictConfig) -> list[Job]:
    """Draw all training sets: the largest number of scenes first, which takes longest."""
    study, users, n = cfg.studies.ceiling, list(cfg.evaluate.users), cfg.main_n_demos
    seeds = list(cfg.protocol.seeds)[: max(study.seeds.values())]
    counts = [(learner, count) for learner, numbers in study.scenes.items() for count in numbers]
    most = max(count for _, count in counts)
    pictures = max((count for learner, count in counts if learner != PERFECT), default=study.seen_scenes)
    orders = [(NEW, study.new_scenes, study.new_scenes), *((f"train-{seed}", most, pictures) for seed in seeds)]
    (new, new_images), *training = map_jobs(partial(draw_scenes, cfg), orders, cfg.workers, "scenes")
    new_code, seen = _code(cfg, new), slice(study.seen_scenes)
    jobs = []
    for (seed, (layouts, images)), user in product(zip(seeds, training, strict=True), users):
        draw, code = partial(draw_paths, cfg, user, seed), _code(cfg, layouts)
        judged = {
            SEEN: Labelled(images[seen], code[seen], *draw(SEEN, layouts[seen], study.paths)),
            NEW: Labelled(new_images, new_code, *draw(NEW, new, study.paths)),
        }
        z, labels = draw(OWN, layouts, n)
        for learner, count in counts:
            if seed in seeds[: study.seeds[learner]]:
                part, shown = slice(count), slice(0 if learner == PERFECT else count)
                data = images[shown], z[part], labels[part]
                jobs.append(Job(user, seed, *data, learner, code[part], judged))
    return sorted(jobs, key=lambda job: -len(job.z_theta))


def draw_paths(
    cfg: DictConfig, user: str, seed: int, name: str, layouts: Layouts, count: int
) -> tuple[Float[Array, "scene path 2"], Bool[Array, "scene path"]]:
    """Draw random paths [m] in each scene and label them by the user's rules."""
    z_theta = random_z_theta(stream(cfg.studies.ceiling.root_seed, name, user, seed), len(layouts), count)
    return z_theta, valid(layouts, z_theta, cfg.users[user])


def _code(cfg: DictConfig, layouts: Layouts) -> Float[Array, "scene number"]:
    return true_code(layouts, max(cfg.scenes.layout.items_per_scene))


def draw_scenes(cfg: DictConfig, order: tuple[str, int, int]) -> tuple[Layouts, UInt8[Array, "picture 100 100 3"]]:
    """Draw a number of scenes as stage scenes does, with training items, and render the first ones."""
    (name, count, pictures), (catalogue, palette) = order, read_palette(cfg.paths.data)
    rng, rules = stream(cfg.studies.ceiling.root_seed, "scenes", name), LayoutRules.of(cfg.scenes.layout)
    layouts = random_layouts(rng, count, catalogue.footprints, catalogue.pool("train"), rules)
    textures, seeds = rng.choice(catalogue.texture_names("train"), count), rng.integers(2**31, size=count)
    first = slice(pictures)
    return layouts, render_scenes(layouts[first], list(textures[first]), seeds[first].tolist(), palette)


def judge(model: ValidityModel, job: TrainingSet) -> dict[str, float]:
    """Return the model's accuracy on its own demonstrations and in each split."""
    assert isinstance(job, Job)
    return _accuracies(job, lambda x: model.probability(x.images, x.z_theta))


def _accuracies(job: Job, p: Callable[[Labelled], Array]) -> dict[str, float]:
    own = Labelled(job.images, job.code, job.z_theta, job.valid)
    return {split: accuracy(p(x).ravel(), x.valid.ravel()) for split, x in {OWN: own, **job.judged}.items()}


def fit_changed(cfg: DictConfig, job: Job) -> dict[str, float]:
    """Fit a classifier that reads more than the image; return its accuracies."""
    v, seed = cfg.variants.classifier, _seed(cfg, job)
    model = untrained(CHANGED[job.learner], cfg.train.model, seed)
    assert isinstance(model, BetaVae)
    weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
    data = job.images, job.z_theta, job.valid
    curve = reference.fit(model, *data, weights=weights, schedule=Schedule.of(cfg.train), seed=seed)
    need_finite(curve, f"{job.learner} of {job.user}, seed {job.seed}")
    return judge(model, job)


def fit_head(cfg: DictConfig, job: Job) -> dict[str, float]:
    """Fit the paper's classifier to the true codes of its scenes; return its accuracies."""
    head = untrained(BetaVae, {**cfg.train.model, "latent": job.code.shape[1]}, _seed(cfg, job))
    assert isinstance(head, BetaVae)
    labels = torch.from_numpy(job.valid)

    def logit(code: Array, z_theta: Array) -> torch.Tensor:
        return head.logit(torch.from_numpy(code).float(), torch.from_numpy(z_theta).float())

    def loss() -> Losses:
        value = classification(logit(job.code, job.z_theta), labels)
        return value, [value]

    need_finite(minimise(loss, head.classifier.parameters(), Schedule.of(cfg.train)), f"{PERFECT}, seed {job.seed}")
    with torch.no_grad():
        return _accuracies(job, lambda x: logit(x.code, x.z_theta).sigmoid().numpy())


def _seed(cfg: DictConfig, job: Job) -> int:
    return job_seed(job.seed, job.user, cfg.main_n_demos, job.learner)


def judge_blind(jobs: list[Job], prior: dict[str, Float[Array, "side side"]]) -> list[dict]:
    """Return the accuracies of both image-blind baselines, a row for each training set; 0 scenes: not fitted to any."""
    rows = []
    for job in {(job.user, job.seed): job for job in jobs}.values():  # the smallest of each
        seen = job.judged[SEEN]
        demos, labels = job.z_theta[: len(seen.valid)], job.valid[: len(seen.valid)]
        p = {(POSITION, split): baselines.position_only(prior[job.user], x.z_theta) for split, x in job.judged.items()}
        p[NEAREST, SEEN] = baselines.nearest_demonstration(demos, labels, seen.z_theta)
        for (name, split), of_paths in p.items():
            right = accuracy(of_paths.ravel(), (truth := job.judged[split].valid).ravel())
            key = {"learner": name, "scenes": 0, "split": split, "user": job.user, "seed": job.seed}
            rows.append(key | {"accuracy": right, "valid": truth.mean()})
    return rows


if __name__ == "__main__":
    launch(main, "ceiling")
