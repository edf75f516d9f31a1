"""Fit one user's models: one on all scenes, one without each fold of scenes, and some on fewer scenes.

Folds are groups of scenes, so that a model never judges a scene it was fitted to. A model that was fitted before an
interruption is read again: its file is named after a digest of all that decides it.
"""

import hashlib
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array

from pipeline import library
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import nearest_demonstration, position_only
from pipeline.own.data import UserData
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import job_seed, stream
from pipeline.world.bezier import lattice

VARIANT = "clearance"
FOLDS = 5
SHARES = (0.25, 0.5, 0.75)  # of a fold's training scenes, for the learning curve; 1 is the cross-validation itself
PRIOR_SIDE = 28  # points per side of the position-only baseline's lattice, as scenes.prior_side in conf/scenes.yaml
PRIOR_WIDTH_M = 0.15  # standard deviation of the kernel that smooths labels over z_theta [m]; ours


@dataclass(frozen=True)
class Fitted:
    """One user's models and their predictions of the user's own demonstrations."""

    data: UserData
    model: ValidityModel  # of all scenes
    fold: Int[Array, " scene"]
    fold_models: list[ValidityModel]  # each fitted without one fold
    judged: pd.DataFrame  # predictor, share, scene, row (of the demonstrations), valid, p: on scenes not fitted to

    def unseeing(self, scene: int) -> ValidityModel:
        """Return the model that was not fitted to a scene."""
        return self.fold_models[self.fold[scene]]


def fit_user(data: UserData, kept: Path, progress: Callable[[str], object]) -> Fitted:
    """Fit one user's models; `kept` is the folder of models fitted before."""
    fold = folds(data)
    parts, models = [], []
    for k in range(fold.max() + 1):
        progress(f"{data.user}: scenes of fold {k + 1} left out")
        test, training = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        order = stream("own", data.user, "share", k).permutation(training)
        for share in (*SHARES, 1.0):
            scenes = np.sort(order[: max(2, round(share * len(order)))])
            model = fit_on(data, scenes, kept)
            p = model.probability(data.images[test], data.z_theta[test])
            parts.append(judged(data, test, p, VARIANT, share))
        models.append(model)
        for name, p in blind(data, training, test).items():
            parts.append(judged(data, test, p, name, 1.0))
    progress(f"{data.user}: all scenes")
    whole = fit_on(data, np.arange(len(data.scenes)), kept)
    return Fitted(data, whole, fold, models, pd.concat(parts, ignore_index=True))


def folds(data: UserData) -> Int[Array, " scene"]:
    """Return the fold of each scene: FOLDS groups at random, of nearly the same size."""
    scenes = len(data.scenes)
    return stream("own", data.user, "folds").permutation(np.arange(scenes) % min(FOLDS, scenes))


def fit_on(data: UserData, scenes: Int[Array, " scene"], kept: Path) -> ValidityModel:
    """Return the model of some of a user's scenes, read from `kept` if it is there."""
    arrays = data.images[scenes], data.z_theta[scenes], data.valid[scenes]
    settings = json.dumps([library.SETTINGS[VARIANT], library.TRAINING[library.SETTINGS[VARIANT]["kind"]]])
    digest = hashlib.sha256(settings.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
    path = kept / f"{digest[:32]}.safetensors"
    try:
        return library.load(path)
    except InputError:  # not fitted yet, or damaged
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a few scenes may all be valid: the model then answers one probability
            model = library.fit(*arrays, variant=VARIANT, seed=job_seed("own", digest))
        library.save(model, path)
        return model


def blind(data: UserData, training: Array, test: Array) -> dict[str, Float[Array, "scene n"]]:
    """Return P(valid) of the test scenes' paths by the image-blind baselines, from the training scenes' labels."""
    real = data.real[training]
    z, valid = data.z_theta[training][real], data.valid[training][real]
    queries = data.z_theta[test]
    all_z, all_valid = (np.broadcast_to(a, (len(test), *a.shape)) for a in (z, valid))
    return {
        "nearest_demonstration": nearest_demonstration(all_z, all_valid, queries),
        "position_only": position_only(position_prior(z, valid), queries),
    }


def position_prior(z: Float[Array, "demo 2"], valid: Array) -> Float[Array, "side side"]:
    """Return the share of valid demonstrations around each z_theta as [y, x], smoothed by a Gaussian kernel."""
    square = ((lattice(PRIOR_SIDE)[:, None] - z) ** 2).sum(-1)
    weight = np.exp(-square / (2 * PRIOR_WIDTH_M**2)) + 1e-12
    return (weight @ valid / weight.sum(1)).reshape(PRIOR_SIDE, PRIOR_SIDE)


def judged(data: UserData, test: Array, p: Array, predictor: str, share: float) -> pd.DataFrame:
    """Return one row for each real demonstration of the test scenes."""
    real = data.real[test]
    scene = np.broadcast_to(np.array(data.scenes)[test][:, None], real.shape)
    return pd.DataFrame(
        {
            "user": data.user,
            "predictor": predictor,
            "share": share,
            "scene": scene[real],
            "row": data.row[test][real],
            "valid": data.valid[test][real],
            "p": p[real].astype(float),
        }
    )
