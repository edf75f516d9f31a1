"""Stage train: fits one variant of the paper's model for every seed, user and n; predicts every query."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig

from pipeline.launch import launch
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.errors import InputError
from pipeline.training.loop import Schedule
from pipeline.training.runner import fit_sequentially, fit_variant, variant_settings
from pipeline.training.vae.engines import cuda
from pipeline.training.vae.engines.reference import CURVE, fit


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "train")
    weights = Weights(*(float(settings[name]) for name in ("alpha", "beta", "gamma")))
    train, batch_size = _engine(cfg.train.engine)
    train = partial(train, weights=weights, schedule=Schedule.of(cfg.train))
    fit_variant(cfg, out_dir, settings, BetaVae, train, CURVE, batch_size)


def _engine(name: str) -> tuple[Callable[..., list[np.ndarray]], int]:
    """What fits several models (conf/train), and how many at once; says on stdout which it is."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "simd"
    if name == "simd" and not find_spec("numba"):
        raise InputError("train.engine=simd needs Numba: install it, or choose train.engine=reference (slower)")
    print(f"engine {name} on {cuda.device() if name == 'cuda' else 'cpu'}", flush=True)
    if name == "cuda":
        return cuda.fit_batch, cuda.BATCH_SIZE
    if name == "simd":
        from pipeline.training.vae.engines.simd import LANES, fit_stack  # compiles on its first import

        return fit_stack, LANES
    return partial(fit_sequentially, fit), 1


if __name__ == "__main__":
    launch(main, "train")
