"""The path model with one ingredient taken away at a time: what each of them is worth."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch

from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.things import FEATURES

FIRST = 5  # column of a percept's first feature; the two ends and the radius stand before
SHAPE = ("area", "elongation", "length", "width")
SURE = 14.0  # log-odds of what is as good as certain


class _NoSharpening(ClearanceModel):
    """The members' mean is not sharpened."""

    sharpening = 1.0


class _NoEvidence(ClearanceModel):
    """The members are believed, however little the labels bear them out."""

    def logit(self, percept, z_theta):
        return self.of_things(percept, z_theta)


class _NoSquares(ClearanceModel):
    """Relevance is monotonic in every feature."""

    def terms(self, x):
        return super().terms(x)[..., : 1 + len(FEATURES)]

    def __init__(self, members: int):
        super().__init__(members)
        self.weight = torch.nn.Parameter(self.weight[:, : 1 + len(FEATURES)].detach())
        self.sees = self.sees[:, : 1 + len(FEATURES)]


class _EveryFeature(ClearanceModel):
    """Every member sees every feature."""

    def __init__(self, members: int):
        super().__init__(members)
        self.sees.fill_(1.0)


class _Unbounded(ClearanceModel):
    """Relevance goes on beyond what the training things look like."""

    bound = float("inf")


class _Without(ClearanceModel):
    """Things look alike in the features that are `missing`."""

    missing: tuple[str, ...] = ()

    def perceive(self, images):
        percept = super().perceive(images)
        percept[..., [FIRST + FEATURES.index(name) for name in self.missing]] = 0
        return percept


class _NoShape(_Without):
    missing = SHAPE


class _NoContrast(_Without):
    missing = tuple(name for name in FEATURES if name not in SHAPE)


class _Discs(ClearanceModel):
    """A thing is a disc of its area, however long it is."""

    def perceive(self, images):
        percept = super().perceive(images)
        start, end, radius = percept[..., :2], percept[..., 2:4], percept[..., 4]
        area = torch.pi * radius**2 + 2 * radius * (end - start).norm(dim=-1)
        middle = (start + end) / 2
        percept[..., :4], percept[..., 4] = torch.cat([middle, middle], -1), (area / torch.pi).sqrt()
        return percept


class _NoMargin(ClearanceModel):
    """Things' outlines are where paths become invalid."""

    def __init__(self, members: int):
        super().__init__(members)
        self.margin.requires_grad_(False)


class _NothingUnseen(ClearanceModel):
    """Nothing stands in the way that was not found."""

    def __init__(self, members: int):
        super().__init__(members)
        self.clear.data.fill_(SURE)
        self.clear.requires_grad_(False)


@dataclass(frozen=True)
class Ablation:
    """Another class, or other settings of the model (conf/variants/path)."""

    kind: type[ClearanceModel] = ClearanceModel
    model: Mapping[str, int] = field(default_factory=dict)


ABLATIONS = {
    "whole": Ablation(),
    "no_shape": Ablation(_NoShape),
    "no_contrast": Ablation(_NoContrast),
    "no_squares": Ablation(_NoSquares),
    "every_feature": Ablation(_EveryFeature),
    "unbounded": Ablation(_Unbounded),
    "discs": Ablation(_Discs),
    "no_margin": Ablation(_NoMargin),
    "nothing_unseen": Ablation(_NothingUnseen),
    "one_member": Ablation(model={"members": 1}),
    "no_sharpening": Ablation(_NoSharpening),
    "no_evidence": Ablation(_NoEvidence),
}
