"""From a variant's settings (conf/variants) to an untrained model."""

from collections.abc import Mapping
from typing import Any

import torch

from pipeline.spec.reward import RewardMap
from pipeline.spec.specification import Specification
from pipeline.spec.vae import VaeSpecification

KINDS = ("vae", "reward")


def build(variant: Mapping[str, Any], seed: int = 0) -> Specification:
    """The model of `variant.kind`, made of `variant.model`, its weights drawn from `seed` alone.

    In eval mode; torch's global generator is left as it was. Raises ValueError for an unknown kind.
    """
    shape = dict(variant.get("model") or {})
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        match variant["kind"]:
            case "vae":
                return VaeSpecification(**shape).eval()
            case "reward":
                return RewardMap(**shape).eval()
            case kind:
                raise ValueError(f"kind {kind!r} of variant: expected one of {', '.join(KINDS)}; see conf/variants")
