"""Stage train: fit one variant of the paper's model for every seed, user and number of demonstrations."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.stages.fitting import fit_variant
from pipeline.training.vae.engines import engine, trainer


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write weights, checkpoints, predictions and learning curves of `cfg.variant`."""
    print(f"engine {engine(cfg.train.engine).name}", flush=True)
    fit_variant(cfg, out_dir, "train", trainer)


if __name__ == "__main__":
    launch(main, "train")
