"""Parameters of the confounding study (conf/studies/confounding.yaml) and their constraints."""

from typing import Any

from pipeline.runtime.settings import (
    Chance,
    Count,
    Length,
    Name,
    Names,
    Pair,
    Several,
    Share,
    Some,
    StudyGroup,
    Whole,
    need,
    need_some,
)
from studies.confounding.world import CONFOUNDED, CONTROL

STUDY = "studies.confounding"


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Several
    worlds: dict[Name, Chance]
    gap_m: Pair
    present: Share
    glasses: Count
    near_m: Length
    users: Some
    variants: dict[str, Names]
    examples: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require both worlds, room for their items, and known users and variants."""
    layout, (low, high), worlds = parameters.scenes.layout, study.gap_m, list(study.worlds)
    both = f"{CONFOUNDED} and {CONTROL} among them"
    need({CONFOUNDED, CONTROL} <= set(worlds), f"{STUDY}.worlds", worlds, both)
    p_common_cause = study.worlds[CONTROL]
    need(p_common_cause == 0, f"{STUDY}.worlds.{CONTROL}", p_common_cause, "0, no common cause")
    lengths = f"two lengths from scenes.layout.clear_of_items = {layout.clear_of_items} on, the smaller first [m]"
    need(layout.clear_of_items <= low <= high, f"{STUDY}.gap_m", study.gap_m, lengths)
    room = layout.slots - max(layout.items_per_scene) + 1
    need(study.glasses <= room, f"{STUDY}.glasses", study.glasses, f"a whole number from 1 to {room} (layout.slots)")
    need_some(f"{STUDY}.users", study.users, parameters.users)
    need_some(f"{STUDY}.variants", study.variants, parameters.variants)
    for name, fitted_in in study.variants.items():
        holds = CONFOUNDED in fitted_in and set(fitted_in) <= set(worlds)
        need(holds, f"{STUDY}.variants.{name}", fitted_in, f"{CONFOUNDED} and others of {', '.join(worlds)}")
