"""Parameters of the demonstrations study (conf/studies/demonstrations.yaml) and their constraints."""

from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.config.checks import need, need_some
from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, Length, Several, StudyGroup, Whole, expected, rising

ControlPoint = Annotated[list[float], Field(min_length=2, max_length=2), expected("two numbers [m]")]


class Settings(StudyGroup):
    root_seed: Whole
    clear_cm: Annotated[list[Whole], AfterValidator(rising), expected("ascending whole numbers from 0 [cm]")]
    families: Annotated[list[ControlPoint], Field(min_length=1)]
    family_radius: Length
    candidates: Count
    held_out: Count
    seeds: dict[str, Several]


def agree(study: Settings, parameters: Parameters) -> None:
    """Require known variants, the paper's model among them, and enough candidates."""
    name, paths = "studies.demonstrations", parameters.main_n_demos + study.held_out
    need_some(f"{name}.seeds", study.seeds, parameters.variants)
    need("full" in study.seeds, f"{name}.seeds", list(study.seeds), "full among them: the study is about it")
    most = f"at least main_n_demos + held_out = {paths}"
    need(study.candidates >= paths, f"{name}.candidates", study.candidates, most)
