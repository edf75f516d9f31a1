"""Stage train: fits one variant of the paper's model for every seed, user and n; predicts every query."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig

from pipeline.errors import InputError
from pipeline.fitting.grid import fit_variant, one_by_one, variant_settings
from pipeline.launch import launch
from pipeline.spec import batched
from pipeline.spec.descent import Schedule
from pipeline.spec.losses import Weights
from pipeline.spec.training import CURVE, fit
from pipeline.spec.vae import VaeSpecification


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "train")
    weights = Weights(*(float(settings[name]) for name in ("alpha", "beta", "gamma")))
    train, at_once = _engine(cfg.train.engine)
    train = partial(train, weights=weights, schedule=Schedule.of(cfg.train))
    fit_variant(cfg, out_dir, settings, VaeSpecification, train, CURVE, at_once)


def _engine(name: str) -> tuple[Callable[..., list[np.ndarray]], int]:
    """What fits several models (conf/train), and how many at once; says on stdout which it is."""
    if name == "auto":
        name = "batched" if torch.cuda.is_available() else "stacked"
    if name == "stacked" and not find_spec("numba"):
        raise InputError("train.engine=stacked needs Numba: install it, or choose train.engine=reference (slower)")
    print(f"engine {name} on {batched.device() if name == 'batched' else 'cpu'}", flush=True)
    if name == "batched":
        return batched.fit_batch, batched.AT_ONCE
    if name == "stacked":
        from pipeline.spec.stacked import LANES, fit_stack  # compiles on its first import

        return fit_stack, LANES
    return partial(one_by_one, fit), 1


if __name__ == "__main__":
    launch(main, "train")
