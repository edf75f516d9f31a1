"""Fitting averaged clearance models: every family's members by likelihood, then each family's weight by its evidence."""

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from scipy.special import entr
from torch import Tensor

from pipeline.models.clearance.clearance import NEEDED
from pipeline.models.clearance.rule_averaging import FORMS, TERMS, AveragedModel, Relations, relations
from pipeline.training.clearance.fit import CERTAIN, bootstrap, look
from pipeline.training.loop import Schedule, is_constant, rule_of_succession


def fit(
    model: AveragedModel,
    images: UInt8[Array, "scene 100 100 3"],
    z_theta: Float[Array, "scene n 2"],
    valid: Bool[Array, "scene n"],
    schedule: Schedule,
    seed: int,
) -> Float[Array, "point 2"]:
    """Train every form's members in place, as clearance models are, and weigh the forms; the learning curve (`CURVE`).

    Demonstrations that never vary teach nothing: the model then answers Laplace's probability, whatever it sees.
    """
    model.rate.fill_(rule_of_succession(valid))
    if is_constant(valid):
        model.evidence.fill_(-CERTAIN)
        return np.array([[0.0, 0.0]])
    percept = look(model, images)
    related = relations(percept, torch.tensor(z_theta).float())
    gaps = related.terms[:, 0, :, TERMS.index("company")][percept[:, : related.terms.shape[2], -1] > 0]
    if len(gaps) > 1:
        model.gaps.copy_(torch.stack([gaps.mean(), gaps.std().clamp(min=1e-3)]))
    counts = bootstrap(model, len(valid), seed) / valid.shape[1]  # (member, scene, 1)
    labels, curve = torch.tensor(valid), []
    optimiser, cycle = schedule.optimiser(model.parameters())
    for step in range(schedule.steps):
        log_valid = model.log_valid_related(percept, related).clamp(max=-1e-6)
        surprise = -torch.where(labels, log_valid, torch.log(-torch.expm1(log_valid)))
        loss = (counts * surprise).sum(-1).mean(-1)  # (member,)
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        cycle.step()
        if step % schedule.curve_every == 0 or step == schedule.steps - 1:
            curve.append((step, float(loss.detach().mean())))
    _weigh(model, percept, related, labels)
    return np.array(curve)


@torch.no_grad()
def _weigh(model: AveragedModel, percept: Tensor, related: Relations, valid: Bool[Tensor, "scene n"]) -> None:
    """Set the evidence of each form: by how much labels are likelier than at one rate, less the parameters' price."""
    by_form = model.by_form(percept, related)
    told = valid.float().expand_as(by_form)
    surprise = F.binary_cross_entropy_with_logits(by_form, told, reduction="none").sum((1, 2))
    rate = float(valid.float().mean())
    chance = valid.numel() * (entr(rate) + entr(1 - rate))
    price = 0.5 * np.log(valid.numel()) * torch.tensor(list(FORMS.values()))
    model.evidence.copy_(chance - surprise - NEEDED - price)
