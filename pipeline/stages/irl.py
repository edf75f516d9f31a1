"""Stage irl: fit one form of the IRL baseline for every seed, user and number of demonstrations."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.models.irl.reward_map import RewardMap
from pipeline.training.irl.fit import CURVE, IrlSchedule, fit
from pipeline.training.loop import fit_sequentially
from pipeline.training.runner import fit_variant, variant_settings


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    settings = variant_settings(cfg, "irl")
    schedule = IrlSchedule.of({**cfg.irl, "steps": settings["steps"]})
    fit_all = partial(fit_sequentially, fit, objective=settings["objective"], schedule=schedule)
    fit_variant(cfg, out_dir, settings, RewardMap, fit_all, CURVE, batch_size=None)


if __name__ == "__main__":
    launch(main, "irl")
