"""Stage clearance: fit the clearance model for every seed, user and number of demonstrations."""

from pathlib import Path
from typing import Literal

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.runtime.settings import Count, Group, VariantSettings
from pipeline.stages.fitting import fit_variant
from pipeline.training.clearance.fit import trainer
from pipeline.training.loop import Schedule

Settings = Schedule


class Shape(Group):
    members: Count
    kinds: Literal[0, 6]  # none, or LOOKS of the segmenter


class Variant(VariantSettings):
    stage: Literal["clearance"]
    kind: Literal["clearance"]
    model: Shape


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    fit_variant(cfg, out_dir, trainer)


if __name__ == "__main__":
    launch(main, "clearance")
