"""Stage path: fits the specification that sees the path, for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting.grid import fit_variant, variant_settings
from pipeline.launch import launch
from pipeline.spec.clearance import AT_ONCE, CURVE, ClearanceModel, fit
from pipeline.spec.descent import Schedule


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "path")
    train = partial(fit, schedule=Schedule.of(cfg.path))
    fit_variant(cfg, out_dir, settings, ClearanceModel, train, CURVE, AT_ONCE)


if __name__ == "__main__":
    launch(main, "path")
