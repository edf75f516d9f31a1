"""Parameters of the refutation study (conf/studies/refutation.yaml) and their constraints."""

from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, Length, Names, Several, StudyGroup, Whole, expected, need, rising
from pipeline.world.layout import SIDE


class Settings(StudyGroup):
    """Parameters of conf/studies/refutation.yaml."""

    root_seed: Whole
    scenes: Annotated[int, Field(ge=4), expected("a whole number from 4: data_subset halves the scenes")]
    dummy_outcome: Names
    pieces: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    far_m: Length
    textures: str
    halves: Several


def agree(study: Settings, parameters: Parameters) -> None:
    """Require `far_m` beyond every margin, pieces that tile an image, and one placement per scene."""
    variants = parameters.variants
    known = set(study.dummy_outcome) <= set(variants)
    some = f"some of {', '.join(variants)}"
    need(known, "studies.refutation.dummy_outcome", study.dummy_outcome, some)
    tiles = all(SIDE % piece == 0 for piece in study.pieces)
    need(tiles, "studies.refutation.pieces", study.pieces, f"numbers that divide {SIDE}, an image's side [px]")
    widest = max((m for margins in parameters.users.values() for m in margins.values() if m is not None), default=0.0)
    beyond = f"more than the widest margin in users, {widest} m"
    need(study.far_m > widest, "studies.refutation.far_m", study.far_m, beyond)
