"""Fit one user's models, score them on scenes that they have not seen, and repair invalid demonstrations there.

Folds are groups of arrangements, so that a model never judges a scene it was fitted to, nor one that looks the same.
"""

import hashlib
import json
import warnings
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from joblib import cpu_count
from numpy import ndarray as Array
from scipy.spatial.distance import cdist
from scipy.stats import beta, binomtest

from pipeline import library
from pipeline.models.base import ValidityModel
from pipeline.models.clearance.clearance import OCCAM_NATS, PATH_SAMPLES
from pipeline.own.curves import evenly
from pipeline.own.folder import Folder
from pipeline.perception.objects import FEATURES, Objects
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.crossed import Estimates, estimate, ratio
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error
from pipeline.stats.tests import MIN_PAIRS
from pipeline.world.bezier import bezier

VARIANT = "clearance"
WORKERS = cpu_count()
FOLDS = 5
SHARES = (0.5, 1.0)  # of a fold's training scenes: whether more would help, and the cross-validation itself
COMPARED_POINTS = 33  # of each of two curves, at the same parameters
PRIOR_WIDTH_M = 0.055  # standard deviation of the kernel that smooths labels over curves, 15 cm of z_theta; ours
BINS = 5  # of the calibration; twenty scenes have some 150 demonstrations
FLAT = 0.05  # gain of accuracy from the second half of the scenes, below which the curve counts as flat; ours
FEW_CHANGES = 20  # changed decisions below which the interval follows from their number, as in library.effect
REPAIRED_POINTS = 65  # of a repaired path
COMPARED_PATHS = 196  # demonstrations of other scenes, at most, on which models are compared in each scene


@dataclass(frozen=True)
class UserData:
    """A user's scenes, each with the same number of demonstrations, so that each counts the same in a fit.

    Where a scene has fewer, they repeat in turn. `real` marks those that are no repetition: only they are scored.
    """

    user: str
    scenes: list[str]
    arrangement: Int[Array, " scene"]  # the same number for scenes that look alike
    objects: Objects
    named: bool  # the objects' kinds are those that people named
    controls: Float[Array, "scene n control 2"]  # [m of the model]
    valid: Bool[Array, "scene n"]
    real: Bool[Array, "scene n"]
    demo: Array  # names (scene, n)

    @property
    def paths(self) -> Float[Array, "scene n point 2"]:
        """Return points along each demonstrated path [m of the model]."""
        return bezier(self.controls, PATH_SAMPLES)

    @classmethod
    def of(cls, user: str, folder: Folder) -> "UserData":
        """Return one user's demonstrations, scenes in the order of their names."""
        demos = folder.demos[folder.demos["user"] == user].reset_index(drop=True)
        rows = {str(scene): part.index for scene, part in demos.groupby("scene")}
        counts = np.array([len(part) for part in rows.values()])
        index = np.stack([np.resize(part, counts.max()) for part in rows.values()])
        numbers = [folder.scenes.index(scene) for scene in rows]
        return cls(
            user,
            list(rows),
            pd.factorize(folder.arrangements[numbers])[0],
            folder.seen.objects[numbers],
            folder.seen.kinds is not None,
            folder.controls(demos)[index],
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
    judged: pd.DataFrame  # user, predictor, share, scene, arrangement, demo, valid, p: on scenes not fitted to

    def unseeing(self, scene: str) -> ValidityModel:
        """Return the model that was not fitted to a scene."""
        fold = dict(zip(self.data.scenes, self.fold, strict=True))
        return self.fold_models[fold[scene]] if scene in fold else self.model


def fit_user(data: UserData) -> Fitted:
    """Fit one user's models and image-blind baselines, with a progress bar."""
    fold, paths, fitted_to = folds(data), data.paths, {}
    for k in range(fold.max() + 1):
        order = stream("own", data.user, "share", k).permutation(np.flatnonzero(fold != k))
        fitted_to |= {(k, share): np.sort(order[: max(2, round(share * len(order)))]) for share in SHARES}
    jobs = [*fitted_to.values(), np.arange(len(data.scenes))]
    *models, whole = map_jobs(partial(fit_on, data), jobs, WORKERS, desc=f"models of {data.user}")
    without = dict(zip(fitted_to, models, strict=True))
    predictors = [*((VARIANT, share) for share in SHARES), ("nearest_demonstration", 1.0), ("position_only", 1.0)]
    p, real = {key: np.empty(data.valid.shape) for key in predictors}, data.real
    for k in range(fold.max() + 1):
        test, training = fold == k, fold != k
        for share in SHARES:
            p[VARIANT, share][test] = without[k, share].probability(data.objects[test], paths[test])
        valid = data.valid[training][real[training]]
        away = apart(data.controls[test], data.controls[training][real[training]])
        p["nearest_demonstration", 1.0][test] = valid[away.argmin(-1)]
        weight = np.exp(-(away**2) / (2 * PRIOR_WIDTH_M**2)) + 1e-12
        p["position_only", 1.0][test] = weight @ valid / weight.sum(-1)
    labels = {"scene": np.repeat(data.scenes, real.sum(1)), "arrangement": np.repeat(data.arrangement, real.sum(1))}
    labels |= {"demo": data.demo[real], "valid": data.valid[real]}
    judged = [
        pd.DataFrame({"user": data.user, "predictor": predictor, "share": share, **labels, "p": values[real]})
        for (predictor, share), values in p.items()
    ]
    folded = [without[k, SHARES[-1]] for k in range(fold.max() + 1)]
    return Fitted(data, whole, fold, folded, pd.concat(judged, ignore_index=True))


def folds(data: UserData) -> Int[Array, " scene"]:
    """Return a number from 0 for each scene, the same for scenes of one arrangement."""
    count = data.arrangement.max() + 1
    return stream("own", data.user, "folds").permutation(np.arange(count) % min(FOLDS, count))[data.arrangement]


def apart(
    controls: Float[Array, "*path control 2"], others: Float[Array, "other control 2"]
) -> Float[Array, "*path other"]:
    """Return the root mean square distance [m] of curves from other curves, at the same parameters."""
    first, second = (bezier(some, COMPARED_POINTS).reshape(-1, 2 * COMPARED_POINTS) for some in (controls, others))
    return cdist(first, second).reshape(*controls.shape[:-2], -1) / np.sqrt(COMPARED_POINTS)


def fit_on(data: UserData, scenes: Int[Array, " scene"]) -> ValidityModel:
    """Return the model of some of a user's scenes; its seed follows from all that decides it.

    Where people named kinds, relevance depends on kinds alone, unless with the appearance of objects labels are more
    probable by OCCAM_NATS: among few items, size or colour may tell by chance what the kind tells.
    """
    objects, paths, valid = data.objects[scenes], data.paths[scenes], data.valid[scenes]
    arrays = *vars(objects).values(), paths, valid
    settings = json.dumps([library.SETTINGS[VARIANT], library.TRAINING[library.SETTINGS[VARIANT]["kind"]]])
    digest = hashlib.sha256(settings.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()

    def fitted(some: Objects) -> ValidityModel:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a few scenes may all be valid: the model then answers one probability
            model = library.fit(some, paths, valid, variant=VARIANT, seed=job_seed("own", digest))
        model.get_buffer("usual_doubt").fill_(1.0)  # `seen.USUAL_DOUBT`: that of the segmenter's training
        return model

    model = fitted(objects)
    if not data.named:
        return model
    by_kind = fitted(replace(objects, features=np.zeros_like(objects.features)))
    columns = np.r_[1 : 1 + len(FEATURES)]  # of the mask, which holds a constant, all features and their squares
    mask, evidence = by_kind.get_buffer("feature_mask"), [one.get_buffer("evidence").max() for one in (model, by_kind)]
    mask[..., [*columns, *(columns + mask.shape[-1] // 2)]] = 0
    return model if evidence[0] > evidence[1] + OCCAM_NATS else by_kind


def scores(judged: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each user, predictor and share of the training scenes.

    accuracy has a 95 % interval over arrangements (ci_low, ci_high), at least as wide as the exact one over
    demonstrations: scenes that are all right do not vary, and prove little if they are few. balanced: the mean of the
    shares of valid paths accepted and of invalid ones rejected. missed: the share of invalid ones accepted.
    """
    rows = []
    for (user, predictor, share), part in judged.groupby(["user", "predictor", "share"], sort=False):
        p, valid = part["p"].to_numpy(), part["valid"].to_numpy(bool)
        right = (p > DECISION) == valid
        counts = part.assign(right=right).groupby("arrangement")["right"].agg(["sum", "size"]).to_numpy(float).T
        interval = ratio(counts[:1, None], counts[1:, None]).row(share=True)  # of right answers, over scenes
        exact = binomtest(int(right.sum()), len(part)).proportion_ci()  # Clopper and Pearson, 1934
        row = {"user": user, "predictor": predictor, "share": share, "scenes": part["scene"].nunique()}
        row |= {"demonstrations": len(part), "accuracy": accuracy(p, valid)}
        row |= {"ci_low": min(interval["ci_low"], exact.low), "ci_high": max(interval["ci_high"], exact.high)}
        row |= {"balanced": (right[valid].mean() + right[~valid].mean()) / 2, "missed": (p > DECISION)[~valid].mean()}
        row |= {"auroc": auroc(p, valid), "brier": brier(p, valid)}
        rows.append(row | {"calibration_error": expected_calibration_error(p, valid, BINS)})
    return pd.DataFrame(rows)


def gain_from_seeing(judged: pd.DataFrame, scored: pd.DataFrame) -> pd.DataFrame:
    """Return for each user what the picture adds to balanced accuracy, over the better image-blind baseline.

    Columns of `_gain`, and blind: that baseline; state: `helps` (interval above 0), `nothing` (below FLAT) or `open`.
    """
    rows = []
    for user, part in judged[judged["share"] == 1].groupby("user", sort=False):
        own = scored[(scored["user"] == user) & (scored["share"] == 1) & (scored["predictor"] != VARIANT)]
        blind = str(own.loc[own["balanced"].idxmax(), "predictor"])
        right = part.assign(right=(part["p"] > DECISION) == part["valid"])
        keys = ["arrangement", "scene", "demo", "valid"]
        table = right.pivot(index=keys, columns="predictor", values="right").astype(float)
        valid = table.index.get_level_values("valid").to_numpy(bool)
        weight = np.where(valid, 0.5 / valid.mean(), 0.5 / (1 - valid.mean()))
        by_demo = pd.DataFrame({"gain": weight * (table[VARIANT] - table[blind]), "weight": weight}, table.index)
        sums = by_demo.groupby("arrangement").sum().to_numpy().T
        row = _gain(ratio(sums[:1, None], sums[1:, None]), table[VARIANT] != table[blind], ("helps", "nothing"))
        rows.append({"user": user, "blind": blind} | row)
    return pd.DataFrame(rows)


def _gain(mean: Estimates, changed: pd.Series, words: tuple[str, str], down: bool = False) -> dict[str, Any]:
    """Return gain, ci_low, ci_high (95 % over arrangements, paired), state: a word above 0, one below FLAT, or `open`.

    changed: whether a decision differs, by arrangement and others. If fewer than FEW_CHANGES do, the interval is
    widened upwards (`down`: and downwards) to what their share allows (Clopper and Pearson, 1934), as scenes without
    any change prove little. Fewer than MIN_PAIRS arrangements exclude nothing.
    """
    gain, low, high = (float(value[0]) for value in (mean.effect, mean.ci_low, mean.ci_high))
    if (count := int(changed.sum())) < FEW_CHANGES:
        share = float(beta.ppf(0.975, count + 1, len(changed) - count))
        low, high = min(low, -share) if down else low, max(high, share)
    low, high = (low, high) if changed.index.get_level_values("arrangement").nunique() >= MIN_PAIRS else (-1.0, 1.0)
    state = words[0] if low > 0 else words[1] if high < FLAT else "open"
    return {"gain": gain, "ci_low": low, "ci_high": high, "state": state}


def enough(judged: pd.DataFrame, predictor: str) -> pd.DataFrame:
    """Return for each user the gain of accuracy from half of the training scenes to all, paired by arrangement.

    Columns of `_gain`; state: `rising` (the interval lies above 0), `flat` (it lies below FLAT) or `open`.
    """
    rows = []
    for user, part in judged[judged["predictor"] == predictor].groupby("user", sort=False):
        right = part.assign(right=(part["p"] > DECISION) == part["valid"])
        by_demo = right.set_index(["arrangement", "scene", "demo", "share"])["right"].unstack().astype(float)
        gains = by_demo[1.0] - by_demo[0.5]
        mean = estimate(gains.groupby("arrangement").mean().to_numpy()[None, None])
        rows.append({"user": user} | _gain(mean, gains != 0, ("rising", "flat"), down=True))
    return pd.DataFrame(rows)


def disagreement(fitted: Fitted, folder: Folder) -> pd.DataFrame:
    """Return one row for each picture, most disagreement first.

    disagreement: standard deviation of P(valid) over the models, averaged over paths demonstrated in any scene; shown:
    whether the user has demonstrations there. Scenes without any come first, as only they are new to all models.
    """
    shown = bezier(folder.controls(), PATH_SAMPLES)
    some = shown[evenly(len(shown), COMPARED_PATHS)]
    paths = np.broadcast_to(some, (len(folder.scenes), *some.shape)).copy()
    apart = np.stack([model.probability(folder.seen.objects, paths) for model in fitted.fold_models]).std(0).mean(1)
    table = pd.DataFrame({"user": fitted.data.user, "scene": folder.scenes, "disagreement": apart.astype(float)})
    table["shown"] = table["scene"].isin(fitted.data.scenes)
    return table.sort_values(["shown", "disagreement"], ascending=[True, False], ignore_index=True)


def repairs(fitted: Fitted, folder: Folder) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return one row for each invalid demonstration, and the points of those that are repaired.

    First table: P(valid) before and after, and moved_m, the mean distance along the path [m on the table]; NaN where
    the model finds no path that it accepts. A path that the model accepts already (p_before > .8) stays: there the
    model is wrong. Second table: point, x, y [m on the table], REPAIRED_POINTS for each repaired path.
    """
    data, rows, points = fitted.data, [], []
    for scene, name in enumerate(data.scenes):
        wrong = np.flatnonzero(~data.valid[scene] & data.real[scene])
        if not len(wrong):
            continue
        model, seen = fitted.unseeing(name), data.objects[[scene]]
        starts = bezier(data.controls[[scene]][:, wrong], REPAIRED_POINTS)
        ends, p_before = library.repair(model, seen, starts), model.probability(seen, starts)[0]
        found = np.isfinite(ends[0]).all((1, 2))
        p_after = np.where(found, model.probability(seen, np.where(found[:, None, None], ends, starts))[0], np.nan)
        moved = np.linalg.norm(ends - starts, axis=-1).mean(-1)[0] / folder.frame.scale
        numbers = zip(data.demo[scene, wrong], p_before, p_after, moved, strict=True)
        rows += [(data.user, name, *row) for row in numbers]
        for demo, path in zip(data.demo[scene, wrong][found], folder.frame.to_table(ends[0, found]), strict=True):
            points += [(data.user, name, demo, i, *point) for i, point in enumerate(path)]
    table = pd.DataFrame(rows, columns=["user", "scene", "demo", "p_before", "p_after", "moved_m"])
    return table, pd.DataFrame(points, columns=["user", "scene", "demo", "point", "x", "y"])
