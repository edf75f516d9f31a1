"""The clearance model: a path is valid if it keeps away from every object that is relevant to the user.

Objects are detected in the image (pipeline.perception.objects), without any label of the user. Each has a relevance:
the probability that this user keeps away from objects of its appearance. Each path has a clearance [m] from each
object. A path is invalid if it comes too close to a relevant object, or to one that the detector missed. What "too
close" and "relevant" mean depends on the user's rule family (FAMILIES). Every family is an ensemble; the model averages
over families and a constant P(valid), weighted by BIC (Bayesian model averaging; Hoeting et al., 1999).

The model has the task's symmetries exactly, since rotating or reflecting scene and path together changes neither
clearance nor relevance, except that family `side` tells left from right and family `progress` start from goal.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pipeline.models.base import Images, LogOdds, Paths, Pixels, ValidityModel
from pipeline.models.curves import coordinates
from pipeline.perception.objects import FEATURES, Objects, detect_objects
from pipeline.runtime.roots import square_root
from pipeline.world.bezier import P_F, P_INIT, basis
from pipeline.world.layout import segment_distance

FAMILIES = {  # parameters of each rule family in addition to `margin`'s; BIC charges for them
    "margin": 0,  # a path is invalid within a margin of a relevant object
    "dwell": 1,  # only if it stays within the margin for longer than a share of the path
    "side": 1,  # relevance also depends on the side on which the path passes the object
    "proximity": 2,  # ... on the gap between the object and its nearest neighbour
    "progress": 2,  # ... on how far along the path the object is passed
}
GATES = ("side", "progress", "progress")  # the family that uses each relation (`Passing.relations`)
PATH_SAMPLES = 161  # points along a path: at most 2 cm apart, so that clearances above 2 cm are within 0.6 mm
MARGIN_UNIT_M = 0.03  # unit of the margin parameter [m], so that one learning rate suits all parameters
MIN_WIDTH_M = 0.003  # smallest transition width [m]: a third of a pixel, the limit of an outline's accuracy
SHARPENING = 1.25  # factor on the log-odds of the members' mean, since averaged probabilities are underconfident
EVIDENCE_PENALTY_NATS = 6.0  # log-likelihood gain [nat] at which a family is as credible as irrelevance
OCCAM_NATS = 3.0  # families this much less probable [nat] than the most probable one are left out: 20 times
FEATURES_PER_MEMBER = 4  # number of features of appearance that each member uses
FEATURE_BOUND = 1.5  # bound on standardised features [standard deviations over the training objects]
GAP_RANGE_M = 0.01, 1.0  # range of gaps between objects [m]; a missing neighbour counts as the upper end
DWELL_STRIDE = 4  # family `dwell` looks at every fourth point of the path
DWELL_SHARES = torch.arange(13) * DWELL_STRIDE / PATH_SAMPLES  # shares of the path that it can forgive: up to .3
LATERAL_SCALE_M = 0.02  # lateral distance [m] at which an object counts as fully on one side
GATE_UNIT = 3.0  # unit of the gates of `side` and `progress`, so that one learning rate suits all parameters
USUAL_OVER_LARGEST = 1.25  # usual doubt over the largest of the training pictures: a new picture may exceed it a little
UNLIMITED = 1e6  # above any doubt: that of a model that saw no pictures
Percept = Float[Tensor, "*model scene object column"]  # `PerceivedObjects`
Chosen = Sequence[int] | slice  # of a model's families


class PerceivedObjects(NamedTuple):
    """The detected objects of each scene by name; `of` unpacks a percept, `percept` packs it."""

    start: Float[Tensor, "*scene object 2"]  # of the capsule's segment [m]
    end: Float[Tensor, "*scene object 2"]  # of the capsule's segment [m]
    radius: Float[Tensor, "*scene object"]  # of the capsule [m]
    features: Float[Tensor, "*scene object feature"]  # FEATURES, kinds, and the logarithm of the gap to a neighbour [m]
    present: Float[Tensor, "*scene object"]  # 1 for an object, 0 for an empty slot
    doubt: Float[Tensor, "*scene object"]  # about the picture (perception.objects.doubt), the same in all slots

    @classmethod
    def of(cls, percept: Percept) -> "PerceivedObjects":
        """Return views of the percept's columns."""
        start, end, radius, features = percept[..., :2], percept[..., 2:4], percept[..., 4], percept[..., 5:-2]
        return cls(start, end, radius, features, percept[..., -2], percept[..., -1])

    def percept(self) -> Percept:
        """Return the percept: all fields as columns of one tensor."""
        last = torch.stack([self.present, self.doubt], -1)
        return torch.cat([self.start, self.end, self.radius[..., None], self.features, last], -1)


class Passing(NamedTuple):
    """Clearance and relations of each path to each object."""

    clearance: Float[Tensor, "*scene path near share"]  # [m]; closer for this share of the path (DWELL_SHARES)
    relations: Float[Tensor, "*scene path near 3"]  # side, 1 right to -1 left; progress, -1 to 1; its centred square


class ClearanceModel(ValidityModel):
    """An ensemble per rule family with p_valid = p_nothing_missed * (1 - max(relevance * closeness)) in each member.

    `relevance` is a logistic function of an object's features and their squares, and of the family's relation between
    object and path. Features are bounded, against extrapolation to objects unlike the training ones. Each member uses
    FEATURES_PER_MEMBER random ones (random subspaces; Ho, 1998), because several sets explain the training objects
    equally well, and all `kinds` of the objects. `closeness` falls from 1 to 0 around the member's margin, as Student's
    t distribution with 2 degrees of freedom, whose heavy tails allow for outlines that are far off. `p_nothing_missed`
    is the probability that no undetected object blocks the path.

    A family's weight is its posterior probability against a constant `rate`, by BIC (Schwarz, 1978) on FAMILIES and
    EVIDENCE_PENALTY_NATS: averaged members fit the labels less closely than the best one. Only families in Occam's
    window have weight (Madigan and Raftery, 1994): nearly as probable as the best, and at least as `margin`, the first,
    which the others extend. In a picture whose doubt exceeds `usual_doubt` the log-odds shrink (`trust`), so that
    decisions at 1/2 stay.
    """

    feature_mask: Tensor
    centre: Tensor
    spread: Tensor
    evidence: Tensor
    rate: Tensor
    usual_doubt: Tensor

    def __init__(self, members: int, families: Sequence[str] = tuple(FAMILIES), kinds: int = 0):
        super().__init__()
        self.kinds = kinds
        self.families, shape, features = tuple(families), (len(families), members), len(FEATURES) + kinds + 1
        start = 0.3 * torch.randn(members, 1 + 2 * features)  # families start alike, so that they compare fairly
        used = torch.rand(members, len(FEATURES)).argsort(-1) < FEATURES_PER_MEMBER
        gap = self.is_family("proximity")[:, None, None].expand(*shape, 1)
        seen = torch.cat([used.expand(*shape, -1), torch.ones(*shape, kinds), gap], -1)
        self.register_buffer("feature_mask", torch.cat([torch.ones(*shape, 1), seen, seen], -1))  # 1: term is used
        self.weight = nn.Parameter(start.repeat(shape[0], 1, 1))  # coefficients of relevance
        self.margin = nn.Parameter(torch.zeros(shape))  # [MARGIN_UNIT_M]; 0 is the object's outline
        self.width = nn.Parameter(torch.full(shape, float(np.log(0.01))))  # logarithm of the transition width [m]
        self.logit_nothing_missed = nn.Parameter(torch.full(shape, 4.0))  # log-odds of p_nothing_missed
        self.forgiven = nn.Parameter(torch.full(shape, -1.5))  # log-odds of the share that `dwell` forgives
        self.gates = nn.Parameter(torch.zeros(*shape, len(GATES)))  # coefficients of relations [GATE_UNIT]
        self.register_buffer("centre", torch.zeros(features))  # mean of the training objects' features
        self.register_buffer("spread", torch.ones(features))  # their standard deviation
        self.register_buffer("evidence", torch.full(shape[:1], -EVIDENCE_PENALTY_NATS))  # log-odds against `rate`
        self.register_buffer("usual_doubt", torch.tensor(UNLIMITED))  # largest that leaves answers as they are
        self.register_buffer("rate", torch.tensor(0.5))  # P(valid) if no object is relevant

    def is_family(self, name: str) -> Bool[Tensor, " family"]:
        """Return which of the model's families has that name."""
        return torch.tensor([family == name for family in self.families])

    def perceive(self, images: Pixels) -> Percept:
        """Return the detected objects (`PerceivedObjects`)."""
        return pack(**vars(detect_objects(images, looks=self.kinds > 0)))

    def see(self, scenes: Images | Objects) -> Percept:
        """Return the objects that are detected in pictures, or those that somebody told."""
        return pack(**vars(scenes)) if isinstance(scenes, Objects) else super().see(scenes)

    def logit(self, percept: Percept, z_theta: Paths) -> LogOdds:
        """Return the log-odds of validity of each path, times `trust`; differentiable in `z_theta` [m]."""
        *posterior, p_constant = self.posterior().unbind()
        kept = [i for i, p in enumerate(posterior) if p > 0]
        log_p = [(p_constant * self.rate).log().expand(z_theta.shape[:2])]
        if kept:
            passing = passes(percept, z_theta, dwell="dwell" in (self.families[i] for i in kept))
            by_family = F.logsigmoid(self.logit_by_family(percept, passing, kept))
            log_p += [posterior[i].log() + log_p_family for i, log_p_family in zip(kept, by_family, strict=True)]
        return log_odds(torch.stack(log_p).logsumexp(0)) * self.trust(percept)[:, None]

    def trust(self, percept: Percept) -> Float[Tensor, " scene"]:
        """Return the factor on the log-odds, in (0, 1]: 1 up to the usual doubt, then (usual / doubt)^2."""
        doubt = PerceivedObjects.of(percept).doubt[:, 0]
        return (self.usual_doubt / torch.maximum(doubt, self.usual_doubt)).square()

    def posterior(self) -> Float[Tensor, " family_or_constant"]:
        """Return the posterior probability of each family and, last, of the constant; 0 outside Occam's window."""
        least = torch.maximum(self.evidence[0], self.evidence.max() - OCCAM_NATS)
        return F.pad(self.evidence.masked_fill(self.evidence < least, -np.inf), (0, 1)).softmax(0)

    def logit_by_family(
        self, percept: Tensor, passing: Passing, chosen: Chosen = slice(None)
    ) -> Float[Tensor, "family scene path"]:
        """Return the log-odds of validity under each chosen family: of its members' mean, times SHARPENING."""
        members = self.margin.shape[-1]
        log_p = self.log_valid(percept, passing, chosen).unflatten(0, (-1, members))
        return SHARPENING * log_odds(log_p.logsumexp(1) - float(np.log(members)))

    def log_valid(
        self, percept: Percept, passing: Passing, chosen: Chosen = slice(None)
    ) -> Float[Tensor, "*model member scene path"]:
        """Return log p_valid by the chosen families' members, given how paths pass the objects in the first slots."""

        def of_members(parameter: Tensor) -> Tensor:
            """Return (*model, 1, 1, 1, member): members last, for fastest access."""
            return parameter[..., chosen, :].flatten(-2)[..., None, None, None, :]

        near, shares = passing.clearance.shape[-2:]
        forgiven = DWELL_SHARES[-1] * self.forgiven.sigmoid() * self.is_family("dwell")[:, None]
        from_share = (of_members(forgiven)[..., 0, 0, :, :] - DWELL_SHARES[:shares, None]).abs() / DWELL_SHARES[1]
        clearance = torch.einsum("...abns,...sm->...abnm", passing.clearance, F.relu(1 - from_share))  # interpolated
        used = torch.stack([self.is_family(family) for family in GATES], -1)[:, None]  # (family, 1, relation)
        gates = (GATE_UNIT * self.gates * used)[..., chosen, :, :].flatten(-3, -2)  # (*model, member, relation)
        gate = torch.einsum("...abnr,...mr->...abnm", passing.relations, gates)
        relevance = (self.logit_relevance(percept[..., :near, :], chosen)[..., None, :, :] + gate).sigmoid()
        relevance = relevance * PerceivedObjects.of(percept[..., :near, :]).present[..., None, :, None]
        x = (MARGIN_UNIT_M * of_members(self.margin) - clearance) * of_members(1 / (self.width.exp() + MIN_WIDTH_M))
        closeness = 0.5 + 0.5 * x * torch.rsqrt(1 + x * x)
        # p_valid = p_nothing_missed * (1 - max(relevance * closeness)), as logarithms
        threat = (relevance * closeness).amax(-2).clamp(max=1 - 1e-6)  # (*model, scene, path, member)
        return (torch.log1p(-threat) + F.logsigmoid(of_members(self.logit_nothing_missed)[..., 0, :])).movedim(-1, -3)

    def logit_relevance(
        self, percept: Percept, chosen: Chosen = slice(None)
    ) -> Float[Tensor, "*model scene object member"]:
        """Return each member's log-odds that the user keeps away from each object, by its features alone."""
        features = PerceivedObjects.of(percept).features
        features = (features - self.centre[..., None, None, :]) / self.spread[..., None, None, :]
        bounded = features.clamp(-FEATURE_BOUND, FEATURE_BOUND)
        terms = torch.cat([torch.ones_like(features[..., :1]), bounded, features.tanh().square()], -1)
        weight = (self.weight * self.feature_mask)[..., chosen, :, :].flatten(-3, -2)
        return terms @ weight.mT.unsqueeze(-3)


def log_odds(log_p: Tensor) -> Tensor:
    """Return the log-odds of a probability given as its logarithm; probabilities are capped at 1 - 1e-6."""
    log_p = log_p.clamp(max=-1e-6)
    return log_p - torch.log(-torch.expm1(log_p))


def pack(ends, radius, features, present, doubt, kinds) -> Percept:
    """Return the fields of `Objects` as a percept, with the gap [m] to each object's neighbour as last feature."""
    apart = segment_distance(ends[:, :, None].astype(float), ends[:, None].astype(float))
    size, seen = torch.from_numpy(radius), torch.from_numpy(present)
    gap = torch.from_numpy(apart).to(size) - size[:, :, None] - size[:, None, :]
    other = seen[:, :, None] & seen[:, None] & ~torch.eye(seen.shape[1], dtype=torch.bool)
    log_gap = torch.where(other, gap, GAP_RANGE_M[1]).amin(-1).clamp(*GAP_RANGE_M).log()
    start, end = torch.from_numpy(ends).unbind(-2)
    doubts = torch.from_numpy(doubt)[:, None].expand(seen.shape).to(size)
    all_features = torch.cat([torch.from_numpy(features), torch.from_numpy(kinds), log_gap[..., None]], -1)
    return PerceivedObjects(start, end, size, all_features, seen.float(), doubts).percept()


def passes(percept: Percept, z_theta: Paths, dwell: bool = True) -> Passing:
    """Return how each path [m] passes each object; unless `dwell`, only share 0 of clearances, the least one.

    Shares of the path and progress along it are of the parameter for z_theta, of the length for other curves.

    Leaves out slots that are empty in every scene.
    """
    x, y = _sampled(z_theta)
    occupied = max(1, int(PerceivedObjects.of(percept).present.sum(1).max()))  # detections fill slots from the first
    objects = PerceivedObjects.of(percept[:, :occupied])
    distances, samples = [], []
    for start, end in zip(objects.start.unbind(1), objects.end.unbind(1), strict=True):
        start_x, start_y = (c[:, None, None] for c in start.unbind(-1))
        end_x, end_y = (c[:, None, None] for c in end.unbind(-1))
        along_x, along_y, from_x, from_y = end_x - start_x, end_y - start_y, x - start_x, y - start_y
        length = (along_x.square() + along_y.square()).clamp(min=1e-12)
        share = ((from_x * along_x + from_y * along_y) / length).clamp(0, 1)
        squared = (from_x - share * along_x).square() + (from_y - share * along_y).square()
        nearest, sample = squared.min(-1, keepdim=True)
        if dwell:
            ascending = squared[..., ::DWELL_STRIDE].topk(len(DWELL_SHARES), largest=False).values
            nearest = torch.cat([nearest, ascending[..., 1:]], -1)
        distances.append(nearest)
        samples.append(sample[..., 0])
    clearance = square_root(torch.stack(distances, 2).clamp(min=1e-12)) - objects.radius[:, None, :, None]
    sample = torch.stack(samples, 2)  # where it passes: (scene, path, near)
    t, middle = sample.to(z_theta)[..., None] / (PATH_SAMPLES - 1), ((objects.start + objects.end) / 2)[:, None]
    if z_theta.ndim == 3:
        z, start, goal = z_theta[:, :, None], *(torch.from_numpy(p).to(z_theta) for p in (P_INIT, P_F))
        point = (1 - t).square() * start + 2 * t * (1 - t) * z + t.square() * goal  # (scene, path, near, 2)
        heading = (1 - t) * (z - start) + t * (goal - z)
    else:
        before, here, after = (
            torch.stack([c.gather(2, (sample + k).clamp(0, PATH_SAMPLES - 1)) for c in (x, y)], -1) for k in (-1, 0, 1)
        )
        point, heading = here, after - before
    towards = middle - point
    lateral = heading[..., 1] * towards[..., 0] - heading[..., 0] * towards[..., 1]
    side = (lateral / square_root(heading.square().sum(-1) + 1e-12) / LATERAL_SCALE_M).tanh()
    progress = 2 * t[..., 0] - 1
    return Passing(clearance, torch.stack([side, progress, progress.square() - 1 / 3], -1))


def _sampled(paths: Paths) -> tuple[Float[Tensor, "scene path sample"], Float[Tensor, "scene path sample"]]:
    """Return x and y of PATH_SAMPLES points on each path.

    One coordinate at a time: torch reduces an axis of length 2 several times slower than it adds two tensors.
    """
    if paths.ndim == 4:
        return coordinates(paths, PATH_SAMPLES)
    b = basis(np.linspace(0.0, 1.0, PATH_SAMPLES))
    fixed = torch.from_numpy(b[:, :1] * P_INIT + b[:, 2:] * P_F).to(paths)  # (sample, 2)
    lift = torch.from_numpy(b[:, 1]).to(paths)
    x, y = (c + lift * z[..., None] for c, z in zip(fixed.unbind(-1), paths.unbind(-1), strict=True))
    return x, y
