"""Parameters of the study (conf/studies/counterfactuals.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import Field

from pipeline.runtime.settings import (
    Count,
    Several,
    SharedSplit,
    StudyGroup,
    Whole,
    expected,
    need,
    need_one,
    widest_margin,
)


class Settings(StudyGroup):
    split: SharedSplit
    scenes: Several
    paths: Count
    moved_scenes: Several
    move_step: Annotated[float, Field(gt=0, le=0.1), expected("a length above 0 up to 0.1 [m]")]
    move_steps: Count
    example_variant: str
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require a user with a margin, a known example variant, and enough scenes."""
    name, shared = "studies.counterfactuals", parameters.scenes.shared
    users = parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")
    at_most = f"at most {name}.scenes = {study.scenes}"
    need(study.moved_scenes <= study.scenes, f"{name}.moved_scenes", study.moved_scenes, at_most)
    need_one(f"{name}.example_variant", study.example_variant, parameters.variants)
