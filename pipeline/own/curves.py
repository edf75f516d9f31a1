"""Follow demonstrated paths by curves, of one degree in a folder, as many control points as the paths ask for."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from pipeline.models.base import Z_RANGE_M
from pipeline.models.clearance.clearance import PATH_SAMPLES
from pipeline.own.files import DEMONSTRATIONS, KEY, Faults
from pipeline.own.frame import Frame
from pipeline.world.bezier import bernstein, bezier, elevated
from pipeline.world.bezier_fit import fit_any
from pipeline.world.layout import SIDE

CONTROLS = r"^c\d_[xy]$"  # columns of control points
DEGREES = (2, 3, 4, 5)  # of the curves that are fitted; one for the whole folder
TRIED, BLOCKS = 40, 10  # demonstrations that choose the degree; parts of each, every other of which is left out
TRIED_SAMPLES = 200  # of each, evenly in time: a fit takes as long as it has samples
POOR_ABOVE_M = 1 / SIDE  # a pixel of the model's image [m]: a curve that misses the hand by more is a poor fit
MAX_NOISE_GAIN = 2.0  # of a fit; demonstrations of 12 samples evenly along a parabola have some 0.6
ALONG_POINTS, WEAKEST = 257, 1e-6  # on a path; information of a control point that no sample determines


def fit_demonstrations(samples: pd.DataFrame, frame: Frame, faults: Faults) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return one row for each demonstration of `read_samples`, sorted by scene, user and demo, and `choose_degree`.

    Columns: scene, user, demo, valid, c0_x, c0_y, c1_x, ... (control points of a Bezier curve [m of the model]),
    residual_m (root mean square distance from the curve, metres on the table), poor and `noise_gain`. Adds a fault for
    paths out of the models' range, and for those that their samples do not determine.
    """
    offsets = np.append(np.flatnonzero(~samples.duplicated(KEY)), len(samples))
    hands = np.split(frame.to_model(samples[["x", "y"]].to_numpy()), offsets[1:-1])
    degrees = choose_degree(hands, frame.scale)
    degree = int(degrees.loc[degrees["chosen"], "degree"].iloc[0])
    rows, controls = [], []
    for points in hands:
        own, u, residual = fit_any(points, min(degree, len(points) - 2))
        rows.append((noise_gain(own, u), residual / frame.scale, residual > POOR_ABOVE_M))
        controls.append(elevated(own, degree))
    demos = samples.iloc[offsets[:-1]].copy()
    demos[["noise_gain", "residual_m", "poor"]] = rows
    curves = bezier(np.stack(controls), PATH_SAMPLES)
    demos["poor"] = demos["poor"].astype(bool)
    far = demos[(np.abs(curves - np.mean(Z_RANGE_M)) > np.ptp(Z_RANGE_M) / 2).any(axis=(1, 2))]
    beyond = "demonstration ({name}) swings out farther than the models' paths can: leave it out"
    faults.rows(DEMONSTRATIONS, far, beyond)
    # A curve off its samples may fold, and its gain then says nothing of them
    loose = demos[~demos["poor"] & (demos["noise_gain"] > MAX_NOISE_GAIN)]
    more = "demonstration ({name}) does not determine its path: expected more samples between its ends"
    faults.rows(DEMONSTRATIONS, loose, more)
    demos = demos[[*KEY, "valid", "residual_m", "poor", "noise_gain"]].reset_index(drop=True)
    columns = [f"c{k}_{axis}" for k in range(degree + 1) for axis in "xy"]
    demos[columns] = np.reshape(controls, (len(demos), -1))
    return demos, degrees


def choose_degree(hands: Sequence[Float[Array, "_ 2"]], scale: float) -> pd.DataFrame:
    """Return how far curves of each degree pass from the parts of a hand's path that they were not fitted to.

    Columns: degree, demonstrations, left_out_m (root mean square distance, median over demonstrations, since fits to a
    folded path may not find its tip), error (its standard error; both in metres on the table) and chosen: the lowest
    degree within one standard error of the best. Each path is cut into BLOCKS parts, of which every other one is left
    out, in turn. Without two paths of enough samples the lowest degree is chosen.
    """
    long = [points for points in hands if len(points) >= 4 * max(DEGREES)]
    some = [long[i] for i in evenly(len(long), TRIED)]
    tried = [points[evenly(len(points), TRIED_SAMPLES)] for points in some]
    away = np.array([[_left_out(points, degree) for degree in DEGREES] for points in tried]).reshape(-1, len(DEGREES))
    table = pd.DataFrame({"degree": DEGREES, "demonstrations": len(tried)})
    if len(tried) < 2:
        return table.assign(left_out_m=np.nan, error=np.nan, chosen=table.index == 0)
    middle = np.median(away, axis=0)
    best = int(middle.argmin())
    error = (away - away[:, [best]]).std(0, ddof=1) / np.sqrt(len(tried))  # of the difference from the best
    chosen = int((middle <= middle[best] + error).argmax())
    return table.assign(left_out_m=middle / scale, error=error / scale, chosen=table.index == chosen)


def evenly(count: int, most: int) -> Int[Array, " kept"]:
    """Return at most `most` indices below `count`, evenly apart, with the first and the last."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def _left_out(points: Float[Array, "sample 2"], degree: int) -> float:
    """Return the root mean square distance [m] of parts of a path that a curve, fitted to its ends, did not see."""
    odd, square = (np.arange(len(points)) * BLOCKS // len(points)) % 2 == 1, []
    ends = np.isin(np.arange(len(points)), (0, len(points) - 1))
    for fitted in (odd | ends, ~odd | ends):
        controls = fit_any(points[fitted], degree)[0]
        square.append(KDTree(bezier(controls, ALONG_POINTS)).query(points[~fitted])[0] ** 2)
    return float(np.sqrt(np.concatenate(square).mean()))


def noise_gain(controls: Float[Array, "control 2"], u: Float[Array, " sample"]) -> float:
    """Return a fitted path's standard deviation, the median along it, per unit of noise in each sample.

    The control points' information is the sum over samples of e e^T, with e the change of the orthogonal distance at
    the sample's parameter u. The gain counts changes across the path alone: along it control points may slide. The
    median leaves out the tip of a folded path, where no hand is precise.
    """
    t, degree = np.linspace(0, 1, ALONG_POINTS), len(controls) - 1
    along = bernstein(t, degree - 1) @ np.diff(controls, axis=0)
    across = along[:, ::-1] * [-1, 1] / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    change = (bernstein(t, degree)[:, :, None] * across[:, None]).reshape(len(t), -1)
    at_samples = change[np.rint(u * (ALONG_POINTS - 1)).astype(int)]
    covariance = np.linalg.inv(at_samples.T @ at_samples + WEAKEST * np.eye(change.shape[1]))
    return float(np.sqrt(np.median((change @ covariance * change).sum(1))))
