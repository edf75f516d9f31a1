"""Parameters of the refutation study (conf/studies/refutation.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from pipeline.runtime.settings import (
    Count,
    Length,
    Names,
    Several,
    StudyGroup,
    Whole,
    expected,
    need,
    need_some,
    rising,
    widest_margin,
)
from pipeline.world.layout import SIDE


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Annotated[int, Field(ge=4), expected("a whole number from 4: data_subset halves the scenes")]
    dummy_outcome: Names
    pieces: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    far_m: Length
    textures: str
    halves: Several


def agree(study: Settings, parameters: Any) -> None:
    """Require `far_m` beyond every margin, pieces that tile an image, and one placement per scene."""
    need_some("studies.refutation.dummy_outcome", study.dummy_outcome, parameters.variants, or_none=True)
    tiles = all(SIDE % piece == 0 for piece in study.pieces)
    need(tiles, "studies.refutation.pieces", study.pieces, f"numbers that divide {SIDE}, an image's side [px]")
    widest = widest_margin(parameters.users) or 0.0
    beyond = f"more than the widest margin in users, {widest} m"
    need(study.far_m > widest, "studies.refutation.far_m", study.far_m, beyond)
