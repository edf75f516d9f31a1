"""Parameters of the study (conf/studies/envelope.yaml) and their constraints."""

from typing import Any

from pipeline.runtime.settings import Count, Length, Several, StudyGroup, Whole, need, need_one, widest_margin


class Settings(StudyGroup):
    planner: str
    step: Length
    doses: Several
    clear_of_others: Length
    paths: Count
    candidates: Count
    starts: Count
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Require a known planner, and a distance to other items beyond every user's margin."""
    name = "studies.envelope"
    need_one(f"{name}.planner", study.planner, parameters.variants)
    widest = widest_margin(parameters.users) or 0.0
    above = f"more than the widest margin in users, {widest} m"
    need(study.clear_of_others > widest, f"{name}.clear_of_others", study.clear_of_others, above)
