"""Bayesian model averaging over rule families, weighted by BIC.

Every family is a clearance model (pipeline.models.clearance.clearance). Families differ in what else decides validity:

- margin: nothing;
- dwell: how long a path is too close;
- side: the side on which it passes an object;
- proximity: whether the object has a neighbour;
- progress: how far along the path the object is passed.

A family's weight is its likelihood with the penalty of BIC on its additional parameters (Schwarz, 1978). The weights
are posterior probabilities of the user's rule family.
"""

from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.models.clearance.clearance import (
    EVIDENCE_PENALTY_NATS,
    MARGIN_UNIT_M,
    MIN_WIDTH_M,
    PATH_SAMPLES,
    ClearanceModel,
    PerceivedObjects,
    log_odds,
    occupied_slots,
)
from pipeline.world.bezier import P_F, P_INIT, basis
from pipeline.world.layout import segment_distance

FAMILIES = {"margin": 0, "dwell": 1, "side": 1, "proximity": 1, "progress": 2}  # parameters in addition to margin's
TERMS = ("side", "proximity", "progress", "progress")  # inputs of relevance besides appearance, by family
MAX_FORGIVEN_SHARE = 0.3  # largest share of the path that `dwell` can forgive
SHARES = np.linspace(0, MAX_FORGIVEN_SHARE, 13)  # shares of the path at which clearances are kept
LATERAL_SCALE_M = 0.02  # lateral distance [m] at which an object counts as fully on one side
GAP_RANGE_M = 0.01, 1.0  # range of gaps between objects [m]; a missing neighbour counts as the upper end
GATE = 3.0  # unit of the gate parameter, so that one learning rate suits all parameters


class Relations(NamedTuple):
    """Relations between paths and objects: clearances and the inputs of relevance."""

    clearance: Float[Tensor, "scene path near share"]  # [m]; closer for at most this share of the path (SHARES)
    terms: Float[Tensor, "scene path near term"]  # TERMS; proximity is the logarithm of a gap [m], not yet standardised


class AveragedModel(ClearanceModel):
    """An ensemble of `members` clearance models per rule family, averaged over families.

    Relevance may depend on how an object is passed, closeness on how long. P(valid) is the mean over the families and a
    constant `rate`, weighted by `posterior_model_probabilities`.
    """

    uses: Tensor
    lasts: Tensor
    gaps: Tensor
    evidence: Tensor

    def __init__(self, members: int):
        super().__init__(members * len(FAMILIES))
        family = torch.arange(len(FAMILIES)).repeat_interleave(members)[:, None]  # family of each member
        uses = torch.tensor([[name == term for term in TERMS] for name in FAMILIES])
        self.register_buffer("uses", uses[family[:, 0]].float())
        self.register_buffer("lasts", (family == list(FAMILIES).index("dwell")).float())
        self.gate = nn.Parameter(torch.zeros(len(family), len(TERMS)))  # unit: GATE
        self.forgiven = nn.Parameter(torch.full((len(family), 1), -1.5))  # log-odds of the share of MAX_FORGIVEN_SHARE
        self.register_buffer("gaps", torch.tensor([0.0, 1.0]))  # mean and standard deviation of log gaps in training
        self.evidence = torch.full((len(FAMILIES),), -EVIDENCE_PENALTY_NATS)  # log-odds of each family against `rate`

    def logit(
        self, percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity of each path; differentiable in `z_theta` [m]."""
        return self.logit_related(percept, relations(percept, z_theta))

    def logit_related(self, percept: Tensor, related: Relations) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity of paths with these relations to the objects."""
        by_family = F.logsigmoid(self.logit_by_family(percept, related))
        log_p = torch.cat([by_family, self.rate.log().expand(1, *by_family.shape[1:])])
        return log_odds((log_p + self.posterior_model_probabilities().log()[:, None, None]).logsumexp(0))

    def posterior_model_probabilities(self) -> Float[Tensor, " family_or_constant"]:
        """Return the posterior probability of each family and, last, of the constant `rate`."""
        return torch.cat([self.evidence, torch.zeros(1)]).softmax(0).clamp(min=1e-30)

    def logit_by_family(
        self, percept: Float[Tensor, "scene object 12"], related: Relations
    ) -> Float[Tensor, "family scene path"]:
        """Return each family's log-odds of validity: of its members' mean, times `sharpening`."""
        by_member = self.log_valid_related(percept, related).unflatten(0, (len(FAMILIES), -1))
        return self.sharpening * log_odds(by_member.logsumexp(1) - float(np.log(by_member.shape[1])))

    def log_valid_related(
        self, percept: Float[Tensor, "scene object 12"], related: Relations
    ) -> Float[Tensor, "member scene path"]:
        """Return each member's log P(valid), given the paths' relations to the objects."""
        objects = PerceivedObjects.of(percept[:, : related.terms.shape[2]])
        features = (objects.features - self.centre) / self.spread
        appearance = self.relevance_terms(features) @ (self.weight * self.feature_mask).T
        gate = self._gates(related.terms) @ (GATE * self.gate * self.uses).T  # (scene, path, near, member)
        relevance = (appearance[:, None] + gate).sigmoid() * objects.present[:, None, :, None]
        x = (MARGIN_UNIT_M * self.margin - related.clearance @ self._share().T) / (self.width.exp() + MIN_WIDTH_M)
        threat = (relevance * (0.5 + 0.5 * x / torch.sqrt(1 + x * x))).amax(-2).clamp(max=1 - 1e-6)
        return (torch.log1p(-threat) + F.logsigmoid(self.logit_nothing_missed)).movedim(-1, 0)

    def _gates(self, terms: Float[Tensor, "scene path near term"]) -> Float[Tensor, "scene path near term"]:
        side, log_gap, progress, _ = terms.unbind(-1)
        log_gap = ((log_gap - self.gaps[0]) / self.gaps[1]).clamp(-self.bound, self.bound)
        return torch.stack([side, log_gap, progress, progress.square() - 1 / 3], -1)

    def _share(self) -> Float[Tensor, "member share"]:
        """Return each member's interpolation weights over SHARES for the share of the path that it forgives."""
        forgiven = MAX_FORGIVEN_SHARE * self.forgiven.sigmoid() * self.lasts  # (member, 1)
        return F.relu(1 - (forgiven - torch.from_numpy(SHARES).float()).abs() / float(SHARES[1]))


def relations(percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]) -> Relations:
    """Return how each path [m] passes each object; slots that are empty in every scene are left out."""
    t = np.linspace(0.0, 1.0, PATH_SAMPLES)
    ends, lift = (torch.from_numpy(x).to(z_theta) for x in (basis(t)[:, ::2] @ [P_INIT, P_F], basis(t)[:, 1:2]))
    points = ends + lift * z_theta[:, :, None]  # (scene, path, sample, 2)
    start, goal, t = (torch.tensor(x).to(z_theta) for x in (P_INIT, P_F, t[:, None]))
    heading = (1 - t) * (z_theta[:, :, None] - start) + t * (goal - z_theta[:, :, None])
    heading = heading / (heading.square().sum(-1, keepdim=True) + 1e-12).sqrt()  # `norm` rounds differently by process
    near = percept[:, : occupied_slots(percept)]
    log_gap = _log_gap(near)
    at_shares = torch.from_numpy(SHARES * (PATH_SAMPLES - 1)).round().long()
    clearances, terms = [], []
    for slot, gap in zip(near.unbind(1), log_gap.unbind(1), strict=True):
        objects = PerceivedObjects.of(slot)
        first, last, radius = objects.start[:, None, None], objects.end[:, None, None], objects.radius
        along = last - first
        share = ((points - first) * along).sum(-1) / along.square().sum(-1).clamp(min=1e-12)
        away = points - first - share.clamp(0, 1)[..., None] * along
        distance = (away.square().sum(-1) + 1e-12).sqrt() - radius[:, None, None]
        nearest = distance.argmin(-1)[..., None, None]
        ahead, here = (torch.take_along_dim(x, nearest, 2)[:, :, 0] for x in (heading, points))
        to = (first + along / 2)[:, :, 0] - here
        lateral = (ahead[..., 1] * to[..., 0] - ahead[..., 0] * to[..., 1]) / LATERAL_SCALE_M
        progress = 2 * nearest[..., 0, 0].to(z_theta) / (PATH_SAMPLES - 1) - 1
        clearances.append(distance.sort(-1).values[..., at_shares])
        terms.append(torch.stack([lateral.tanh(), gap[:, None].expand_as(progress), progress, progress], -1))
    return Relations(torch.stack(clearances, 2), torch.stack(terms, 2))


def _log_gap(percept: Float[Tensor, "scene object 12"]) -> Float[Tensor, "scene object"]:
    """Return the logarithm of the gap [m] between each object and its nearest neighbour, clipped to GAP_RANGE_M."""
    objects = PerceivedObjects.of(percept)
    segments = torch.stack([objects.start, objects.end], -2).double().numpy()
    apart = torch.from_numpy(segment_distance(segments[:, :, None], segments[:, None])).to(percept)
    gap = apart - objects.radius[:, :, None] - objects.radius[:, None, :]
    present = objects.present > 0
    other = present[:, :, None] & present[:, None] & ~torch.eye(percept.shape[1], dtype=torch.bool)
    return torch.where(other, gap, GAP_RANGE_M[1]).amin(-1).clamp(*GAP_RANGE_M).log()
