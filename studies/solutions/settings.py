"""Parameters of the study (conf/studies/solutions.yaml) and their constraints."""

from typing import Any

from pipeline.runtime.settings import Count, SharedSplit, Some, StudyGroup, Whole, need, need_some


class Settings(StudyGroup):
    variants: Some
    split: SharedSplit
    root_seed: Whole
    neighbours: Count
    permutations: Count
    candidates: Count
    draws: Count


def agree(study: Settings, parameters: Any) -> None:
    """Require known variants, several users, and more candidates than draws."""
    name, users = "studies.solutions", parameters.users
    need_some(f"{name}.variants", study.variants, parameters.variants)
    need(len(users) > 1, "users", list(users), "at least two, or there is nothing to compare")
    most = f"at most {name}.candidates = {study.candidates}"
    need(study.draws <= study.candidates, f"{name}.draws", study.draws, most)
