"""Stage irl: fit one form of the IRL baseline for every seed, user and number of demonstrations."""

from pathlib import Path
from typing import Annotated, Literal

from omegaconf import DictConfig
from pydantic import Field

from pipeline.launch import launch
from pipeline.runtime.settings import Count, Group, Several, Size, VariantSettings
from pipeline.stages.fitting import fit_variant
from pipeline.training.irl.fit import IrlSchedule, trainer


class Steps(Group):
    maxent: Count
    ranked: Count


class Settings(IrlSchedule):
    steps: Steps


class RewardModel(Group):
    channels: Several
    dilated: Count
    gain: Size
    dropout: Annotated[float, Field(ge=0, lt=1)]
    lattice_side: Several


class Variant(VariantSettings):
    stage: Literal["irl"]
    kind: Literal["reward"]
    objective: Literal["maxent", "ranked"]
    model: RewardModel


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    fit_variant(cfg, out_dir, trainer)


if __name__ == "__main__":
    launch(main, "irl")
