"""Fit every kind of learner with a setting of the search, and predict the paths that judge it."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf
from sklearn.metrics import balanced_accuracy_score

from pipeline.artifacts.demos import demo_arrays, read_labelled
from pipeline.artifacts.scenes import train_pool
from pipeline.models.base import ValidityModel, untrained
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.irl.reward_map import RewardMap
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.stats.scores import DECISION
from pipeline.training.clearance import fit as clearance
from pipeline.training.irl import fit as irl
from pipeline.training.irl.augment import ColorJitter
from pipeline.training.loop import Schedule
from pipeline.training.refit import TrainingSet
from pipeline.training.runner import MIN_OWN_DEMONSTRATIONS
from pipeline.training.vae.engines.simd_kernels import LANES
from studies.search.stack import LaneSetting, fit_settings

SAMPLED, ENSEMBLE, REPEAT = "sampled", "ensemble", "repeat"  # origins of the rows of settings.csv
OWN = "own"  # the split of a model's own demonstrations
SHARED = ("latent", "hidden", "scenes_per_step")  # settings that all models of a stack share
Model = TypeVar("Model", bound=ValidityModel)
Setting = Mapping[str, Any]  # parameter -> value, as in `studies.search.space`


@dataclass(frozen=True)
class Fit:
    """One model to fit."""

    learner: str  # a variant
    setting: Setting
    user: str
    seed: int  # of the training set
    member: int  # number of the initial weights; 0: those of the variant's own stage


@dataclass(frozen=True)
class Predicted:
    """A fitted model's P(valid) with the labels, by split; OWN: the model's demonstrations."""

    p: dict[str, Float[Array, "scene path"]]
    valid: dict[str, Bool[Array, "scene path"]]
    reconstruction_over_flat: float  # NaN without a decoder
    seconds: float  # of one core


def default(cfg: DictConfig, learner: str) -> dict[str, Any]:
    """Return the setting of the main results, with the parameters that are searched for this learner."""
    v = cfg.variants[learner]
    setting: dict[str, Any] = {"rate": cfg[v.stage].rate, "weight_decay": cfg[v.stage].weight_decay}
    if v.kind == "vae":
        setting |= {"dropout": 0.0, "jitter": False, "symmetries": False, "scenes_per_step": cfg.scenes.per_seed}
        setting |= {"latent": v.model.latent, "hidden": v.model.hidden}
        setting |= {name: v[name] for name, other in (("beta", v.beta), ("gamma", v.alpha)) if other}
    elif v.kind == "reward":
        setting |= {name: v.model[name] for name in ("dropout", "symmetric", "channels", "gain")}
        setting |= {"sparsity": cfg.irl.sparsity, "scenes_per_step": cfg.irl.scenes_per_step, "jitter": True}
    else:
        setting |= {"members": v.model.members, "bound": ClearanceModel.bound}
    return setting


def fit_all(cfg: DictConfig, fits: Sequence[Fit], splits: Sequence[str], desc: str) -> list[Predicted]:
    """Fit all models in `cfg.workers` processes; return their predictions in the order of `fits`."""
    batches = list(_batches(cfg, fits))
    predicted: dict[int, Predicted] = {}
    jobs = [[fits[i] for i in batch] for batch in batches]
    for batch, answers in zip(batches, map_jobs(partial(_fit, cfg, splits), jobs, cfg.workers, desc), strict=True):
        predicted |= zip(batch, answers, strict=True)
    return [predicted[i] for i in range(len(fits))]


def _batches(cfg: DictConfig, fits: Sequence[Fit]) -> Iterator[list[int]]:
    """Yield batches of fits, by index: models of the paper that share a stack, and single models of other kinds."""

    def shape(i: int) -> tuple:
        return fits[i].learner, *(fits[i].setting[name] for name in SHARED)

    vaes = [i for i, fit in enumerate(fits) if cfg.variants[fit.learner].kind == "vae"]
    for _, group in groupby(sorted(vaes, key=shape), key=shape):
        indices = list(group)
        yield from (indices[i : i + LANES] for i in range(0, len(indices), LANES))
    yield from ([i] for i in range(len(fits)) if i not in vaes)


def _fit(cfg: DictConfig, splits: Sequence[str], batch: Sequence[Fit]) -> list[Predicted]:
    """Fit one batch of a learner, and predict."""
    start = time.process_time()
    v = cfg.variants[batch[0].learner]
    seeds = [_model_seed(cfg, fit) for fit in batch]
    sets = [_training_set(cfg, fit) for fit in batch]
    trainer = {"vae": _fit_vaes, "reward": _fit_reward_maps, "clearance": _fit_clearance_models}[v.kind]
    models = trainer(cfg, batch, sets, seeds)
    predictions = [_predict(cfg, splits, model, x) for model, x in zip(models, sets, strict=True)]
    seconds = (time.process_time() - start) / len(batch)
    return [Predicted(*prediction, seconds) for prediction in predictions]


def _new(kind: type[Model], shape: Setting, seed: int) -> Model:
    model = untrained(kind, shape, seed)
    assert isinstance(model, kind)
    return model


def _model_seed(cfg: DictConfig, fit: Fit) -> int:
    names = fit.seed, fit.user, cfg.main_n_demos, fit.learner
    return job_seed(*names, "member", fit.member) if fit.member else job_seed(*names)


def _training_set(cfg: DictConfig, fit: Fit) -> TrainingSet:
    scenes, demos, _ = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    data = demo_arrays(demos, fit.seed, fit.user, cfg.main_n_demos)
    return TrainingSet(fit.user, fit.seed, scenes.images[train_pool(fit.seed)], *data)


def _fit_vaes(cfg: DictConfig, batch: Sequence[Fit], sets: list[TrainingSet], seeds: list[int]) -> list[BetaVae]:
    v, settings = cfg.variants[batch[0].learner], [fit.setting for fit in batch]
    shape = {**v.model, "latent": settings[0]["latent"], "hidden": settings[0]["hidden"]}
    models = [_new(BetaVae, shape, seed) for seed in seeds]
    lanes = [
        LaneSetting(
            Weights(float(v.alpha), float(s.get("beta", v.beta)), float(s.get("gamma", v.gamma))),
            *(s[name] for name in ("rate", "weight_decay", "dropout", "jitter", "symmetries")),
        )
        for s in settings
    ]
    jitter, root_seed = ColorJitter(**cfg.irl.color_jitter), cfg.studies.search.root_seed
    common = Schedule.of(cfg.train), settings[0]["scenes_per_step"], jitter, cfg.irl.n_augmentations, root_seed
    fit_settings(models, sets, lanes, seeds, *common)
    return models


def _fit_reward_maps(
    cfg: DictConfig, batch: Sequence[Fit], sets: list[TrainingSet], seeds: list[int]
) -> list[RewardMap]:
    models = []
    for fit, x, seed in zip(batch, sets, seeds, strict=True):
        v, s = cfg.variants[fit.learner], fit.setting
        shape = {**v.model, **{name: s[name] for name in ("dropout", "symmetric", "channels", "gain")}}
        model = _new(RewardMap, shape, seed)
        values = {**cfg.irl, "steps": v.steps, "n_augmentations": cfg.irl.n_augmentations if s["jitter"] else 1}
        values |= {name: s[name] for name in ("rate", "weight_decay", "sparsity", "scenes_per_step")}
        irl.fit(model, x.images, x.z_theta, x.valid, v.objective, irl.IrlSchedule.of(values), seed)
        models.append(model)
    return models


def _fit_clearance_models(
    cfg: DictConfig, batch: Sequence[Fit], sets: list[TrainingSet], seeds: list[int]
) -> list[ClearanceModel]:
    models = []
    for fit, x, seed in zip(batch, sets, seeds, strict=True):
        s = fit.setting
        model = _new(ClearanceModel, {"members": s["members"]}, seed)
        model.bound = s["bound"]
        schedule = Schedule.of({**cfg.clearance, "rate": s["rate"], "weight_decay": s["weight_decay"]})
        clearance.fit([model], [x.images], [x.z_theta], [x.valid], schedule, [seed])
        models.append(model)
    return models


def _predict(
    cfg: DictConfig, splits: Sequence[str], model: ValidityModel, x: TrainingSet
) -> tuple[dict[str, Array], dict[str, Array], float]:
    """Return P(valid) and labels by split, and the error of reconstruction over a flat colour's."""
    scenes, _, queries = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    p, valid = {OWN: model.probability(x.images, x.z_theta)}, {OWN: x.valid}
    for split in splits:
        pool = cfg.protocol.splits[split] or train_pool(x.seed)
        p[split] = model.probability(scenes.images[pool], queries[pool].z)
        valid[split] = queries[pool].valid[x.user]
    return p, valid, model.reconstruction_over_flat(x.images)


def scores(predicted: Sequence[Predicted], has_decoder: bool) -> dict[str, float]:
    """Return the scores of one user's ensemble, whose members' P(valid) are averaged.

    accuracy.<split> and balanced.<split>: the share of paths judged right, and its mean over valid and invalid paths.
    """
    first, result = predicted[0], {}
    for split in first.p:
        p, valid = np.mean([x.p[split] for x in predicted], 0) > DECISION, first.valid[split]
        result[f"accuracy.{split}"] = float((p == valid).mean())
        result[f"balanced.{split}"] = float(balanced_accuracy_score(valid.ravel(), p.ravel()))
    ratio = max(x.reconstruction_over_flat for x in predicted) if has_decoder else np.nan
    passed = result.get(f"accuracy.{OWN}", 0.0) >= MIN_OWN_DEMONSTRATIONS and (not has_decoder or ratio < 1)
    return result | {"reconstruction_over_flat": ratio, "passed": passed, "seconds": sum(x.seconds for x in predicted)}


def fits_of(cfg: DictConfig, learner: str, setting: Setting, seeds: Sequence[int], members: Sequence[int]) -> list[Fit]:
    """Return the models of one setting, users outermost, members innermost."""
    return [Fit(learner, setting, user, s, m) for user in cfg.evaluate.users for s in seeds for m in members]


def ranges_of(cfg: DictConfig, learner: str) -> dict[str, Any]:
    """Return the ranges of the parameters that are searched for a learner (conf/studies/search.yaml)."""
    space: Any = OmegaConf.to_container(cfg.studies.search.space[cfg.variants[learner].kind])
    empty = dict.fromkeys(("log", "even", "one_of"))
    return {name: empty | space[name] for name in space if name in default(cfg, learner)}


def setting_of(row: Mapping[str, Any], ranges: Mapping[str, Any]) -> dict[str, Any]:
    """Return the setting in a row of settings.csv, in the types of its parameters."""
    setting = {}
    for name, values in ranges.items():
        choices = values["one_of"]
        setting[name] = float(row[name]) if choices is None else next(x for x in choices if x == row[name])
    return setting
