"""Stage train: fits one variant of the paper's model for every seed, user and n; predicts every query."""

from functools import partial
from importlib.util import find_spec
from pathlib import Path

from omegaconf import DictConfig

from pipeline.fitting import fit_variant, one_by_one, variant_settings
from pipeline.launch import launch
from pipeline.params import InputError
from pipeline.spec.losses import Weights
from pipeline.spec.training import CURVE, Schedule, fit
from pipeline.spec.vae import VaeSpecification

ENGINES = ("stacked", "reference")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Weights, predictions.parquet, curves.parquet, curves.csv and metrics.json of `cfg.variant`."""
    settings = variant_settings(cfg, "train", ("alpha", "beta", "gamma", "model"))
    weights = Weights(*(float(settings[name]) for name in ("alpha", "beta", "gamma")))
    t = cfg.train
    schedule = Schedule(t.steps, float(t.rate), float(t.weight_decay), t.curve_every)
    if t.engine not in ENGINES:
        raise InputError(f"train.engine is {t.engine!r}: expected one of {', '.join(ENGINES)}")
    if t.engine == "stacked":
        if not find_spec("numba"):
            raise InputError("train.engine=stacked needs Numba: install it, or choose train.engine=reference (slower)")
        from pipeline.spec.stacked import LANES, fit_stack  # compiles on its first import

        train, at_once = partial(fit_stack, weights=weights, schedule=schedule), LANES
    else:
        train, at_once = partial(one_by_one, partial(fit, weights=weights, schedule=schedule)), 1
    fit_variant(cfg, out_dir, settings, VaeSpecification, train, CURVE, at_once)


if __name__ == "__main__":
    launch(main, "train")
