"""Stage fairness: was the paper's model short of tables, of a better encoder, or of one model for all users?

The model is fitted to more scenes, its classifier to the true items in place of an encoder, and once with the user as
an input. Scenes and random paths are this study's own; fewer scenes are the first ones. Half of all paths are valid.
Steps, rate and width are those of stage train.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from torch import nn

from pipeline.artifacts.files import read_table, write_table
from pipeline.artifacts.scenes import read_position_prior
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel, to_tensor, untrained
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights, classification, equation_1
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Counts, Several, StudyGroup, Whole, need
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.scores import accuracy
from pipeline.training.loop import Losses, Schedule, TrainingSet, minimise, need_finite
from pipeline.training.refit import refit
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import random_scenes
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts
from pipeline.world.render import ImageSource, read_palette, render_scenes
from pipeline.world.rules import Candidates

MODEL, PERFECT = "full", "perfect"  # the paper's model; its classifier on the true items
JOINT = "joint"  # the paper's model with the user as an input: one for all users
SEARCHED = "docs/decisions/data/search_best.csv"  # every learner's best of 100 settings (record 026)
OWN, SEEN, NEW = "demonstrations", "seen_scenes", "new_scenes"  # splits: its own, other paths there, new tables
KEY = ["learner", "scenes", "split"]
LENGTH_UNIT_M = 0.1  # unit of an item's size in its true code [m]


class Settings(StudyGroup):
    root_seed: Whole
    scenes: dict[str, Counts]
    scenes_seeds: Several
    candidates: Count
    seen_scenes: Count
    new_scenes: Several
    paths: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require numbers of scenes for both learners, and scenes and candidates enough to judge them."""
    name = "studies.fairness"
    need(set(study.scenes) == {MODEL, PERFECT}, f"{name}.scenes", study.scenes, f"numbers for {MODEL} and {PERFECT}")
    need(MODEL in parameters.variants, "variants", list(parameters.variants), f"{MODEL} among them: {name} is about it")
    paths = parameters.main_n_demos + study.paths
    need(study.candidates >= paths, f"{name}.candidates", study.candidates, f"at least main_n_demos + paths = {paths}")
    fewest = min(numbers[0] for numbers in study.scenes.values())
    need(study.seen_scenes <= fewest, f"{name}.seen_scenes", study.seen_scenes, f"at most {fewest}, as in `scenes`")


class Labelled(NamedTuple):
    """Scenes as a learner takes them (images, or true codes), with one user's labelled paths [m]."""

    scenes: UInt8[Array, "scene 100 100 3"] | Float[Array, "scene number"]
    z_theta: Float[Array, "scene path 2"]
    valid: Bool[Array, "scene path"]


@dataclass(frozen=True)
class Case(TrainingSet):
    """A training set of one user for a learner; `images` are true codes for PERFECT. All splits judge it, OWN too."""

    learner: str
    judged: dict[str, Labelled]

    def accuracies(self, probability: Callable[[Labelled], Array]) -> dict[str, float]:
        """Return the share of paths judged right in each split."""
        return {split: accuracy(probability(x).ravel(), x.valid.ravel()) for split, x in self.judged.items()}

    def row(self, learner: str, scenes: int, split: str, right: float) -> dict:
        """Return a row of results; `valid`: share of the judged paths that are valid."""
        key = {"learner": learner, "scenes": scenes, "split": split, "user": self.user, "seed": self.seed}
        return key | {"accuracy": right, "valid": self.judged[split].valid.mean()}


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write scenes.csv, accuracies with quartiles over seeds, and searched.csv, the result of a finished search."""
    cases, prior = draw_cases(cfg), read_position_prior(Path(cfg.paths.scenes))
    of_model, heads, joint = ([c for c in cases if c.learner == learner] for learner in (MODEL, PERFECT, JOINT))
    of_model.sort(key=lambda case: -len(case.images))  # the largest first: they take longest
    answers = refit(cfg, {MODEL: of_model}, judge, "fairness")[MODEL]
    answers += map_jobs(partial(fit_head, cfg), heads, cfg.workers, "perfect encoder")
    by_seed = [[c for c in joint if c.seed == seed] for seed in dict.fromkeys(c.seed for c in joint)]
    for of_seed in map_jobs(partial(fit_joint, cfg), by_seed, cfg.workers, "joint model"):
        answers += of_seed
    judged = zip([*of_model, *heads, *(c for of_seed in by_seed for c in of_seed)], answers, strict=True)
    judged = [(case, by_split) for case, by_split in judged if case.user in cfg.evaluate.users]
    rows = [c.row(c.learner, len(c.images), *one) for c, by_split in judged for one in by_split.items()]
    table = pd.DataFrame([*rows, *blind_rows(heads, prior)])
    means = table.groupby([*KEY, "seed"], sort=False)[["accuracy", "valid"]].mean().groupby(KEY, sort=False)
    quartiles = means["accuracy"].quantile([0.25, 0.75]).unstack().set_axis(["q1", "q3"], axis=1)
    summary = means["accuracy"].mean().to_frame().join(quartiles)
    summary = summary.assign(valid=means["valid"].mean(), seeds=means.size())
    write_table(out_dir / "scenes.csv", summary.reset_index())
    write_table(out_dir / "searched.csv", read_table(Path(SEARCHED)))


def judge(model: ValidityModel, case: TrainingSet) -> dict[str, float]:
    """Return the model's accuracy in each split of a case."""
    assert isinstance(case, Case)
    return case.accuracies(lambda x: model.probability(x.scenes, x.z_theta))


def draw_cases(cfg: DictConfig) -> list[Case]:
    """Draw the training sets of both learners for every user and seed, each with the same new scenes."""
    study, n = cfg.studies.fairness, cfg.main_n_demos
    seeds = list(cfg.protocol.seeds)[: study.scenes_seeds]
    most, pictures = max(map(max, study.scenes.values())), max(study.scenes[MODEL])
    orders = [(NEW, study.new_scenes, study.new_scenes), *((f"train-{seed}", most, pictures) for seed in seeds)]
    (new, new_images), *training = map_jobs(partial(draw_scenes, cfg), orders, cfg.workers, "scenes")
    slots, cases = max(cfg.scenes.layout.items_per_scene), []
    for user, (seed, (pool, images)) in product(cfg.users, zip(seeds, training, strict=True)):
        (z, valid), (new_z, new_valid) = (
            drawn.choose(stream(study.root_seed, "choose", name, user, 0), cfg.users[user], 0.0, n + study.paths)
            for name, drawn in ((f"train-{seed}", pool), (NEW, new))
        )
        codes, seen = [true_code(drawn.layouts, slots) for drawn in (pool, new)], slice(study.seen_scenes)
        learners = {**study.scenes, JOINT: study.scenes[MODEL][:1]}
        for learner, numbers in learners.items() if user in cfg.evaluate.users else [(JOINT, learners[JOINT])]:
            here, there = codes if learner == PERFECT else (images, new_images)
            judges = {SEEN: Labelled(here[seen], z[seen, n:], valid[seen, n:])}
            judges[NEW] = Labelled(there, new_z[:, n:], new_valid[:, n:])
            for count in numbers:
                own = Labelled(here[:count], z[:count, :n], valid[:count, :n])
                cases.append(Case(user, seed, *own, learner, {OWN: own} | judges))
    return cases


def draw_scenes(cfg: DictConfig, order: tuple[str, int, int]) -> tuple[Candidates, UInt8[Array, "picture 100 100 3"]]:
    """Draw scenes as stage scenes does, with training items, and random paths in each; render the first scenes.

    order: name, number of scenes, number of pictures.
    """
    name, count, pictures = order
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    study, rng = cfg.studies.fairness, stream(cfg.studies.fairness.root_seed, "scenes", name)
    layouts, looks = random_scenes(rng, count, catalogue, "train", LayoutRules.of(cfg.scenes.layout))
    textures, seeds = (looks[column].tolist()[:pictures] for column in ("texture", "render_seed"))
    images = render_scenes(layouts[:pictures], textures, seeds, palette)
    return Candidates.of(layouts, random_z_theta(rng, count, study.candidates)), images


def true_code(layouts: Layouts, slots: int) -> Float[Array, "scene number"]:
    """Return what a perfect encoder knows of each scene: position, size, direction and symbol of each item.

    Numbers of an empty slot are 0. A direction is that of a segment without sign, so it is given by twice its angle.
    """
    x, y = np.moveaxis((layouts.centre - Z_CENTRE) / Z_SCALE, -1, 0)
    twice = layouts.half_length / LENGTH_UNIT_M * np.exp(2j * layouts.angle)
    symbol = layouts.symbol[..., None] == np.arange(len(SYMBOLS))
    numbers = [x, y, layouts.radius / LENGTH_UNIT_M, twice.real, twice.imag, *np.moveaxis(symbol, -1, 0)]
    code = np.where(layouts.present[..., None], np.stack(numbers, -1), 0.0)[:, :slots]
    return code.reshape(len(layouts), -1)


def fit_head(cfg: DictConfig, case: Case) -> dict[str, float]:
    """Fit the paper's classifier to the true codes of its scenes, by full-batch steps; return its accuracies."""
    own = case.judged[OWN]
    shape = {**cfg.train.model, "latent": own.scenes.shape[1]}
    head = untrained(BetaVae, shape, job_seed(case.seed, case.user, cfg.main_n_demos, PERFECT))
    assert isinstance(head, BetaVae)
    labels = torch.from_numpy(own.valid)

    def logit(x: Labelled) -> torch.Tensor:
        return head.logit(torch.from_numpy(x.scenes).float(), torch.from_numpy(x.z_theta).float())

    def loss() -> Losses:
        value = classification(logit(own), labels)
        return value, [value]

    need_finite(minimise(loss, head.classifier.parameters(), Schedule.of(cfg.train)), f"{PERFECT}, seed {case.seed}")
    with torch.no_grad():
        return case.accuracies(lambda x: logit(x).sigmoid().numpy())


class JointVae(BetaVae):
    """The paper's model with the user s as an input of its classifier, as in its graph: `whose` are the paths."""

    whose: Float[torch.Tensor, "path user"]  # one 1 a path, or a row for all of them

    def __init__(self, users: int, **shape: Any):
        super().__init__(**shape)
        last = self.classifier[0].get_parameter("weight")
        self.classifier[0] = nn.Linear(last.shape[1] + users, len(last))

    def logit(self, percept: torch.Tensor, z_theta: torch.Tensor) -> torch.Tensor:
        """Return the log-odds that each path [m] (scene, path, 2) is valid to its user."""
        shape, scaled = (*z_theta.shape[:2], -1), (z_theta - Z_CENTRE) / Z_SCALE
        parts = [percept[:, None].expand(shape), scaled, self.whose.expand(*shape[:2], self.whose.shape[-1])]
        return self.classifier(torch.cat(parts, dim=-1)).squeeze(-1)


def fit_joint(cfg: DictConfig, cases: list[Case]) -> list[dict[str, float]]:
    """Fit one model to the demonstrations of all users in a training set's scenes; return each user's accuracies."""
    own, users, seed = [case.judged[OWN] for case in cases], torch.eye(len(cases)), cases[0].seed
    number = job_seed(seed, JOINT, cfg.main_n_demos, JOINT)
    model = untrained(JointVae, {**cfg.train.model, "users": len(cases)}, number)
    assert isinstance(model, JointVae)
    model.standardise(own[0].scenes)
    images, noise = to_tensor(own[0].scenes), torch.Generator().manual_seed(number)
    z_theta = torch.from_numpy(np.concatenate([x.z_theta for x in own], axis=1)).float()
    valid = torch.from_numpy(np.concatenate([x.valid for x in own], axis=1))
    model.whose, weights = users.repeat_interleave(own[0].valid.shape[1], dim=0), Weights.of(cfg.variants[MODEL])

    def loss() -> Losses:
        drawn = torch.randn(len(images), model.latent, generator=noise)
        terms = equation_1(model, images, z_theta, valid, weights, drawn)
        return terms.total, list(terms)

    need_finite(minimise(loss, model.parameters(), Schedule.of(cfg.train)), f"{JOINT}, seed {seed}")
    answers = []
    for case, model.whose in zip(cases, users[:, None], strict=True):
        answers.append(case.accuracies(lambda x: model.probability(x.scenes, x.z_theta)))
    return answers


def blind_rows(cases: list[Case], prior: dict[str, Float[Array, "side side"]]) -> Iterator[dict]:
    """Yield the accuracies of both image-blind baselines, for which the number of scenes is 0: any will do."""
    for case in {(case.user, case.seed): case for case in cases}.values():
        few, z_theta = slice(len(case.judged[SEEN].valid)), {split: case.judged[split].z_theta for split in (SEEN, NEW)}
        p = {(POSITION, s): baselines.position_only_of_half(prior[case.user], z) for s, z in z_theta.items()}
        p[NEAREST, SEEN] = baselines.nearest_demonstration(case.z_theta[few], case.valid[few], z_theta[SEEN])
        for (name, split), each in p.items():
            yield case.row(name, 0, split, accuracy(each.ravel(), case.judged[split].valid.ravel()))


if __name__ == "__main__":
    launch(main, "fairness")
