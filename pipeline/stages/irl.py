"""Stage irl: fit one form of the IRL baseline for every seed, user and number of demonstrations."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.stages.fitting import fit_variant
from pipeline.training.irl.fit import trainer


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    fit_variant(cfg, out_dir, "irl", trainer)


if __name__ == "__main__":
    launch(main, "irl")
