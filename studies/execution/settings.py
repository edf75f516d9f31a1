"""Parameters of the execution study (conf/studies/execution.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from pipeline.runtime.settings import (
    Count,
    Group,
    Length,
    Several,
    StudyGroup,
    Whole,
    expected,
    need,
    need_one,
    need_some,
    rising,
)
from pipeline.world.symbols import SYMBOLS

Numbers = Annotated[list[float], Field(min_length=1)]
Offset = Annotated[list[float], Field(min_length=3, max_length=3), expected("three lengths [m]")]
Sizes = Annotated[list[Length], AfterValidator(rising), expected("lengths above 0, the smallest first [m]")]


class ArmSettings(Group):
    """Settings of one arm: its description, how it holds, and where it may stand."""

    file: str
    tool: str
    offset_m: Offset
    pitch_deg: float
    still: dict[str, float]
    posture: dict[str, float]
    height_m: float
    turn_deg: float
    side_m: Sizes
    base_x: Numbers
    base_y_m: Numbers


class Carried(Group):
    """The shaker."""

    radius_m: Length
    below_m: Length
    above_m: Length


class SolidSettings(Group):
    """An item's height and mass at full size."""

    height_m: Length
    mass_kg: Length


class Settings(StudyGroup):
    arms: dict[str, ArmSettings]
    grip_m: Length
    shaker: Carried
    solids: dict[str, SolidSettings]
    coarse: Several
    lattice: Several
    instants: Several
    error_m: Length
    tilt_rad: Length
    physics_arm: str
    physics_starts: Count
    physics: dict[str, list[str]]
    fallen_rad: Length
    moved_m: Length
    shown_scene: Whole
    exported: Count
    chunk: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require a solid for every symbol, known variants, starts that exist, and a grip above every item."""
    name = "studies.execution"
    need(
        set(study.solids) == set(SYMBOLS),
        f"{name}.solids",
        sorted(study.solids),
        f"one of each of {', '.join(SYMBOLS)}",
    )
    need_one(f"{name}.physics_arm", study.physics_arm, study.arms)
    need_some(f"{name}.physics", study.physics, ["gradient", "nearest"])
    for method, variants in study.physics.items():
        need_some(f"{name}.physics.{method}", variants, parameters.variants)
    most = f"at most repair.starts = {parameters.repair.starts}"
    need(study.physics_starts <= parameters.repair.starts, f"{name}.physics_starts", study.physics_starts, most)
    most = f"less than scenes.shared = {parameters.scenes.shared}"
    need(study.shown_scene < parameters.scenes.shared, f"{name}.shown_scene", study.shown_scene, most)
    lower = study.grip_m - study.shaker.below_m
    need(lower > 0, f"{name}.shaker.below_m", study.shaker.below_m, f"less than {name}.grip_m = {study.grip_m}")
