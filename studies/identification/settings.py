"""Parameters of the study (conf/studies/identification.yaml) and their constraints."""

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from pipeline.runtime.settings import Between, Count, Margin, SharedSplit, StudyGroup, Whole, need, need_some
from pipeline.world.symbols import SYMBOLS


def every_symbol(margins: dict[str, float | None]) -> dict[str, float | None]:
    """Return a margin for every symbol; null for symbols that are not named."""
    need_some("studies.identification.stranger", margins, SYMBOLS)
    return {symbol: margins.get(symbol) for symbol in SYMBOLS}


class Settings(StudyGroup):
    split: SharedSplit
    paths: Count
    draws: Count
    root_seed: Whole
    reported: Annotated[list[Count], Field(min_length=1)]
    stranger: Annotated[dict[str, Margin], AfterValidator(every_symbol)]
    level: Between


def agree(study: Settings, parameters: Any) -> None:
    """Require several users, a stranger that differs from all of them, and reported numbers of paths up to `paths`."""
    name, users = "studies.identification", parameters.users
    need(len(users) > 1, "users", list(users), "at least two, to tell one from the other")
    new = study.stranger not in users.values()
    need(new, f"{name}.stranger", study.stranger, "margins that no user has, or nobody can tell the stranger")
    most = f"whole numbers from 1 to {name}.paths = {study.paths}"
    need(max(study.reported) <= study.paths, f"{name}.reported", study.reported, most)
