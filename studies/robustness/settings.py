"""Parameters of the robustness study (conf/studies/robustness.yaml) and their constraints."""

from typing import Annotated, Literal

from pydantic import AfterValidator

from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import (
    Count,
    Group,
    Several,
    Shares,
    Some,
    Strengths,
    StudyGroup,
    Whole,
    expected,
    need,
    rising,
)

SharedSplit = Annotated[
    Literal["new_scenes", "new_items"], expected("a split that all seeds share, one of new_scenes, new_items")
]


class Corruptions(Group):
    """Strengths of each corruption of images, weakest first; omitted corruptions are not studied."""

    shade: Shares | None = None
    tint: Shares | None = None
    blur: Strengths | None = None
    noise: Strengths | None = None
    arm: Shares | None = None


class Settings(StudyGroup):
    """Parameters of conf/studies/robustness.yaml."""

    root_seed: Whole
    split: SharedSplit
    scenes: Several
    corruptions: Corruptions
    textures: Some
    clutter: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    mislabelled: dict[str, Shares]


def agree(study: Settings, parameters: Parameters) -> None:
    """Require enough scenes in the split, and known variants for refitting."""
    shared, variants = parameters.scenes.shared, parameters.variants
    need(study.scenes <= shared, "studies.robustness.scenes", study.scenes, f"at most scenes.shared = {shared}")
    known = bool(study.mislabelled) and set(study.mislabelled) <= set(variants)
    refitted = list(study.mislabelled)
    need(known, "studies.robustness.mislabelled", refitted, f"some of {', '.join(variants)}")
