"""The clearance model: how close a path comes to each detected object, and which objects are relevant to the user.

Every object detected in the image (pipeline.perception.objects) has a relevance, the chance that this user keeps away
from objects that look like it, and every path has a clearance from it. A path is valid if it comes too close to no
relevant object, and to none that was missed. Whether any object is relevant has to be learned, too: until the labels
say so, a path is as likely to be valid as any other.
Turning or reflecting scene and path together changes neither clearance nor relevance, so the task's symmetries hold
exactly.
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

PATH_SAMPLES = (
    160  # points along a path: 1 cm apart on the longest, so that a clearance is right within half a millimetre
)
MARGIN_UNIT_M = 0.03  # a margin's unit as it is trained, so that one learning rate suits all parameters
MIN_WIDTH_M = 0.003  # a third of a pixel; no image shows the edge of an object more exactly
SHARPENING = 1.25  # factor of the members' mean log-odds: a mean of probabilities is less confident than it is accurate
EVIDENCE_PRICE = 6.0  # nats that labels must gain in likelihood before relevance is as credible as irrelevance
FEATURES_PER_MEMBER = 4  # by which each member tells objects from one another
FEATURE_BOUND = 1.5  # standard deviations of the training objects' features, beyond which an object counts no further


class PerceivedObjects(NamedTuple):
    """The detected objects of each scene by name; `of` reads them from a percept, `percept` packs them into one."""

    start: Float[Tensor, "*scene object 2"]  # of the capsule's segment [m]
    end: Float[Tensor, "*scene object 2"]  # [m]
    radius: Float[Tensor, "*scene object"]  # [m]
    features: Float[Tensor, "*scene object feature"]
    present: Float[Tensor, "*scene object"]  # 1, or 0 where the slot is empty

    @classmethod
    def of(cls, percept: Float[Tensor, "*scene object 12"]) -> "PerceivedObjects":
        """Return views of a percept's columns."""
        return cls(percept[..., :2], percept[..., 2:4], percept[..., 4], percept[..., 5:-1], percept[..., -1])

    def percept(self) -> Float[Tensor, "*scene object 12"]:
        """Return the percept: the same numbers in the columns of one tensor."""
        return torch.cat([self.start, self.end, self.radius[..., None], self.features, self.present[..., None]], -1)


class ClearanceModel(ValidityModel):
    """An ensemble whose members judge by p_valid = p_nothing_missed * (1 - max(relevance * closeness)).

    `relevance` is a logistic function of an object's features and of their squares, both bounded, so that objects
    unlike the training ones stay near them. Each member sees FEATURES_PER_MEMBER of the features, drawn at random
    (random subspaces; Ho, 1998), since the training objects can be told apart in more ways than one.
    `closeness` falls from 1 to 0 around the member's margin as Student's t with 2 degrees of freedom does, since
    outlines are at times far off. `p_nothing_missed` is the chance that no undetected object stands in the way.

    The members' mean is weighed against one `rate` for every path by Akaike's weights of two models (Burnham and
    Anderson, 2002), with EVIDENCE_PRICE in place of the number of parameters, since averaged members fit labels less
    closely than the best one does. Without labels, no object is believed relevant.
    """

    sees: Tensor
    centre: Tensor
    spread: Tensor
    evidence: Tensor
    rate: Tensor
    bound, sharpening = FEATURE_BOUND, SHARPENING

    def __init__(self, members: int):
        super().__init__()
        self.weight = nn.Parameter(0.3 * torch.randn(members, 1 + 2 * len(FEATURES)))  # of the relevance terms
        seen = torch.rand(members, len(FEATURES)).argsort(-1) < FEATURES_PER_MEMBER
        self.register_buffer("sees", torch.cat([torch.ones(members, 1), seen, seen], 1))  # the terms a member uses
        self.margin = nn.Parameter(torch.zeros(members))  # [MARGIN_UNIT_M]; 0 is the object's own outline
        self.width = nn.Parameter(torch.full((members,), float(np.log(0.01))))  # logarithm of [m]
        self.clear = nn.Parameter(torch.full((members,), 4.0))  # log-odds of p_nothing_missed
        self.register_buffer("centre", torch.zeros(len(FEATURES)))  # mean of the training objects' features
        self.register_buffer("spread", torch.ones(len(FEATURES)))  # and their standard deviation
        self.register_buffer("evidence", torch.tensor(-EVIDENCE_PRICE))  # log-odds that objects are relevant at all
        self.register_buffer("rate", torch.tensor(0.5))  # P(valid) if none is

    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene object 12"]:
        """Return the detected objects, packed (see `PerceivedObjects`)."""
        objects = detect_objects(images)
        start, end = torch.from_numpy(objects.ends).unbind(-2)
        radius, features, present = map(torch.from_numpy, (objects.radius, objects.features, objects.present))
        return PerceivedObjects(start, end, radius, features, present.float()).percept()

    def logit(
        self, percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity; differentiable in `z_theta` [m]."""
        log_p_relevant = F.logsigmoid(self.logit_if_relevant(percept, z_theta)) + F.logsigmoid(self.evidence)
        log_p_irrelevant = self.rate.log() + F.logsigmoid(-self.evidence)
        return log_odds(torch.logaddexp(log_p_relevant, log_p_irrelevant))

    def logit_if_relevant(self, percept: Tensor, z_theta: Float[Tensor, "scene path 2"]) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity if objects are relevant at all: of the members' mean, sharpened."""
        log_p_members = self.log_valid(percept, clearance(percept, z_theta))
        return self.sharpening * log_odds(log_p_members.logsumexp(0) - float(np.log(len(log_p_members))))

    def log_valid(
        self, percept: Float[Tensor, "*model scene object 12"], clearances: Float[Tensor, "*model scene path near"]
    ) -> Float[Tensor, "*model member scene path"]:
        """Return each member's log p_valid of paths at these `clearances` [m] from the first objects."""
        margin = (MARGIN_UNIT_M * self.margin)[..., None, None, None, :]  # members last: quickest along neighbours
        width = (self.width.exp() + MIN_WIDTH_M)[..., None, None, None, :]
        x = (margin - clearances[..., None]) / width  # (*model, scene, path, near, member)
        closeness = 0.5 + 0.5 * x / torch.sqrt(1 + x * x)
        relevance = self._relevance(percept[..., : clearances.shape[-1], :])[..., None, :, :]
        log_p_nothing_missed = F.logsigmoid(self.clear)[..., None, None, :]
        # p_valid = p_nothing_missed * (1 - max(relevance * closeness)), as logarithms
        threat = (relevance * closeness).amax(-2).clamp(max=1 - 1e-6)
        return (torch.log1p(-threat) + log_p_nothing_missed).movedim(-1, -3)

    def relevance(
        self, percept: Float[Tensor, "*model scene object 12"]
    ) -> Float[Tensor, "*model member scene object"]:
        """Return each member's chance that the user keeps away from each object; 0 in empty slots."""
        return self._relevance(percept).movedim(-1, -3)

    def _relevance(
        self, percept: Float[Tensor, "*model scene object 12"]
    ) -> Float[Tensor, "*model scene object member"]:
        objects = PerceivedObjects.of(percept)
        features = (objects.features - self.centre[..., None, None, :]) / self.spread[..., None, None, :]
        weight = self.weight * self.sees
        return (self.relevance_terms(features) @ weight.mT.unsqueeze(-3)).sigmoid() * objects.present[..., None]

    def relevance_terms(self, features: Float[Tensor, "*object feature"]) -> Float[Tensor, "*object term"]:
        """Return the terms that relevance is linear in, from standardised features."""
        bounded = features.clamp(-self.bound, self.bound)
        return torch.cat([torch.ones_like(features[..., :1]), bounded, features.tanh().square()], -1)


def log_odds(log_p: Tensor) -> Tensor:
    """Return the log-odds of a probability from its logarithm, at most those of 1 - 1e-6."""
    log_p = log_p.clamp(max=-1e-6)
    return log_p - torch.log(-torch.expm1(log_p))


def clearance(
    percept: Float[Tensor, "scene object 12"], z_theta: Float[Tensor, "scene path 2"]
) -> Float[Tensor, "scene path near"]:
    """Return the distance [m] of each path from each object's outline, negative inside.

    Slots that are empty in every scene are left out.
    """
    b = basis(np.linspace(0.0, 1.0, PATH_SAMPLES))
    fixed = torch.from_numpy(b[:, :1] * P_INIT + b[:, 2:] * P_F).to(z_theta)  # (sample, 2)
    lift = torch.from_numpy(b[:, 1]).to(z_theta)
    # Coordinate by coordinate: torch reduces an axis of length 2 several times slower than it adds two tensors.
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
    """Return how many slots the scene with most objects uses, at least 1; detections fill slots from the first."""
    return max(1, int(PerceivedObjects.of(percept).present.sum(1).max()))
