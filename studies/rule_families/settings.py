"""Parameters of the rule families study (conf/studies/rule_families.yaml) and their constraints."""

from typing import Literal

from pipeline.config.models import Schedule
from pipeline.config.settings import Settings as Parameters
from pipeline.config.values import Count, Distance, Several, Some, StudyGroup, need


class Averaged(Schedule):
    members: Count


class Settings(StudyGroup):
    """Parameters of conf/studies/rule_families.yaml."""

    scenes: Several
    families: dict[Literal["margin", "dwell", "side", "proximity"], Distance]
    variants: Some
    averaged: Averaged


def agree(study: Settings, parameters: Parameters) -> None:
    """Require the users' own family among the families, and known variants."""
    families, own = list(study.families), "margin"
    need(
        own in families, "studies.rule_families.families", families, f"{own} among them: the others are compared to it"
    )
    known = set(study.variants) <= set(parameters.variants)
    need(known, "studies.rule_families.variants", study.variants, f"some of {', '.join(parameters.variants)}")
