"""Stage train: fit one variant of the paper's model for every seed, user and number of demonstrations."""

from pathlib import Path
from typing import Annotated, Literal

from omegaconf import DictConfig
from pydantic import Field

from pipeline.launch import launch
from pipeline.models.vae.losses import Weights
from pipeline.runtime.settings import Count, Group, VariantSettings
from pipeline.stages.fitting import fit_variant
from pipeline.training.loop import Schedule
from pipeline.training.vae.engines import engine, trainer


class VaeModel(Group):
    latent: Count
    channels: Annotated[list[Count], Field(min_length=3, max_length=3)]
    hidden: Count


class Settings(Schedule):
    engine: Literal["simd", "cuda", "reference"]
    model: VaeModel


class Variant(VariantSettings, Weights):
    stage: Literal["train"]
    kind: Literal["vae"]
    model: VaeModel


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    print(f"engine {engine(cfg.train.engine).name}", flush=True)
    fit_variant(cfg, out_dir, trainer)


if __name__ == "__main__":
    launch(main, "train")
