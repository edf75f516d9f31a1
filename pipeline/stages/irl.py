"""Stage irl: fits one form of the IRL baseline for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting.grid import fit_variant, one_by_one, variant_settings
from pipeline.launch import launch
from pipeline.spec.irl import CURVE, Schedule, fit
from pipeline.spec.reward import RewardMap


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "irl")
    train = partial(fit, objective=settings["objective"], schedule=Schedule.of({**cfg.irl, "steps": settings["steps"]}))
    fit_variant(cfg, out_dir, settings, RewardMap, partial(one_by_one, train), CURVE)


if __name__ == "__main__":
    launch(main, "irl")
