"""Stage fairness: was the paper's model short of tables, of a better encoder, or of kinder demonstrations?

More tables: the model is fitted to more scenes, and its classifier to the true items in place of an encoder. Scenes and
random paths are this study's own; fewer scenes are the first ones. Kinds of demonstrations: in the scenes of stage
scenes, paths have any or few routes and keep a distance from the boundary of validity. Half of all paths are valid.
Steps, rate and width are those of stage train.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from torch import nn

from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel, to_tensor, untrained
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights, classification, equation_1
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Counts, Several, StudyGroup, Whole, Wholes, need
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.scores import accuracy
from pipeline.training import judged_sets
from pipeline.training.judged_sets import NEW, NEW_POOL, OWN, ROUTES, draw_judged_sets
from pipeline.training.loop import Losses, Schedule, minimise, need_finite
from pipeline.training.refit import TrainingSet, refit
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, random_layouts
from pipeline.world.render import ImageSource, read_palette, render_scenes
from pipeline.world.rules import Candidates

MODEL, PERFECT = "full", "perfect"  # the paper's model; its classifier on the true items
JOINT = "joint"  # the paper's model with the user as an input: one for all users
SEARCHED = "docs/decisions/data/search_best.csv"  # every learner's best of 100 settings (record 026)
SEEN = "seen_scenes"  # split: other paths in training scenes
LENGTH_UNIT_M = 0.1  # unit of an item's size in its true code [m]


class Settings(StudyGroup):
    root_seed: Whole
    scenes: dict[str, Counts]
    scenes_seeds: Several
    candidates: Count
    seen_scenes: Count
    new_scenes: Several
    paths: Count
    clear_cm: Wholes
    kinds_seeds: Several


def agree(study: Settings, parameters: Any) -> None:
    """Require numbers of scenes for both learners, and scenes and candidates enough to judge them."""
    name = "studies.fairness"
    need(set(study.scenes) == {MODEL, PERFECT}, f"{name}.scenes", study.scenes, f"numbers for {MODEL} and {PERFECT}")
    need(MODEL in parameters.variants, "variants", list(parameters.variants), f"{MODEL} among them: {name} is about it")
    paths = parameters.main_n_demos + study.paths
    need(study.candidates >= paths, f"{name}.candidates", study.candidates, f"at least main_n_demos + paths = {paths}")
    fewest = min(numbers[0] for numbers in study.scenes.values())
    need(study.seen_scenes <= fewest, f"{name}.seen_scenes", study.seen_scenes, f"at most {fewest}, as in `scenes`")


@dataclass(frozen=True)
class Labelled:
    """Scenes as a learner takes them (images, or true codes), with one user's labelled paths [m]."""

    scenes: UInt8[Array, "scene 100 100 3"] | Float[Array, "scene number"]
    z_theta: Float[Array, "scene path 2"]
    valid: Bool[Array, "scene path"]


@dataclass(frozen=True)
class Case:
    """A training set of one user for a learner: `judged[OWN]` is what it is fitted to, all splits judge it."""

    learner: str
    user: str
    seed: int
    judged: dict[str, Labelled]

    def accuracies(self, probability: Callable[[Labelled], Array]) -> dict[str, float]:
        """Return the share of paths judged right in each split."""
        return {split: accuracy(probability(x).ravel(), x.valid.ravel()) for split, x in self.judged.items()}

    def row(self, learner: str, scenes: int, split: str, right: float) -> dict:
        """Return a row of results; `valid`: share of the judged paths that are valid."""
        key = {"learner": learner, "scenes": scenes, "split": split, "user": self.user, "seed": self.seed}
        return key | {"accuracy": right, "valid": self.judged[split].valid.mean()}


@dataclass(frozen=True)
class CaseSet(TrainingSet):
    """A case of the paper's model, as `refit` takes it."""

    case: Case


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write scenes.csv, kinds.csv, examples.npz and searched.csv.

    examples.npz: demonstrations of each kind in the first scene; searched.csv: the result of a finished search.
    """
    scenes, prior = read_scenes(Path(cfg.paths.scenes)), read_position_prior(Path(cfg.paths.scenes))
    scenes.check_has(NEW_POOL, *(train_pool(seed) for seed in cfg.protocol.seeds))
    cases, users = draw_cases(cfg), {user: cfg.users[user] for user in cfg.evaluate.users}
    shown = list(draw_judged_sets(cfg, scenes, ROUTES, cfg.studies.fairness.clear_cm, users))

    # Fit the paper's model to all of its training sets at once, the largest first: they take longest.
    fitted = [(c, c.judged[OWN]) for c in cases if c.learner == MODEL]
    of_model = [CaseSet(c.user, c.seed, own.scenes, own.z_theta, own.valid, c) for c, own in fitted]
    of_model.sort(key=lambda x: -len(x.images))
    few_seeds = list(cfg.protocol.seeds)[: cfg.studies.fairness.kinds_seeds]
    of_kinds = [x for x in shown if x.seed in few_seeds]
    evaluate = partial(judge_either, {NEW_POOL: scenes.images[NEW_POOL]})
    answers = refit(cfg, {MODEL: [*of_model, *of_kinds]}, evaluate, "fairness")[MODEL]
    heads = [c for c in cases if c.learner == PERFECT]
    head_answers = map_jobs(partial(fit_head, cfg), heads, cfg.workers, "perfect encoder")
    joint = [[c for c in cases if (c.learner, c.seed) == (JOINT, seed)] for seed in {c.seed: None for c in cases}]
    joint_answers = map_jobs(partial(fit_joint, cfg), joint, cfg.workers, "joint model")

    judged = zip([x.case for x in of_model] + heads, answers[: len(of_model)] + head_answers, strict=True)
    judged = [*judged, *((c, a) for of in zip(joint, joint_answers, strict=True) for c, a in zip(*of, strict=True))]
    judged = [(c, by_split) for c, by_split in judged if c.user in users]
    rows = [c.row(c.learner, len(c.judged[OWN].valid), *one) for c, by_split in judged for one in by_split.items()]
    table = pd.DataFrame([*rows, *blind_rows(heads, prior)])
    write_table(out_dir / "scenes.csv", summarise(table, ["learner", "scenes", "split"]))

    rows = [blind for x in shown for blind in judged_sets.judge_blind(prior[x.user], x)]
    judged = zip(of_kinds, answers[len(of_model) :], strict=True)
    rows += [judged_sets.row(x, MODEL, split, right) for x, by_split in judged for split, right in by_split.items()]
    write_table(out_dir / "kinds.csv", summarise(pd.DataFrame(rows), ["routes", "clear_cm", "split", "variant"]))
    first = [x for x in shown if (x.user, x.seed) == (shown[0].user, shown[0].seed)]
    examples = {"z_theta": np.stack([x.z_theta[0] for x in first]), "valid": np.stack([x.valid[0] for x in first])}
    names = np.array([f"{x.routes} {x.clear_cm}" for x in first])
    write_arrays(out_dir / "examples.npz", {"names": names, "image": first[0].images[0], **examples})

    write_table(out_dir / "searched.csv", read_table(Path(SEARCHED)))


def judge_either(images: Mapping[str, Array], model: ValidityModel, x: TrainingSet) -> dict:
    """Return the model's accuracy in each split of a case, or in each scene of those of a kind of demonstrations."""
    if isinstance(x, CaseSet):
        return x.case.accuracies(lambda labelled: model.probability(labelled.scenes, labelled.z_theta))
    return judged_sets.judge(images, model, x)


# More tables, and a perfect encoder


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
                cases.append(Case(learner, user, seed, {OWN: own} | judges))
    return cases


def draw_scenes(cfg: DictConfig, order: tuple[str, int, int]) -> tuple[Candidates, UInt8[Array, "picture 100 100 3"]]:
    """Draw scenes as stage scenes does, with training items, and random paths in each; render the first scenes.

    order: name, number of scenes, number of pictures.
    """
    name, count, pictures = order
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    study, rules = cfg.studies.fairness, LayoutRules.of(cfg.scenes.layout)
    rng = stream(study.root_seed, "scenes", name)
    layouts = random_layouts(rng, count, catalogue.footprints, catalogue.pool("train"), rules)
    textures, seeds = rng.choice(catalogue.texture_names("train"), count), rng.integers(2**31, size=count)
    first = slice(pictures)
    images = render_scenes(layouts[first], list(textures[first]), seeds[first].tolist(), palette)
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
        own, seen = case.judged[OWN], case.judged[SEEN]
        blind = {(POSITION, s): partial(baselines.position_only_of_half, prior[case.user]) for s in case.judged}
        few = slice(len(seen.valid))
        blind[NEAREST, SEEN] = partial(baselines.nearest_demonstration, own.z_theta[few], own.valid[few])
        for (name, split), probability in blind.items():
            x = case.judged[split]
            if split != OWN:
                yield case.row(name, 0, split, accuracy(probability(x.z_theta).ravel(), x.valid.ravel()))


def summarise(table: pd.DataFrame, key: list[str]) -> pd.DataFrame:
    """Return mean accuracy (over users) by `key`, with quartiles over seeds; of variants also the lead over NEAREST."""
    by_seed = table.groupby([*key, "seed"], sort=False)[["accuracy", "valid"]].mean().reset_index()
    first, third = partial(pd.Series.quantile, q=0.25), partial(pd.Series.quantile, q=0.75)
    columns: dict[str, Any] = {"accuracy": ("accuracy", "mean"), "q1": ("accuracy", first), "q3": ("accuracy", third)}
    if "variant" in key:
        pairs = [name for name in [*key, "seed"] if name != "variant"]
        nearest = by_seed[by_seed["variant"] == NEAREST][[*pairs, "accuracy"]]
        by_seed = by_seed.merge(nearest, on=pairs, how="left", suffixes=("", "_of_nearest"))
        by_seed["lead"] = by_seed["accuracy"] - by_seed["accuracy_of_nearest"]
        columns |= {"lead": ("lead", "mean"), "lead_q1": ("lead", first), "lead_q3": ("lead", third)}
    columns |= {"valid": ("valid", "mean"), "seeds": ("seed", "size")}
    return by_seed.groupby(key, sort=False).agg(**columns).reset_index()


if __name__ == "__main__":
    launch(main, "fairness")
