"""Stage train: fit one variant of the paper's model for every seed, user and number of demonstrations."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.training.loop import Schedule
from pipeline.training.runner import fit_variant, variant_settings
from pipeline.training.vae.engines import engine
from pipeline.training.vae.engines.reference import CURVE


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
