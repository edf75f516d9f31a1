"""Stage train: fit one variant of the paper's model for every seed, user and number of demonstrations."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from omegaconf import DictConfig
from pydantic import Field

from pipeline.launch import launch
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.settings import Count, Group, ScheduleSettings, Size, VariantSettings, Weight
from pipeline.training.loop import Schedule
from pipeline.training.runner import fit_variant, variant_settings
from pipeline.training.vae.engines import engine
from pipeline.training.vae.engines.reference import CURVE


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
    settings = variant_settings(cfg, "train")
    weights = Weights(*(float(settings[name]) for name in ("alpha", "beta", "gamma")))
    chosen = engine(cfg.train.engine)
    print(f"engine {chosen.name} on {chosen.device}", flush=True)
    fit = partial(chosen.fit, weights=weights, schedule=Schedule.of(cfg.train))
    fit_variant(cfg, out_dir, settings, BetaVae, fit, CURVE, chosen.batch_size)


if __name__ == "__main__":
    launch(main, "train")
