"""Stage irl: fits one form of the IRL baseline for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.models.irl.reward_map import RewardMap
from pipeline.training.irl.fit import CURVE, IrlSchedule, fit
from pipeline.training.runner import fit_sequentially, fit_variant, variant_settings


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "irl")
    train = partial(
        fit, objective=settings["objective"], schedule=IrlSchedule.of({**cfg.irl, "steps": settings["steps"]})
    )
    fit_variant(cfg, out_dir, settings, RewardMap, partial(fit_sequentially, train), CURVE)


if __name__ == "__main__":
    launch(main, "irl")
