"""Parameters of the study (conf/studies/counterfactuals.yaml) and their constraints."""

from typing import Annotated

from pydantic import Field

from pipeline.config import settings as parameters_of_all
from pipeline.config.stages import SharedSplit
from pipeline.config.values import Count, Several, StudyGroup, Whole, expected, need


class Settings(StudyGroup):
    """Parameters of conf/studies/counterfactuals.yaml, which explains each value."""

    split: SharedSplit
    scenes: Several
    paths: Count
    moved_scenes: Several
    move_step: Annotated[float, Field(gt=0, le=0.1), expected("a length above 0 up to 0.1 [m]")]
    move_steps: Count
    example_variant: str
    root_seed: Whole


def agree(study: Settings, parameters: parameters_of_all.Settings) -> None:
    """Require a user with a margin, a known example variant, and enough scenes."""
    name, shared = "studies.counterfactuals", parameters.scenes.shared
    margins = {user: dict(by_symbol) for user, by_symbol in parameters.users.items()}
    has_margin = any(m is not None for by_symbol in margins.values() for m in by_symbol.values())
    need(has_margin, "users", margins, "at least one user with a margin, or no path is invalid")
    need(study.scenes <= shared, f"{name}.scenes", study.scenes, f"at most scenes.shared = {shared}")
    at_most = f"at most {name}.scenes = {study.scenes}"
    need(study.moved_scenes <= study.scenes, f"{name}.moved_scenes", study.moved_scenes, at_most)
    known = f"one of {', '.join(parameters.variants)}"
    need(study.example_variant in parameters.variants, f"{name}.example_variant", study.example_variant, known)
