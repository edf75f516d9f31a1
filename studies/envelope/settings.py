"""Parameters of the study (conf/studies/envelope.yaml), and what they must agree with."""

from pipeline.config import settings as parameters_of_all
from pipeline.config.values import Count, Group, Length, Several, Whole, need


class Settings(Group):
    """See conf/studies/envelope.yaml for what each value is."""

    planner: str
    step: Length
    doses: Several
    clear_of_others: Length
    paths: Count
    candidates: Count
    starts: Count
    root_seed: Whole


def agree(study: Settings, parameters: parameters_of_all.Settings) -> None:
    """Require a known planner, and paths farther from other items than any user asks."""
    name = "studies.envelope"
    known = f"one of {', '.join(parameters.variants)}"
    need(study.planner in parameters.variants, f"{name}.planner", study.planner, known)
    margins = [m for by_symbol in parameters.users.values() for m in by_symbol.values() if m is not None]
    widest = max(margins, default=0.0)
    above = f"more than the widest margin in users, {widest} m"
    need(study.clear_of_others > widest, f"{name}.clear_of_others", study.clear_of_others, above)
