"""Fit clearance models: every member maximises its own weighted likelihood; then BIC weights the rule families."""

import copy
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.special import entr
from torch import Tensor, nn
from torch.func import stack_module_state

from pipeline.models.base import Images
from pipeline.models.clearance import clearance
from pipeline.models.clearance.clearance import ClearanceModel, PerceivedObjects, passes
from pipeline.perception.objects import Objects
from pipeline.training import loop

CERTAIN_LOG_ODDS = 1e4  # log-odds of certainty [nat]
BATCH_SIZE = 10  # models fitted together, so that their intermediate results fit the cache
CURVE = ("step", "total")  # columns of a learning curve


def trainer(variant: Mapping[str, Any], settings: Mapping[str, Any]) -> loop.Trainer:
    """Return how the clearance model is fitted with the settings of conf/clearance.yaml; `variant` adds none."""
    return loop.Trainer(ClearanceModel, partial(fit, schedule=loop.Schedule.of(settings)), CURVE, BATCH_SIZE)


def fit(models, images, z_theta, valid, schedule, seeds, checkpoints=None) -> list[Float[Array, "point 2"]]:
    """Train models of one shape and equally many scenes in place; return their learning curves (`CURVE`).

    Arguments as in `loop.fit_varied`. Each member weights the scenes at random (Bayesian bootstrap; Rubin, 1981) and
    maximises the weighted likelihood. Every checkpoint has its own model evidence.
    """

    def set_constant(model: ClearanceModel, rate: float) -> tuple[float]:
        model.rate.fill_(rate)
        model.evidence.fill_(-CERTAIN_LOG_ODDS)
        return (0.0,)

    return loop.fit_varied(partial(_ascend, schedule), set_constant, models, images, z_theta, valid, seeds, checkpoints)


def set_feature_scaling(model: ClearanceModel, images: Images | Objects) -> Float[Tensor, "scene object column"]:
    """Set feature scaling and usual doubt from the training images; return the percepts."""
    percept = model.see(images)
    objects = PerceivedObjects.of(percept)
    features = objects.features[objects.present > 0]
    if len(features) > 1:
        model.centre.copy_(features.mean(0))
        model.spread.copy_(features.std(0).clamp(min=1e-3))
    model.usual_doubt.copy_(clearance.USUAL_OVER_LARGEST * objects.doubt.max().clamp(min=1e-3))
    return percept


@torch.no_grad()
def set_model_evidence(model: ClearanceModel, percept: Tensor, z_theta: Array, labels: Array) -> None:
    """Set each family's log-odds against one rate for all paths: its gain in log-likelihood minus its BIC penalty."""
    valid, passing = torch.tensor(labels).float(), passes(percept, torch.tensor(z_theta).float())
    logits = model.logit_by_family(percept, passing)
    log_likelihood = -F.binary_cross_entropy_with_logits(logits, valid.expand_as(logits), reduction="none").sum((1, 2))
    rate = float(valid.mean())
    log_likelihood_at_rate = -valid.numel() * (entr(rate) + entr(1 - rate))
    parameters = torch.tensor([clearance.FAMILIES[family] for family in model.families])
    penalty = clearance.EVIDENCE_PENALTY_NATS + 0.5 * np.log(valid.numel()) * parameters
    model.evidence.copy_(log_likelihood - log_likelihood_at_rate - penalty)


def _ascend(schedule, models, images, z_theta, labels, seeds, checkpoints) -> list[Float[Array, "point 2"]]:
    """Train all members of all models at once: ten models cost as much as four in sequence."""
    for model, own in zip(models, labels, strict=True):
        model.rate.fill_(loop.rule_of_succession(own))
    percepts = [set_feature_scaling(model, scenes) for model, scenes in zip(models, images, strict=True)]
    percept, stacked = torch.stack(percepts), copy.deepcopy(models[0])  # (model, scene, object, column)
    parameters, buffers = stack_module_state(models)
    for name, value in parameters.items():
        setattr(stacked, name, nn.Parameter(value.detach()))
    for name, value in buffers.items():
        setattr(stacked, name, value)
    paths = torch.tensor(np.stack(loop.pad_demonstrations(z_theta))).float()
    flat = passes(percept.flatten(0, 1), paths.flatten(0, 1))
    passing = clearance.Passing(*(x.unflatten(0, percept.shape[:2]) for x in flat))
    valid = torch.tensor(np.stack(loop.pad_demonstrations(labels)))[:, None]
    rows = torch.from_numpy(loop.row_weights([own.shape[1] for own in labels]).T).float()[:, None, None]
    families, members = models[0].margin.shape  # the members' random weights of the scenes are the same in all families
    draws, empty = [torch.Generator().manual_seed(seed) for seed in seeds], torch.empty(members, percept.shape[1], 1)
    of_scenes = torch.stack([empty.clone().exponential_(generator=draw) for draw in draws])
    weights = rows * of_scenes.repeat(1, families, 1, 1)  # (model, member, scene, row)

    def loss() -> loop.Losses:
        log_valid = stacked.log_valid(percept, passing).clamp(max=-1e-6)
        negative_log_likelihood = -torch.where(valid, log_valid, torch.log(-torch.expm1(log_valid)))
        by_member = (weights * negative_log_likelihood).sum(-1).mean(-1)  # (model, member)
        return by_member.sum(), [by_member.mean(-1)]

    @torch.no_grad()
    def hand_over() -> None:
        loop.unstack_models(dict(stacked.named_parameters()), models)
        for data in zip(models, percepts, z_theta, labels, strict=True):
            set_model_evidence(*data)

    curve = loop.minimise(loss, stacked.parameters(), schedule, partial(checkpoints.keep, models, hand_over))
    hand_over()
    return list(curve.transpose(2, 0, 1))
