"""Stage irl: fits one form of the IRL baseline for every seed, user and n; predicts every query."""

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting.grid import fit_variant, one_by_one, variant_settings
from pipeline.launch import launch
from pipeline.spec.irl import CURVE, Schedule, fit
from pipeline.spec.jitter import Jitter
from pipeline.spec.reward import RewardMap


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "irl", ("objective", "steps", "model"))
    train = partial(fit, objective=settings["objective"], schedule=schedule(cfg, settings["steps"]))
    fit_variant(cfg, out_dir, settings, RewardMap, partial(one_by_one, train), CURVE)


def schedule(cfg: DictConfig, steps: int) -> Schedule:
    """conf/irl, and the variant's steps, as the library takes them; ValueError for a value out of range."""
    s = cfg.irl
    jitter = Jitter(**{name: float(value) for name, value in s.jitter.items()})
    return Schedule(
        steps, float(s.rate), float(s.weight_decay), s.curve_every, s.scenes_per_step, s.copies,
        float(s.sparsity), s.across, jitter,
    )  # fmt: skip


if __name__ == "__main__":
    launch(main, "irl")
