"""A specification that sees the path: how close it comes to each thing on the table, and which things matter.

Every thing found in the picture (pipeline.perception.objects) has a relevance, the chance that this user keeps away from
things that look like it, and every path a clearance from it. A path is valid if it comes too close to no thing that
matters, and to none that was not found. Whether anything matters at all has to be learned, too: until the labels say
so, a path is as likely to be valid as any other.
Turning or reflecting table and path together changes neither, so the task's symmetries hold exactly.
"""

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.models.base import ValidityModel
from pipeline.perception.objects import FEATURES, detect_objects
from pipeline.world.bezier import P_F, P_INIT, basis

SAMPLES = 160  # points along a path: 1 cm apart on the longest, so that a clearance is right within half a millimetre
UNIT = 0.03  # metres: a margin's unit as it is trained, so that one rate suits all parameters
SHARPEST = 0.003  # metres: a third of a pixel, no more exactly does a picture show where a thing ends
SHARPENING = 1.25  # of the log-odds of the members' mean: a mean of opinions is less sure than it is right
NEEDED = 6.0  # nats: what labels must gain in likelihood for "things matter" to be as credible as "nothing does"
SEEN = 4  # features by which each member tells things from one another
BOUND = 1.5  # standard deviations of the training things' features, beyond which a thing counts as no more unlike them


class ClearanceModel(ValidityModel):
    """Several members' opinions of one user, averaged. P(valid) of each: clear * (1 - threat), where threat is the
    largest of the things' relevance * closeness.

    Their average is believed as far as the evidence goes, and else `rate`, the same for every path. These are Akaike's
    weights of two models (Burnham and Anderson, 2002), NEEDED in place of the number of parameters, for averaged
    members fit labels less closely than the best one does. Without a label, nothing is believed to matter.

    `clear` is the chance that nothing that was not found stands in the way. Relevance is the logistic function of the
    thing's features and of their squares, both bounded, so that things unlike the training ones stay near them. Each
    member sees SEEN of the features, drawn at random (random subspaces; Ho, 1998): the training things can be told
    apart in more ways than one, and not each of them holds for other things.
    Closeness falls from 1 to 0 around the margin as Student's t with 2 degrees of freedom does: outlines are at times
    far off.
    """

    sees: Tensor
    centre: Tensor
    spread: Tensor
    evidence: Tensor
    rate: Tensor
    bound, sharpening = BOUND, SHARPENING

    def __init__(self, members: int):
        super().__init__()
        self.weight = nn.Parameter(0.3 * torch.randn(members, 1 + 2 * len(FEATURES)))  # of a thing's features
        seen = torch.rand(members, len(FEATURES)).argsort(-1) < SEEN
        self.register_buffer("sees", torch.cat([torch.ones(members, 1), seen, seen], 1))  # of the terms of `weight`
        self.margin = nn.Parameter(torch.zeros(members))  # [UNIT]; things' own outlines to start with
        self.width = nn.Parameter(torch.full((members,), float(np.log(0.01))))  # logarithm of [m]
        self.clear = nn.Parameter(torch.full((members,), 4.0))  # log-odds
        self.register_buffer("centre", torch.zeros(len(FEATURES)))  # of the training things' features
        self.register_buffer("spread", torch.ones(len(FEATURES)))
        self.register_buffer("evidence", torch.tensor(-NEEDED))  # log-odds that things matter
        self.register_buffer("rate", torch.tensor(0.5))  # P(valid) if nothing does

    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene thing 12"]:
        """Detect the objects: the two ends [m] of each, radius [m], features, and 1 if it is present."""
        objects = detect_objects(images)
        parts = (
            objects.ends.reshape(*objects.radius.shape, 4), objects.radius[..., None],
            objects.features, objects.present[..., None],
        )  # fmt: skip
        return torch.from_numpy(np.concatenate(parts, -1, dtype=np.float32))

    def logit(
        self, percept: Float[Tensor, "scene thing 12"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Log-odds of validity; differentiable in `z_theta` [m]."""
        by_things = F.logsigmoid(self.of_things(percept, z_theta)) + F.logsigmoid(self.evidence)
        by_rate = self.rate.log() + F.logsigmoid(-self.evidence)
        return log_odds(torch.logaddexp(by_things, by_rate))

    def of_things(self, percept: Tensor, z_theta: Float[Tensor, "scene path 2"]) -> Float[Tensor, "scene path"]:
        """Log-odds of validity if things matter: of the members' mean, sharpened."""
        by_member = self.log_valid(percept, clearance(percept, z_theta))
        return self.sharpening * log_odds(by_member.logsumexp(0) - float(np.log(len(by_member))))

    def log_valid(
        self, percept: Float[Tensor, "*model scene thing 12"], clearances: Float[Tensor, "*model scene path near"]
    ) -> Float[Tensor, "*model member scene path"]:
        """log P(valid) by each member's opinion, from the paths' clearances [m]."""
        margin = (UNIT * self.margin)[..., None, None, None, :]  # members last: torch is quickest along neighbours
        width = (self.width.exp() + SHARPEST)[..., None, None, None, :]
        x = (margin - clearances[..., None]) / width  # (*model, scene, path, near, member)
        closeness = 0.5 + 0.5 * x / torch.sqrt(1 + x * x)
        relevance = self._relevance(percept[..., : clearances.shape[-1], :])[..., None, :, :]
        threat = (relevance * closeness).amax(-2).clamp(max=1 - 1e-6)
        return (torch.log1p(-threat) + F.logsigmoid(self.clear)[..., None, None, :]).movedim(-1, -3)

    def relevance(self, percept: Float[Tensor, "*model scene thing 12"]) -> Float[Tensor, "*model member scene thing"]:
        """The chance that the user keeps away from each thing, by each member's opinion; 0 where there is none."""
        return self._relevance(percept).movedim(-1, -3)

    def _relevance(self, percept: Float[Tensor, "*model scene thing 12"]) -> Float[Tensor, "*model scene thing member"]:
        terms = self.terms((percept[..., 5:-1] - self.centre[..., None, None, :]) / self.spread[..., None, None, :])
        weight = self.weight * self.sees
        return (terms @ weight.mT.unsqueeze(-3)).sigmoid() * percept[..., -1:]

    def terms(self, x: Float[Tensor, "*thing feature"]) -> Float[Tensor, "*thing term"]:
        """What relevance is linear in, from standardised features."""
        return torch.cat([torch.ones_like(x[..., :1]), x.clamp(-self.bound, self.bound), x.tanh().square()], -1)


def log_odds(log_p: Tensor) -> Tensor:
    """Log-odds of a probability from its logarithm, at most those of 1 - 1e-6."""
    log_p = log_p.clamp(max=-1e-6)
    return log_p - torch.log(-torch.expm1(log_p))


def clearance(
    percept: Float[Tensor, "scene thing 12"], z_theta: Float[Tensor, "scene path 2"]
) -> Float[Tensor, "scene path near"]:
    """Distance [m] of each path from each thing's outline, negative inside; without slots that are empty everywhere."""
    b = basis(np.linspace(0.0, 1.0, SAMPLES))
    ends = torch.from_numpy(b[:, :1] * P_INIT + b[:, 2:] * P_F).to(z_theta)  # (sample, 2)
    lift = torch.from_numpy(b[:, 1]).to(z_theta)
    # Coordinate by coordinate: torch reduces an axis of length 2 several times slower than it adds two tensors.
    x, y = (end + lift * z[..., None] for end, z in zip(ends.unbind(-1), z_theta.unbind(-1), strict=True))
    distances = []
    for thing in percept[:, : max(1, int(percept[..., -1].sum(1).max())), :5].unbind(1):
        start_x, start_y, end_x, end_y, radius = (value[:, None, None] for value in thing.unbind(-1))
        along_x, along_y, from_x, from_y = end_x - start_x, end_y - start_y, x - start_x, y - start_y
        length = (along_x.square() + along_y.square()).clamp(min=1e-12)
        share = ((from_x * along_x + from_y * along_y) / length).clamp(0, 1)
        nearest = ((from_x - share * along_x).square() + (from_y - share * along_y).square()).amin(-1)
        distances.append(nearest.clamp(min=1e-12).sqrt() - radius[..., 0])
    return torch.stack(distances, -1)
