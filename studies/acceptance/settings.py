"""Parameters of the study (conf/studies/acceptance.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator

from pipeline.runtime.settings import Between, Count, Some, StudyGroup, Whole, expected, need, need_some, rising


class Settings(StudyGroup):
    variants: Some
    level: Between
    levels: Annotated[list[Between], AfterValidator(rising), expected("ascending numbers between 0 and 1")]
    fitted: Count
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require known variants, `level` among `levels`, and scenes left for calibration."""
    name, per_seed = "studies.acceptance", parameters.scenes.per_seed
    need_some(f"{name}.variants", study.variants, parameters.variants)
    need(study.level in study.levels, f"{name}.levels", study.levels, f"{name}.level = {study.level} among them")
    most = f"a whole number from 1 to scenes.per_seed - 1 = {per_seed - 1}"
    need(study.fitted < per_seed, f"{name}.fitted", study.fitted, most)
