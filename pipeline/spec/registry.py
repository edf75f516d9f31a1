"""From a variant's settings (conf/variants) to an untrained model.

The stages that fit models name their kind themselves: a change of one kind leaves the others' results fresh.
"""

from collections.abc import Mapping
from typing import Any

from pipeline.errors import InputError
from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.reward import RewardMap
from pipeline.spec.specification import Specification, untrained
from pipeline.spec.vae import VaeSpecification

KINDS: dict[str, type[Specification]] = {"vae": VaeSpecification, "reward": RewardMap, "clearance": ClearanceModel}


def build(variant: Mapping[str, Any], seed: int = 0) -> Specification:
    """The untrained model of `variant.kind`, made of `variant.model`. Raises ValueError for an unknown kind."""
    kind = variant["kind"]
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} of variant: expected one of {', '.join(KINDS)}; see conf/variants")
    return untrained(KINDS[kind], variant["model"], seed)
