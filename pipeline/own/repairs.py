"""Repair a user's invalid demonstrations by the model that was not fitted to their scene."""

import numpy as np
import pandas as pd

from pipeline import library
from pipeline.own.fitting import Fitted

COLUMNS = ["user", "scene", "demo", "p_before", "p_after", "moved_m", "z_x", "z_y", "end_x", "end_y"]


def repairs(fitted: Fitted, scale: float) -> pd.DataFrame:
    """Return one row for each invalid demonstration: P(valid) before and after, and how far the path's middle moves.

    moved_m: [m on the table]; z and end: control points before and after [m of the model; the
    report writes m on the table]; NaN where the model finds no
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
    return pd.DataFrame(rows, columns=COLUMNS)
