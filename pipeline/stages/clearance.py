"""Stage clearance: fit the clearance model for every seed, user and number of demonstrations."""

from functools import partial
from pathlib import Path
from typing import Literal

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.runtime.settings import Count, Group, ScheduleSettings, VariantSettings
from pipeline.training.clearance.fit import BATCH_SIZE, CURVE, fit
from pipeline.training.loop import Schedule
from pipeline.training.runner import fit_variant, variant_settings


class Settings(ScheduleSettings):
    pass


class Members(Group):
    members: Count


class Variant(VariantSettings):
    """A variant of the clearance model."""

    stage: Literal["clearance"]
    kind: Literal["clearance"]
    model: Members


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    settings = variant_settings(cfg, "clearance")
    fit_all = partial(fit, schedule=Schedule.of(cfg.clearance))
    fit_variant(cfg, out_dir, settings, ClearanceModel, fit_all, CURVE, BATCH_SIZE)


if __name__ == "__main__":
    launch(main, "clearance")
