"""Parameters of the robustness study (conf/studies/robustness.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator

from pipeline.runtime.settings import (
    Count,
    Group,
    Several,
    SharedSplit,
    Shares,
    Some,
    Strengths,
    StudyGroup,
    Whole,
    expected,
    need,
    need_some,
    rising,
)


class Corruptions(Group):
    """Strengths of each corruption of images, weakest first; omitted corruptions are not studied."""

    shade: Shares | None = None
    tint: Shares | None = None
    blur: Strengths | None = None
    noise: Strengths | None = None
    arm: Shares | None = None


class Settings(StudyGroup):
    root_seed: Whole
    split: SharedSplit
    scenes: Several
    corruptions: Corruptions
    textures: Some
    clutter: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    mislabelled: dict[str, Shares]


def agree(study: Settings, parameters: Any) -> None:
    """Require enough scenes in the split, and known variants for refitting."""
    shared = parameters.scenes.shared
    need(study.scenes <= shared, "studies.robustness.scenes", study.scenes, f"at most scenes.shared = {shared}")
    need_some("studies.robustness.mislabelled", study.mislabelled, parameters.variants)
