"""Stage train: fit one variant of the paper's model for every seed, user and number of demonstrations."""

from pathlib import Path
from typing import Annotated, Literal

from omegaconf import DictConfig
from pydantic import Field

from pipeline.launch import launch
from pipeline.runtime.settings import Count, Group, ScheduleSettings, Size, VariantSettings, Weight
from pipeline.stages.fitting import fit_variant
from pipeline.training.vae.engines import engine, trainer


class VaeModel(Group):
    latent: Count
    channels: Annotated[list[Count], Field(min_length=3, max_length=3)]
    hidden: Count


class Settings(ScheduleSettings):
    adam_beta2: Annotated[float, Field(ge=0, lt=1)]
    engine: Literal["auto", "simd", "cuda", "reference"]
    model: VaeModel


class Variant(VariantSettings):
    """A variant of the paper's model: the weights of Eq. 1."""

    stage: Literal["train"]
    kind: Literal["vae"]
    alpha: Weight
    beta: Weight
    gamma: Size  # at 0 the classifier is never trained
    model: VaeModel


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    print(f"engine {engine(cfg.train.engine).name}", flush=True)
    fit_variant(cfg, out_dir, trainer)


if __name__ == "__main__":
    launch(main, "train")
