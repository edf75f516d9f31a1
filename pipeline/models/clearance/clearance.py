"""The clearance model: a path is valid if it keeps away from every object that is relevant to the user.

Objects are detected in the image without training (pipeline.perception.objects). Each has a relevance: the probability
that this user keeps away from objects of its appearance. Each path has a clearance [m] from each object. A path is
invalid if it comes too close to a relevant object, or to one that the detector missed. The labels also decide whether
any object is relevant at all; without such evidence all paths have the same P(valid).

Rotating or reflecting scene and path together changes neither clearance nor relevance, so the model has the task's
symmetries exactly.
"""

from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.models.base import ValidityModel
from pipeline.perception.objects import FEATURES, detect_objects
from pipeline.world.bezier import P_F, P_INIT, basis

PATH_SAMPLES = 160  # points along a path: at most 1 cm apart, so that clearances are exact within half a millimetre
MARGIN_UNIT_M = 0.03  # unit of the margin parameter [m], so that one learning rate suits all parameters
MIN_WIDTH_M = 0.003  # smallest transition width [m]: a third of a pixel, the limit of an outline's accuracy
SHARPENING = 1.25  # factor on the log-odds of the members' mean, since averaged probabilities are underconfident
EVIDENCE_PENALTY_NATS = 6.0  # log-likelihood gain [nat] at which relevance is as credible as irrelevance
FEATURES_PER_MEMBER = 4  # number of features that each member uses
FEATURE_BOUND = 1.5  # bound on standardised features [standard deviations over the training objects]


class PerceivedObjects(NamedTuple):
    """The detected objects of each scene by name; `of` unpacks a percept, `percept` packs it."""

    start: Float[Tensor, "*scene object 2"]  # of the capsule's segment [m]
    end: Float[Tensor, "*scene object 2"]  # of the capsule's segment [m]
    radius: Float[Tensor, "*scene object"]  # of the capsule [m]
    features: Float[Tensor, "*scene object feature"]
    present: Float[Tensor, "*scene object"]  # 1 for an object, 0 for an empty slot

    @classmethod
    def of(cls, percept: Float[Tensor, "*scene object 12"]) -> "PerceivedObjects":
        """Return views of the percept's columns."""
        return cls(percept[..., :2], percept[..., 2:4], percept[..., 4], percept[..., 5:-1], percept[..., -1])

    def percept(self) -> Float[Tensor, "*scene object 12"]:
        """Return the percept: all fields as columns of one tensor."""
        return torch.cat([self.start, self.end, self.radius[..., None], self.features, self.present[..., None]], -1)


class ClearanceModel(ValidityModel):
    """An ensemble with p_valid = p_nothing_missed * (1 - max(relevance * closeness)) in each member.

    `relevance` is a logistic function of an object's features and their squares. Features are bounded so that it does
    not extrapolate to objects unlike the training ones. Each member uses FEATURES_PER_MEMBER random features (random
    subspaces; Ho, 1998), because several feature sets explain the training objects equally well. `closeness` falls from
    1 to 0 around the member's margin, as Student's t distribution with 2 degrees of freedom. Its heavy tails allow for
    outlines that are far off. `p_nothing_missed` is the probability that no undetected object blocks the path.

    The members' mean is averaged with a constant `rate` by Akaike weights of the two models (Burnham and Anderson,
    2002). EVIDENCE_PENALTY_NATS replaces the number of parameters, because averaged members fit the labels less closely
    than the best one. Without labels, P(valid) is the constant.
    """

    feature_mask: Tensor
    centre: Tensor
    spread: Tensor
    evidence: Tensor
    rate: Tensor
    bound, sharpening = FEATURE_BOUND, SHARPENING

    def __init__(self, members: int):
        super().__init__()
        self.weight = nn.Parameter(0.3 * torch.randn(members, 1 + 2 * len(FEATURES)))  # coefficients of relevance
        used = torch.rand(members, len(FEATURES)).argsort(-1) < FEATURES_PER_MEMBER
        mask = torch.cat([torch.ones(members, 1), used, used], 1)
        self.register_buffer("feature_mask", mask)  # 1: the member uses the term
        self.margin = nn.Parameter(torch.zeros(members))  # [MARGIN_UNIT_M]; 0 is the object's outline
        self.width = nn.Parameter(torch.full((members,), float(np.log(0.01))))  # logarithm of the transition width [m]
        self.logit_nothing_missed = nn.Parameter(torch.full((members,), 4.0))  # log-odds of p_nothing_missed
        self.register_buffer("centre", torch.zeros(len(FEATURES)))  # mean of the training objects' features
        self.register_buffer("spread", torch.ones(len(FEATURES)))  # their standard deviation
        self.register_buffer("evidence", torch.tensor(-EVIDENCE_PENALTY_NATS))  # log-odds that any object is relevant
        self.register_buffer("rate", torch.tensor(0.5))  # P(valid) if no object is relevant

    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene object 12"]:
        """Return the detected objects, packed as by `PerceivedObjects.percept`."""
        objects = detect_objects(images)
        start, end = torch.from_numpy(objects.ends).unbind(-2)
        radius, features, present = map(torch.from_numpy, (objects.radius, objects.features, objects.present))
        return PerceivedObjects(start, end, radius, features, present.float()).percept()

    def logit(
        self, percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity of each path; differentiable in `z_theta` [m]."""
        log_p_relevant = F.logsigmoid(self.logit_if_relevant(percept, z_theta)) + F.logsigmoid(self.evidence)
        log_p_irrelevant = self.rate.log() + F.logsigmoid(-self.evidence)
        return log_odds(torch.logaddexp(log_p_relevant, log_p_irrelevant))

    def logit_if_relevant(self, percept: Tensor, z_theta: Float[Tensor, "scene path 2"]) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity given that objects are relevant: of the members' mean, times `sharpening`."""
        log_p_members = self.log_valid(percept, clearance(percept, z_theta))
        return self.sharpening * log_odds(log_p_members.logsumexp(0) - float(np.log(len(log_p_members))))

    def log_valid(
        self, percept: Float[Tensor, "*model scene object 12"], clearances: Float[Tensor, "*model scene path near"]
    ) -> Float[Tensor, "*model member scene path"]:
        """Return each member's log p_valid, given the paths' `clearances` [m] from the objects in the first slots."""
        margin = (MARGIN_UNIT_M * self.margin)[..., None, None, None, :]  # members last: fastest access
        width = (self.width.exp() + MIN_WIDTH_M)[..., None, None, None, :]
        x = (margin - clearances[..., None]) / width  # (*model, scene, path, near, member)
        closeness = 0.5 + 0.5 * x / torch.sqrt(1 + x * x)
        relevance = self._relevance(percept[..., : clearances.shape[-1], :])[..., None, :, :]
        log_p_nothing_missed = F.logsigmoid(self.logit_nothing_missed)[..., None, None, :]
        # p_valid = p_nothing_missed * (1 - max(relevance * closeness)), as logarithms
        threat = (relevance * closeness).amax(-2).clamp(max=1 - 1e-6)
        return (torch.log1p(-threat) + log_p_nothing_missed).movedim(-1, -3)

    def relevance(
        self, percept: Float[Tensor, "*model scene object 12"]
    ) -> Float[Tensor, "*model member scene object"]:
        """Return each member's probability that the user keeps away from each object; 0 in empty slots."""
        return self._relevance(percept).movedim(-1, -3)

    def _relevance(
        self, percept: Float[Tensor, "*model scene object 12"]
    ) -> Float[Tensor, "*model scene object member"]:
        objects = PerceivedObjects.of(percept)
        features = (objects.features - self.centre[..., None, None, :]) / self.spread[..., None, None, :]
        weight = self.weight * self.feature_mask
        return (self.relevance_terms(features) @ weight.mT.unsqueeze(-3)).sigmoid() * objects.present[..., None]

    def relevance_terms(self, features: Float[Tensor, "*object feature"]) -> Float[Tensor, "*object term"]:
        """Return the terms in which relevance is linear: constant, bounded features and their squares."""
        bounded = features.clamp(-self.bound, self.bound)
        return torch.cat([torch.ones_like(features[..., :1]), bounded, features.tanh().square()], -1)


def log_odds(log_p: Tensor) -> Tensor:
    """Return the log-odds of a probability given as its logarithm; probabilities are capped at 1 - 1e-6."""
    log_p = log_p.clamp(max=-1e-6)
    return log_p - torch.log(-torch.expm1(log_p))


def clearance(
    percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]
) -> Float[Tensor, "scene path near"]:
    """Return the clearance [m] of each path from each object's outline, negative inside.

    Leaves out slots that are empty in every scene.
    """
    b = basis(np.linspace(0.0, 1.0, PATH_SAMPLES))
    fixed = torch.from_numpy(b[:, :1] * P_INIT + b[:, 2:] * P_F).to(z_theta)  # (sample, 2)
    lift = torch.from_numpy(b[:, 1]).to(z_theta)
    # One coordinate at a time: torch reduces an axis of length 2 several times slower than it adds two tensors.
    x, y = (c + lift * z[..., None] for c, z in zip(fixed.unbind(-1), z_theta.unbind(-1), strict=True))
    distances = []
    for slot in percept[:, : occupied_slots(percept)].unbind(1):
        objects = PerceivedObjects.of(slot)
        start_x, start_y = (c[:, None, None] for c in objects.start.unbind(-1))
        end_x, end_y = (c[:, None, None] for c in objects.end.unbind(-1))
        along_x, along_y, from_x, from_y = end_x - start_x, end_y - start_y, x - start_x, y - start_y
        length = (along_x.square() + along_y.square()).clamp(min=1e-12)
        share = ((from_x * along_x + from_y * along_y) / length).clamp(0, 1)
        nearest = ((from_x - share * along_x).square() + (from_y - share * along_y).square()).amin(-1)
        distances.append(nearest.clamp(min=1e-12).sqrt() - objects.radius[:, None])
    return torch.stack(distances, -1)


def occupied_slots(percept: Float[Tensor, "scene object 12"]) -> int:
    """Return the largest number of objects in a scene, at least 1; detections fill slots from the first."""
    return max(1, int(PerceivedObjects.of(percept).present.sum(1).max()))
