"""Stage train: fits one variant of the paper's model for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting import fit_variant, variant_settings
from pipeline.launch import launch
from pipeline.spec.losses import Weights
from pipeline.spec.training import CURVE, Schedule, fit


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "train")
    weights = Weights(*(float(settings[name]) for name in ("alpha", "beta", "gamma")))
    t = cfg.train
    schedule = Schedule(t.steps, float(t.rate), float(t.weight_decay), t.curve_every)
    fit_variant(cfg, out_dir, settings, partial(fit, weights=weights, schedule=schedule), CURVE)


if __name__ == "__main__":
    launch(main, "train")
