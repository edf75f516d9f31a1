"""Choose how a variant is fitted: by the trainer of its stage."""

from collections.abc import Mapping
from typing import Any

from pipeline.training.clearance import fit as clearance
from pipeline.training.irl import fit as irl
from pipeline.training.loop import Trainer
from pipeline.training.vae import engines

TRAINERS = {"train": engines.trainer, "irl": irl.trainer, "clearance": clearance.trainer}  # by stage


def trainer(variant: Mapping[str, Any], groups: Mapping[str, Any]) -> Trainer:
    """Return how its own stage fits a variant (conf/variants); groups: stage -> settings (conf/train.yaml, ...)."""
    return TRAINERS[variant["stage"]](variant, groups[variant["stage"]])
