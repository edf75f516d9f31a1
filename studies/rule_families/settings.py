"""Parameters of the rule families study (conf/studies/rule_families.yaml) and their constraints."""

from typing import Any, Literal

from pipeline.runtime.settings import Distance, Several, Some, StudyGroup, need, need_some


class Settings(StudyGroup):
    scenes: Several
    families: dict[Literal["margin", "dwell", "side", "proximity"], Distance]
    variants: Some


def agree(study: Settings, parameters: Any) -> None:
    """Require the users' own family among the families, and known variants, the clearance model among them."""
    families = list(study.families)
    among = "margin among them: the others are compared to it"
    need("margin" in families, "studies.rule_families.families", families, among)
    need_some("studies.rule_families.variants", study.variants, parameters.variants)
    need("clearance" in study.variants, "studies.rule_families.variants", study.variants, "clearance among them")
