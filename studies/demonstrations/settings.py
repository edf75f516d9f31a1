"""Parameters of the demonstrations study (conf/studies/demonstrations.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator

from pipeline.runtime.settings import Several, StudyGroup, Whole, expected, need, need_some, rising


class Settings(StudyGroup):
    clear_cm: Annotated[list[Whole], AfterValidator(rising), expected("ascending whole numbers from 0 [cm]")]
    seeds: dict[str, Several]


def agree(study: Settings, parameters: Any) -> None:
    """Require known variants, the paper's model among them."""
    name = "studies.demonstrations"
    need_some(f"{name}.seeds", study.seeds, parameters.variants)
    need("full" in study.seeds, f"{name}.seeds", list(study.seeds), "full among them: the study is about it")
