"""A specification that sees the path: how close it comes to each thing on the table, and which things matter.

Every thing found in the picture (pipeline.spec.things) has a relevance, the chance that this user keeps away from
things that look like it, and every path a clearance from it. A path is valid if it comes too close to no thing that
matters, and to none that was not found. Whether anything matters at all has to be learned, too: until the labels say
so, a path is as likely to be valid as any other.
Turning or reflecting table and path together changes neither, so the task's symmetries hold exactly.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from scipy.special import entr
from torch import Tensor, nn

from pipeline.spec.descent import Checkpoints, Schedule, laplace, never_varies, padded, shares
from pipeline.spec.specification import Specification, to_tensor
from pipeline.spec.things import FEATURES, find
from pipeline.table.bezier import P_F, P_INIT, basis

SAMPLES = 160  # points along a path: 1 cm apart on the longest, so that a clearance is right within half a millimetre
UNIT = 0.03  # metres: a margin's unit as it is trained, so that one rate suits all parameters
SHARPEST = 0.003  # metres: a third of a pixel, no more exactly does a picture show where a thing ends
SHARPENING = 1.25  # of the log-odds of the members' mean: a mean of opinions is less sure than it is right
NEEDED = 6.0  # nats: what labels must gain in likelihood for "things matter" to be as credible as "nothing does"
CERTAIN = 1e4  # nats
SEEN = 4  # features by which each member tells things from one another
BOUND = 1.5  # standard deviations of the training things' features, beyond which a thing counts as no more unlike them
AT_ONCE = 10  # models fitted together: what they compute still fits a processor's cache
CURVE = ("step", "total")  # columns of a learning curve


class ClearanceModel(Specification):
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
        """Each thing's two ends [m], radius [m], features, and 1 if it is there."""
        things = find(images)
        parts = (
            things.ends.reshape(*things.radius.shape, 4), things.radius[..., None],
            things.features, things.present[..., None],
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


def fit(
    models: Sequence[ClearanceModel],
    images: Sequence[UInt8[Array, "scene 100 100 3"]],
    z_theta: Sequence[Float[Array, "scene _ 2"]],
    valid: Sequence[Bool[Array, "scene _"]],
    schedule: Schedule,
    seeds: Sequence[int],
    checkpoints: Checkpoints | None = None,
) -> list[Float[Array, "point 2"]]:
    """Train models of one kind in place, each on its demonstrations [m]; their learning curves (columns `CURVE`).

    Each member maximises its likelihood under weights of its own on the scenes, the Bayesian bootstrap's (Rubin, 1981).
    Demonstrations that never vary teach nothing: the model then answers Laplace's probability, whatever it sees.
    `checkpoints` keeps the weights on the way, each time with the evidence for them. All have as many scenes.
    """
    curves, lessons = [np.array([[0.0, 0.0]])] * len(models), {}
    for i, (model, pictures, z, labels) in enumerate(zip(models, images, z_theta, valid, strict=True)):
        model.rate.fill_(laplace(labels))
        if never_varies(labels):
            model.evidence.fill_(-CERTAIN)
        else:
            lessons[i] = _Lesson(model, look(model, pictures), z, labels, seeds[i])
    if lessons:
        found = _ascend(list(lessons.values()), schedule, checkpoints or Checkpoints())
        for i, curve in zip(lessons, found, strict=True):
            curves[i] = curve
    return curves


@dataclass(frozen=True)
class _Lesson:
    """What one model is fitted to."""

    model: ClearanceModel
    percept: Float[Tensor, "scene thing 12"]
    z_theta: Float[Array, "scene n 2"]
    valid: Bool[Array, "scene n"]
    seed: int


def look(model: ClearanceModel, images: UInt8[Array, "scene 100 100 3"]) -> Float[Tensor, "scene thing 12"]:
    """What stands in the training scenes; the model's features are measured against theirs from now on."""
    percept = model.perceive(to_tensor(images))
    present = percept[..., -1] > 0
    if present.sum() > 1:
        features = percept[present][:, 5:-1]
        model.centre.copy_(features.mean(0))
        model.spread.copy_(features.std(0).clamp(min=1e-3))
    return percept


@torch.no_grad()
def _weigh(lesson: _Lesson) -> None:
    """Set the evidence that things matter: what the labels gain in likelihood over one rate for every path."""
    model, valid = lesson.model, torch.tensor(lesson.valid)
    model.evidence.fill_(CERTAIN)  # what the members say by themselves
    logit = model.logit(lesson.percept, torch.tensor(lesson.z_theta).float())
    surprise = F.binary_cross_entropy_with_logits(logit, valid.float(), reduction="sum")
    rate = float(valid.float().mean())
    model.evidence.fill_(valid.numel() * (entr(rate) + entr(1 - rate)) - float(surprise) - NEEDED)


def _ascend(lessons: list[_Lesson], schedule: Schedule, checkpoints: Checkpoints) -> list[Float[Array, "point 2"]]:
    """Every model's and member's ascent of its likelihood, all at once: ten models cost what four do by themselves."""
    models, percept = [lesson.model for lesson in lessons], torch.stack([lesson.percept for lesson in lessons])
    together, n = _together(models), [lesson.valid.shape[1] for lesson in lessons]
    paths, labels = (padded(of) for of in zip(*((lesson.z_theta, lesson.valid) for lesson in lessons), strict=True))
    near = [clearance(p, torch.tensor(z).float()) for p, z in zip(percept, paths, strict=True)]
    most = max(c.shape[-1] for c in near)
    clearances = torch.stack([F.pad(c, (0, most - c.shape[-1])) for c in near])  # (model, scene, row, thing)
    valid = torch.tensor(np.stack(labels))[:, None]
    share = torch.from_numpy(shares(n).T).float()[:, None, None] * torch.stack(
        [bootstrap(lesson.model, len(lesson.valid), lesson.seed) for lesson in lessons]
    )  # (model, member, scene, row)
    optimiser, cycle = schedule.optimiser([p for p in together.parameters() if p.requires_grad])
    curve = []
    for step in range(schedule.steps):
        if step in checkpoints.steps:
            _hand_over(together, lessons)
            checkpoints.keep(step, *models)
        log_valid = together.log_valid(percept, clearances).clamp(max=-1e-6)
        surprise = -torch.where(valid, log_valid, torch.log(-torch.expm1(log_valid)))
        loss = (share * surprise).sum(-1).mean(-1)  # (model, member)
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        cycle.step()
        if step % schedule.curve_every == 0 or step == schedule.steps - 1:
            curve.append((np.full(len(models), step), loss.mean(-1).detach().numpy()))
    _hand_over(together, lessons)
    return list(np.array(curve, float).transpose(2, 0, 1))


def _together(models: list[ClearanceModel]) -> ClearanceModel:
    """One whose parameters and buffers have a first axis for the models."""
    together = copy.deepcopy(models[0])
    for name, parameter in models[0].named_parameters():
        stacked = torch.stack([model.get_parameter(name).detach() for model in models])
        setattr(together, name, nn.Parameter(stacked, requires_grad=parameter.requires_grad))
    for name, _ in models[0].named_buffers():
        setattr(together, name, torch.stack([model.get_buffer(name) for model in models]))
    return together


@torch.no_grad()
def _hand_over(together: ClearanceModel, lessons: list[_Lesson]) -> None:
    """Give every model its weights, and the evidence for them."""
    for name, parameter in together.named_parameters():
        for lesson, own in zip(lessons, parameter, strict=True):
            lesson.model.get_parameter(name).copy_(own)
    for lesson in lessons:
        _weigh(lesson)


def bootstrap(model: ClearanceModel, scenes: int, seed: int) -> Float[Tensor, "member scene 1"]:
    """How much each scene counts for each member."""
    return torch.empty(len(model.margin), scenes, 1).exponential_(generator=torch.Generator().manual_seed(seed))
