"""Fit one user's models: one on all scenes, one without each fold of scenes, and some on fewer scenes.

Folds are groups of scenes, so that a model never judges a scene it was fitted to.
"""

import hashlib
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline import library
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import nearest_demonstration, position_only
from pipeline.own.folder import Folder
from pipeline.runtime.streams import job_seed, stream
from pipeline.world.bezier import lattice

VARIANT = "clearance"
FOLDS = 5
SHARES = (0.25, 0.5, 0.75)  # of a fold's training scenes, for the learning curve; 1 is the cross-validation itself
PRIOR_SIDE = 28  # points per side of the position-only baseline's lattice, as scenes.prior_side in conf/scenes.yaml
PRIOR_WIDTH_M = 0.15  # standard deviation of the kernel that smooths labels over z_theta [m]; ours


@dataclass(frozen=True)
class UserData:
    """A user's scenes with the same number of demonstrations each: where there are fewer, they repeat in turn.

    So each scene counts the same in a fit. `real` marks those that are no repetition: only they are scored.
    """

    user: str
    scenes: list[str]
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m of the model]
    valid: Bool[Array, "scene n"]
    real: Bool[Array, "scene n"]
    demo: Array  # names (scene, n)

    @classmethod
    def of(cls, user: str, folder: Folder) -> "UserData":
        """Return one user's demonstrations, scenes in the order of their names."""
        demos = folder.demos[folder.demos["user"] == user].reset_index(drop=True)
        rows = {str(scene): part.index for scene, part in demos.groupby("scene")}
        counts = np.array([len(part) for part in rows.values()])
        index = np.stack([np.resize(part, counts.max()) for part in rows.values()])
        return cls(
            user,
            list(rows),
            folder.images[[folder.scenes.index(scene) for scene in rows]],
            demos[["z_x", "z_y"]].to_numpy()[index],
            demos["valid"].to_numpy(bool)[index],
            np.arange(counts.max()) < counts[:, None],
            demos["demo"].to_numpy(object)[index],
        )


@dataclass(frozen=True)
class Fitted:
    """One user's models and their predictions of the user's own demonstrations."""

    data: UserData
    model: ValidityModel  # of all scenes
    fold: Int[Array, " scene"]
    fold_models: list[ValidityModel]  # each fitted without one fold
    judged: pd.DataFrame  # user, predictor, share, scene, demo, valid, p: on scenes not fitted to

    def unseeing(self, scene: int) -> ValidityModel:
        """Return the model that was not fitted to a scene."""
        return self.fold_models[self.fold[scene]]


def fit_user(data: UserData, progress: Callable[[str], object]) -> Fitted:
    """Fit one user's models and image-blind baselines."""
    fold = stream("own", data.user, "folds").permutation(np.arange(len(data.scenes)) % min(FOLDS, len(data.scenes)))
    shares = [(VARIANT, share) for share in (*SHARES, 1.0)]
    p = {key: np.empty(data.valid.shape) for key in (*shares, ("nearest_demonstration", 1.0), ("position_only", 1.0))}
    models = []
    for k in range(fold.max() + 1):
        progress(f"{data.user}: scenes of fold {k + 1} left out")
        test, training = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        order = stream("own", data.user, "share", k).permutation(training)
        for variant, share in shares:
            model = fit_on(data, np.sort(order[: max(2, round(share * len(order)))]))
            p[variant, share][test] = model.probability(data.images[test], data.z_theta[test])
        models.append(model)
        real, queries = data.real[training], data.z_theta[test]
        z, valid = data.z_theta[training][real], data.valid[training][real]
        each_z, each_valid = (np.broadcast_to(labelled, (len(test), *labelled.shape)) for labelled in (z, valid))
        p["nearest_demonstration", 1.0][test] = nearest_demonstration(each_z, each_valid, queries)
        square = ((lattice(PRIOR_SIDE)[:, None] - z) ** 2).sum(-1)
        weight = np.exp(-square / (2 * PRIOR_WIDTH_M**2)) + 1e-12
        prior = (weight @ valid / weight.sum(1)).reshape(PRIOR_SIDE, PRIOR_SIDE)  # [y, x], smoothed labels
        p["position_only", 1.0][test] = position_only(prior, queries)
    progress(f"{data.user}: all scenes")
    whole, real = fit_on(data, np.arange(len(data.scenes))), data.real
    labels = {"scene": np.repeat(data.scenes, real.sum(1)), "demo": data.demo[real], "valid": data.valid[real]}
    judged = [
        pd.DataFrame({"user": data.user, "predictor": predictor, "share": share, **labels, "p": values[real]})
        for (predictor, share), values in p.items()
    ]
    return Fitted(data, whole, fold, models, pd.concat(judged, ignore_index=True))


def fit_on(data: UserData, scenes: Int[Array, " scene"]) -> ValidityModel:
    """Return the model of some of a user's scenes; its seed follows from all that decides it."""
    arrays = data.images[scenes], data.z_theta[scenes], data.valid[scenes]
    settings = json.dumps([library.SETTINGS[VARIANT], library.TRAINING[library.SETTINGS[VARIANT]["kind"]]])
    digest = hashlib.sha256(settings.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a few scenes may all be valid: the model then answers one probability
        return library.fit(*arrays, variant=VARIANT, seed=job_seed("own", digest))
