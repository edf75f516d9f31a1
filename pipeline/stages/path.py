"""Stage path: fits the specification that sees the path, for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting.grid import fit_variant, one_by_one, variant_settings
from pipeline.launch import launch
from pipeline.spec.clearance import CURVE, ClearanceModel, fit
from pipeline.spec.training import Schedule


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "path", ("model",))
    p = cfg.path
    schedule = Schedule(p.steps, float(p.rate), float(p.weight_decay), p.curve_every)
    fit_variant(cfg, out_dir, settings, ClearanceModel, partial(one_by_one, fit, schedule=schedule), CURVE)


if __name__ == "__main__":
    launch(main, "path")
