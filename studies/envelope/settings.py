"""Parameters of the study (conf/studies/envelope.yaml) and their constraints."""

from pipeline.config import settings as parameters_of_all
from pipeline.config.values import Count, Length, Several, StudyGroup, Whole, need


class Settings(StudyGroup):
    """Parameters of conf/studies/envelope.yaml, which explains each value."""

    planner: str
    step: Length
    doses: Several
    clear_of_others: Length
    paths: Count
    candidates: Count
    starts: Count
    root_seed: Whole


def agree(study: Settings, parameters: parameters_of_all.Settings) -> None:
    """Require a known planner, and a distance to other items beyond every user's margin."""
    name = "studies.envelope"
    known = f"one of {', '.join(parameters.variants)}"
    need(study.planner in parameters.variants, f"{name}.planner", study.planner, known)
    margins = [m for by_symbol in parameters.users.values() for m in by_symbol.values() if m is not None]
    widest = max(margins, default=0.0)
    above = f"more than the widest margin in users, {widest} m"
    need(study.clear_of_others > widest, f"{name}.clear_of_others", study.clear_of_others, above)
