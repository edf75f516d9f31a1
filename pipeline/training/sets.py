"""Training sets, and how models of one kind are fitted to them: what stages, studies and `pipeline.fit` share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.models.base import ValidityModel, untrained
from pipeline.runtime.errors import InputError
from pipeline.training.loop import Checkpoints, is_constant

MIN_OWN_DEMONSTRATIONS = 0.995  # share judged right that a converged model reaches
# (models, images, z_theta, valid, seeds=, checkpoints=) -> learning curves; must pickle
Fit = Callable[..., list[Array]]


@dataclass(frozen=True)
class TrainingSet:
    """One user's demonstrations in one seed's scenes: the data that one model is fitted to."""

    user: str
    seed: int
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m]
    valid: Bool[Array, "scene n"]


class Trainer(NamedTuple):
    """How the models of one variant are fitted."""

    kind: type[ValidityModel]
    fit: Fit
    columns: tuple[str, ...]  # of a learning curve, the first one `step`
    batch_size: int | None  # models per call of `fit`; None: any number, in sequence

    def fit_new(
        self,
        variant: str,
        shape: Mapping[str, Any],
        training_sets: Sequence[TrainingSet],
        seeds: Sequence[int],
        checkpoints: Checkpoints | None = None,
    ) -> tuple[list[ValidityModel], list[Float[Array, "point column"]]]:
        """Fit a new model of this `shape` to each training set; return the models and their learning curves.

        Raises InputError, naming the model, if a loss diverges. `seeds` decide initial weights and training.
        """
        models = [untrained(self.kind, shape, seed) for seed in seeds]
        data = ([getattr(t, name) for t in training_sets] for name in ("images", "z_theta", "valid"))
        curves = self.fit(models, *data, seeds=seeds, checkpoints=checkpoints)
        for t, curve in zip(training_sets, curves, strict=True):
            need_finite(curve, f"{variant} of {t.user}, seed {t.seed}, n_demos {t.valid.shape[1]}")
        return models, curves


def need_finite(curve: Float[Array, "point column"], model: str) -> None:
    """Raise InputError, naming the `model`, if its learning curve diverged; column 0: step."""
    if not np.isfinite(curve).all():
        step = int(curve[~np.isfinite(curve).all(1)][0, 0])
        raise InputError(f"{model}: its loss is no longer finite at step {step}; lower the learning rate of its stage")


def convergence(model: ValidityModel, training_set: TrainingSet, has_decoder: bool = True) -> dict[str, Any]:
    """Return whether the model reconstructs its training images and judges its own demonstrations right.

    `passed` if reconstruction_over_flat is below 1 and own_demonstrations at least MIN_OWN_DEMONSTRATIONS. The encoder
    of constant labels is never trained: no ratio.
    """
    trained = has_decoder and not is_constant(training_set.valid)
    ratio = model.reconstruction_over_flat(training_set.images) if trained else np.nan
    share = float(((model.probability(training_set.images, training_set.z_theta) > 0.5) == training_set.valid).mean())
    passed = share >= MIN_OWN_DEMONSTRATIONS and not ratio >= 1
    return {"reconstruction_over_flat": ratio, "own_demonstrations": share, "passed": passed}
