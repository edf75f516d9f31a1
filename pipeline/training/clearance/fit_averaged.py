"""Fit averaged clearance models: first each family's members by likelihood, then each family's weight by BIC."""

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from scipy.special import entr
from torch import Tensor

from pipeline.models.clearance.clearance import EVIDENCE_PENALTY_NATS, PerceivedObjects
from pipeline.models.clearance.rule_averaging import FAMILIES, TERMS, AveragedModel, Relations, relations
from pipeline.training.clearance.fit import CERTAIN_LOG_ODDS, bootstrap, set_feature_scaling
from pipeline.training.loop import Losses, Schedule, is_constant, minimise, rule_of_succession


def fit(
    model: AveragedModel,
    images: UInt8[Array, "scene 100 100 3"],
    z_theta: Float[Array, "scene n 2"],
    valid: Bool[Array, "scene n"],
    schedule: Schedule,
    seed: int,
) -> Float[Array, "point 2"]:
    """Train all members in place as clearance models are, then set the families' weights; return the curve (`CURVE`).

    If all labels are equal, the model answers Laplace's probability for every path.
    """
    model.rate.fill_(rule_of_succession(valid))
    if is_constant(valid):
        model.evidence.fill_(-CERTAIN_LOG_ODDS)
        return np.array([[0.0, 0.0]])
    percept = set_feature_scaling(model, images)
    related = relations(percept, torch.tensor(z_theta).float())
    present = PerceivedObjects.of(percept[:, : related.terms.shape[2]]).present > 0
    gaps = related.terms[:, 0, :, TERMS.index("proximity")][present]
    if len(gaps) > 1:
        model.gaps.copy_(torch.stack([gaps.mean(), gaps.std().clamp(min=1e-3)]))
    weights = bootstrap(model, len(valid), seed) / valid.shape[1]  # (member, scene, 1)
    labels = torch.tensor(valid)

    def loss() -> Losses:
        log_valid = model.log_valid_related(percept, related).clamp(max=-1e-6)
        negative_log_likelihood = -torch.where(labels, log_valid, torch.log(-torch.expm1(log_valid)))
        by_member = (weights * negative_log_likelihood).sum(-1).mean(-1)  # (member,)
        return by_member.sum(), [by_member.mean()]

    curve = minimise(loss, model.parameters(), schedule)
    set_model_evidence(model, percept, related, labels)
    return curve


@torch.no_grad()
def set_model_evidence(
    model: AveragedModel, percept: Tensor, related: Relations, valid: Bool[Tensor, "scene n"]
) -> None:
    """Set each family's evidence: its gain in log-likelihood over one rate for all paths, minus its BIC penalty."""
    logits = model.logit_by_family(percept, related)
    targets = valid.float().expand_as(logits)
    negative_log_likelihood = F.binary_cross_entropy_with_logits(logits, targets, reduction="none").sum((1, 2))
    rate = float(valid.float().mean())
    negative_log_likelihood_at_rate = valid.numel() * (entr(rate) + entr(1 - rate))
    price = 0.5 * np.log(valid.numel()) * torch.tensor(list(FAMILIES.values()))
    model.evidence.copy_(negative_log_likelihood_at_rate - negative_log_likelihood - EVIDENCE_PENALTY_NATS - price)
