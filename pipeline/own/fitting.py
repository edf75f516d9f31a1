"""Fit one user's models, score them on scenes that they have not seen, and repair invalid demonstrations there.

Folds are groups of scenes, so that a model never judges a scene it was fitted to.
"""

import hashlib
import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.stats import beta, binomtest

from pipeline import library
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import nearest_demonstration, position_only
from pipeline.own.folder import Folder
from pipeline.perception.objects import Objects
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.crossed import estimate, ratio
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error, reliability
from pipeline.world.bezier import lattice

VARIANT = "clearance"
FOLDS = 5
SHARES = (0.25, 0.5, 0.75, 1.0)  # of a fold's training scenes: the learning curve, and the cross-validation itself
PRIOR_SIDE = 28  # points per side of the position-only baseline's lattice, as scenes.prior_side in conf/scenes.yaml
PRIOR_WIDTH_M = 0.15  # standard deviation of the kernel that smooths labels over z_theta [m]; ours
BINS = 5  # of the calibration; twenty scenes have some 150 demonstrations
FLAT = 0.05  # gain of accuracy from the second half of the scenes, below which the curve counts as flat; ours
FEW_CHANGES = 20  # changed decisions below which the interval follows from their number, as in library.effect
LATTICE_SIDE = 14  # points per side of the lattice of paths on which models are compared


@dataclass(frozen=True)
class UserData:
    """A user's scenes with the same number of demonstrations each: where there are fewer, they repeat in turn.

    So each scene counts the same in a fit. `real` marks those that are no repetition: only they are scored.
    """

    user: str
    scenes: list[str]
    objects: Objects
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
            folder.seen.objects[[folder.scenes.index(scene) for scene in rows]],
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
    predictors = [*((VARIANT, share) for share in SHARES), ("nearest_demonstration", 1.0), ("position_only", 1.0)]
    p, models = {key: np.empty(data.valid.shape) for key in predictors}, []
    for k in range(fold.max() + 1):
        progress(f"{data.user}: scenes of fold {k + 1} left out")
        test, training = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        order = stream("own", data.user, "share", k).permutation(training)
        for share in SHARES:
            model = fit_on(data, np.sort(order[: max(2, round(share * len(order)))]))
            p[VARIANT, share][test] = model.probability(data.objects[test], data.z_theta[test])
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
    objects, z_theta, valid = data.objects[scenes], data.z_theta[scenes], data.valid[scenes]
    arrays = *vars(objects).values(), z_theta, valid
    settings = json.dumps([library.SETTINGS[VARIANT], library.TRAINING[library.SETTINGS[VARIANT]["kind"]]])
    digest = hashlib.sha256(settings.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a few scenes may all be valid: the model then answers one probability
        return library.fit(objects, z_theta, valid, variant=VARIANT, seed=job_seed("own", digest))


def scores(judged: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each user, predictor and share of the training scenes.

    accuracy has a 95 % interval over scenes (ci_low, ci_high), at least as wide as the exact one over demonstrations:
    scenes that are all right do not vary, and prove little if they are few; balanced: the mean of the shares of valid
    and of invalid paths on the right side; missed: share of invalid paths that are accepted.
    """
    rows = []
    for (user, predictor, share), part in judged.groupby(["user", "predictor", "share"], sort=False):
        p, valid = part["p"].to_numpy(), part["valid"].to_numpy(bool)
        right = (p > DECISION) == valid
        counts = part.assign(right=right).groupby("scene")["right"].agg(["sum", "size"]).to_numpy(float).T
        interval = ratio(counts[:1, None], counts[1:, None])  # of the share of right answers, over scenes
        exact = binomtest(int(right.sum()), len(part)).proportion_ci()  # Clopper and Pearson, 1934
        row = {"user": user, "predictor": predictor, "share": share, "scenes": counts.shape[1]}
        row |= {"demonstrations": len(part), "accuracy": accuracy(p, valid)}
        row["ci_low"] = float(min(interval.ci_low[0].clip(0), exact.low))
        row["ci_high"] = float(max(interval.ci_high[0].clip(None, 1), exact.high))
        row["balanced"] = float((right[valid].mean() + right[~valid].mean()) / 2)
        row["missed"] = float((p > DECISION)[~valid].mean())
        row |= {"auroc": auroc(p, valid), "brier": brier(p, valid)}
        rows.append(row | {"calibration_error": expected_calibration_error(p, valid, BINS)})
    return pd.DataFrame(rows)


def gain_from_seeing(judged: pd.DataFrame, scored: pd.DataFrame) -> pd.DataFrame:
    """Return for each user what the picture adds to balanced accuracy, over the better image-blind baseline.

    gain, ci_low, ci_high (95 % over scenes, paired); blind: that baseline; state: `helps` (the interval lies above 0),
    `nothing` (it lies below FLAT) or `open`.
    """
    rows = []
    for user, part in judged[judged["share"] == 1].groupby("user", sort=False):
        own = scored[(scored["user"] == user) & (scored["share"] == 1) & (scored["predictor"] != VARIANT)]
        blind = str(own.loc[own["balanced"].idxmax(), "predictor"])
        right = part.assign(right=(part["p"] > DECISION) == part["valid"])
        table = right.pivot(index=["scene", "demo", "valid"], columns="predictor", values="right").astype(float)
        valid = table.index.get_level_values("valid").to_numpy(bool)
        weight = np.where(valid, 0.5 / valid.mean(), 0.5 / (1 - valid.mean()))
        by_scene = pd.DataFrame({"gain": weight * (table[VARIANT] - table[blind]), "weight": weight}, table.index)
        sums = by_scene.groupby("scene").sum().to_numpy().T
        result = ratio(sums[:1, None], sums[1:, None])
        gain, low, high = (float(v[0]) for v in (result.effect, result.ci_low, result.ci_high))
        state = "helps" if low > 0 else "nothing" if high < FLAT else "open"
        rows.append({"user": user, "blind": blind, "gain": gain, "ci_low": low, "ci_high": high, "state": state})
    return pd.DataFrame(rows)


def calibration(judged: pd.DataFrame) -> pd.DataFrame:
    """Return the filled bins of `reliability` for each user and predictor fitted to all training scenes.

    frequency has the exact 95 % interval over demonstrations (ci_low, ci_high; Clopper and Pearson, 1934).
    """
    parts = []
    for (user, predictor), part in judged[judged["share"] == 1].groupby(["user", "predictor"], sort=False):
        bins = reliability(part["p"].to_numpy(), part["valid"].to_numpy(bool), BINS).query("count > 0")
        valid = (bins["count"] * bins["frequency"]).round().astype(int)
        exact = [binomtest(*pair).proportion_ci() for pair in zip(valid.tolist(), bins["count"].tolist(), strict=True)]
        bins[["ci_low", "ci_high"]] = np.array(exact)
        parts.append(bins.assign(user=user, predictor=predictor))
    return pd.concat(parts, ignore_index=True)


def enough(judged: pd.DataFrame, predictor: str) -> pd.DataFrame:
    """Return for each user the gain of accuracy from half of the training scenes to all, paired by scene.

    gain, ci_low, ci_high (95 % over scenes); state: `rising` (the interval lies above 0), `flat` (it lies below FLAT)
    or `open`. If fewer than FEW_CHANGES decisions differ, the interval is at least as wide as their share allows
    (Clopper and Pearson, 1934): scenes without any change prove little.
    """
    rows = []
    for user, part in judged[judged["predictor"] == predictor].groupby("user", sort=False):
        right = part.assign(right=(part["p"] > DECISION) == part["valid"])
        by_demo = right.set_index(["scene", "demo", "share"])["right"].unstack().astype(float)
        gains = by_demo[1.0] - by_demo[0.5]
        result = estimate(gains.groupby("scene").mean().to_numpy()[None, None])
        gain, low, high = (float(v[0]) for v in (result.effect, result.ci_low, result.ci_high))
        changed = int((gains != 0).sum())
        if changed < FEW_CHANGES:
            share = float(beta.ppf(0.975, changed + 1, len(gains) - changed))
            low, high = min(low, -share), max(high, share)
        state = "rising" if low > 0 else "flat" if high < FLAT else "open"
        rows.append({"user": user, "gain": gain, "ci_low": low, "ci_high": high, "state": state})
    return pd.DataFrame(rows)


def disagreement(fitted: Fitted, folder: Folder) -> pd.DataFrame:
    """Return one row for each picture, most disagreement first.

    disagreement: standard deviation of P(valid) over the models, averaged over a lattice of paths; shown: whether the
    user has demonstrations there. Scenes without any come first, as only they are new to all models.
    """
    paths = np.broadcast_to(lattice(LATTICE_SIDE), (len(folder.scenes), LATTICE_SIDE**2, 2))
    apart = np.stack([model.probability(folder.seen.objects, paths) for model in fitted.fold_models]).std(0).mean(1)
    table = pd.DataFrame({"user": fitted.data.user, "scene": folder.scenes, "disagreement": apart.astype(float)})
    table["shown"] = table["scene"].isin(fitted.data.scenes)
    return table.sort_values(["shown", "disagreement"], ascending=[True, False], ignore_index=True)


def repairs(fitted: Fitted, scale: float) -> pd.DataFrame:
    """Return one row for each invalid demonstration: P(valid) before and after, and how far the path's middle moves.

    moved_m: [m on the table]; z and end: control points before and after [m of the model]; NaN where the model finds no
    path that it accepts. A path that the model accepts already (p_before > .8) stays: there the model is wrong.
    """
    data, rows = fitted.data, []
    for scene, name in enumerate(data.scenes):
        wrong = np.flatnonzero(~data.valid[scene] & data.real[scene])
        if not len(wrong):
            continue
        model, seen, starts = fitted.unseeing(scene), data.objects[[scene]], data.z_theta[[scene]][:, wrong]
        ends, p_before = library.repair(model, seen, starts), model.probability(seen, starts)[0]
        ends[0, p_before > library.ACCEPTED_ABOVE] = starts[0, p_before > library.ACCEPTED_ABOVE]  # not even clipped
        p_after = model.probability(seen, np.nan_to_num(ends))[0]
        moved = np.linalg.norm(ends - starts, axis=-1)[0] / 2 / scale  # a parabola's middle moves half as far
        p_after = np.where(np.isfinite(moved), p_after, np.nan)
        numbers = np.column_stack([p_before, p_after, moved, starts[0], ends[0]])
        rows += [(data.user, name, demo, *row) for demo, row in zip(data.demo[scene, wrong], numbers, strict=True)]
    columns = ["user", "scene", "demo", "p_before", "p_after", "moved_m", "z_x", "z_y", "end_x", "end_y"]
    return pd.DataFrame(rows, columns=columns)
