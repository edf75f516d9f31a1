"""Score predictions of held-out scenes, repair invalid demonstrations there, and say which scenes to show next."""

import numpy as np
import pandas as pd
from scipy.stats import beta, binomtest

from pipeline import library
from pipeline.own.fitting import Fitted
from pipeline.own.folder import Folder
from pipeline.stats.crossed import estimate, ratio
from pipeline.stats.scores import DECISION, accuracy, auroc, brier, expected_calibration_error, reliability
from pipeline.world.bezier import lattice

BINS = 5  # of the calibration; twenty scenes have some 150 demonstrations
FLAT = 0.05  # gain of accuracy from the second half of the scenes, below which the curve counts as flat; ours
FEW_CHANGES = 20  # changed decisions below which the interval follows from their number, as in library.effect
SCORES = ["user", "predictor", "share", "scenes", "demonstrations", "accuracy", "ci_low", "ci_high", "balanced"]
SCORES += ["missed", "auroc", "brier", "calibration_error"]
REPAIRED = ["user", "scene", "demo", "p_before", "p_after", "moved_m", "z_x", "z_y", "end_x", "end_y"]  # columns
LATTICE_SIDE = 14  # points per side of the lattice of paths on which models are compared


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
        low = float(min(interval.ci_low[0].clip(0), exact.low))
        high = float(max(interval.ci_high[0].clip(None, 1), exact.high))
        sizes, balanced = (part["scene"].nunique(), len(part)), float((right[valid].mean() + right[~valid].mean()) / 2)
        shares = accuracy(p, valid), low, high, balanced, float((p > DECISION)[~valid].mean())
        errors = auroc(p, valid), brier(p, valid), expected_calibration_error(p, valid, BINS)
        rows.append((user, predictor, share, *sizes, *shares, *errors))
    return pd.DataFrame(rows, columns=SCORES)


def calibration(judged: pd.DataFrame) -> pd.DataFrame:
    """Return the bins of `reliability` for each user and predictor fitted to all training scenes."""
    groups = judged[judged["share"] == 1].groupby(["user", "predictor"], sort=False)
    parts = [
        reliability(part["p"].to_numpy(), part["valid"].to_numpy(bool), BINS).assign(user=user, predictor=predictor)
        for (user, predictor), part in groups
    ]
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
    apart = np.stack([model.probability(folder.images, paths) for model in fitted.fold_models]).std(0).mean(1)
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
        model, image, starts = fitted.unseeing(scene), data.images[[scene]], data.z_theta[[scene]][:, wrong]
        ends, p_before = library.repair(model, image, starts), model.probability(image, starts)[0]
        ends[0, p_before > library.ACCEPTED_ABOVE] = starts[0, p_before > library.ACCEPTED_ABOVE]  # not even clipped
        p_after = model.probability(image, np.nan_to_num(ends))[0]
        moved = np.linalg.norm(ends - starts, axis=-1)[0] / 2 / scale  # a parabola's middle moves half as far
        p_after = np.where(np.isfinite(moved), p_after, np.nan)
        numbers = np.column_stack([p_before, p_after, moved, starts[0], ends[0]])
        rows += [(data.user, name, demo, *row) for demo, row in zip(data.demo[scene, wrong], numbers, strict=True)]
    return pd.DataFrame(rows, columns=REPAIRED)
