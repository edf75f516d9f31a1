"""Build untrained models from a variant's settings (conf/variants).

The stages that fit models import their class directly, so that a change to one class does not invalidate other stages.
"""

from collections.abc import Mapping
from typing import Any

from pipeline.models.base import ValidityModel, untrained
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.irl.reward_map import RewardMap
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.runtime.errors import InputError

KINDS: dict[str, type[ValidityModel]] = {"vae": BetaVae, "reward": RewardMap, "clearance": ClearanceModel}


def build(variant: Mapping[str, Any], seed: int = 0) -> ValidityModel:
    """Return the untrained model of `variant.kind` and shape `variant.model`; raise InputError for other kinds."""
    kind = variant["kind"]
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} of variant: expected one of {', '.join(KINDS)}; see conf/variants")
    return untrained(KINDS[kind], variant["model"], seed)
