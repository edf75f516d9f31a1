"""Stage execution: the PR2's right arm carries out the repaired paths, joint by joint and in a simulation of physics.

What needs the extra `robot` stands in studies/execution/pr2.py, so that settings are read without it.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from omegaconf import DictConfig
from pydantic import AfterValidator, Field

from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Count, Group, Length, Several, StudyGroup, Whole, need, need_some, rising
from pipeline.world.layout import SYMBOLS

Numbers = Annotated[list[float], Field(min_length=1)]


class Shaker(Group):
    radius_m: Length
    below_m: Length
    above_m: Length


class Settings(StudyGroup):
    still: dict[str, float]
    posture: dict[str, float]
    height_m: float
    side_m: Annotated[list[Length], AfterValidator(rising)]
    base_x: Numbers
    base_y_m: Numbers
    grip_m: Length
    shaker: Shaker
    item_heights_m: dict[str, Length]
    item_masses_kg: dict[str, Length]
    coarse: Several
    lattice: Several
    instants: Several
    error_m: Length
    tilt_rad: Length
    physics_starts: Count
    physics: Annotated[dict[Literal["gradient", "nearest"], list[str]], Field(min_length=1)]
    fallen_rad: Length
    shown_scene: Whole
    exported: Count
    chunk: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require sizes for every symbol, known variants, starts that exist, and a shaker above the table."""
    name, starts, scenes = "studies.execution", parameters.repair.starts, parameters.scenes.shared
    for part, sizes in (("item_heights_m", study.item_heights_m), ("item_masses_kg", study.item_masses_kg)):
        need(set(sizes) == set(SYMBOLS), f"{name}.{part}", sorted(sizes), f"one of each of {', '.join(SYMBOLS)}")
    for method, variants in study.physics.items():
        need_some(f"{name}.physics.{method}", variants, parameters.variants)
    most = f"at most repair.starts = {starts}"
    need(study.physics_starts <= starts, f"{name}.physics_starts", study.physics_starts, most)
    need(study.shown_scene < scenes, f"{name}.shown_scene", study.shown_scene, f"less than scenes.shared = {scenes}")
    below = study.shaker.below_m
    need(below < study.grip_m, f"{name}.shaker.below_m", below, f"less than {name}.grip_m = {study.grip_m}")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write what `carry_out` does. Raise InputError if a package of the extra `robot` is missing."""
    try:
        from studies.execution.pr2 import carry_out
    except ModuleNotFoundError as error:
        raise InputError(f"the robot needs {error.name}: run `pip install .[robot]`") from error
    carry_out(cfg, out_dir)


if __name__ == "__main__":
    launch(main, "execution")
