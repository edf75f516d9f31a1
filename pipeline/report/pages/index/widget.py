"""The data of the widget: tables, and maps of what is true and what models state, packed for the browser."""

import base64
from collections.abc import Sequence
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt

from pipeline.report import style
from pipeline.report.drawing import fewer_levels
from pipeline.report.results import Results
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, lattice

ANYWHERE = [0.43, 0.91]  # a control point on the table [m]


def widget(results: Results) -> dict[str, Any]:
    """Return the widget's data, ready for JSON.

    `maps` is one grey image, P(valid) from 0 to 255: below one another for each table, user and source in turn, each
    (side, side) with row 0 at `low`.
    """
    drawn, users = results.drawn, results.judged_users
    models = [v for v in ("full", "clearance") if v in results.shown] or results.shown[:1]
    shown, maps = [], []
    for top, images, by_variant in (
        ("", drawn.images, drawn.maps),
        ("patterned", drawn.patterned, drawn.patterned_maps),
    ):
        for place, scene in enumerate(drawn.mapped):
            image = images[place if top else scene]
            shown.append(_png(fewer_levels(image)[..., ::-1]))
            for user in users:
                maps += [drawn.truth[user][place], *(by_variant[v][user][place] for v in models)]
    stacked = np.rint(255 * np.concatenate(maps).astype(float)).astype(np.uint8)
    return {
        "start": P_INIT.tolist(),
        "end": P_F.tolist(),
        "low": Z_LOW,
        "high": Z_HIGH,
        "side": stacked.shape[1],
        "users": users,
        "first": _first_control_point(drawn.truth[users[0]][0], [drawn.maps[v][users[0]][0] for v in models]),
        "sources": ["Truth", *map(style.label, models)],
        "scenes": drawn.mapped,
        "images": shown,  # of each scene on its own table top, then on the patterned one
        "maps": _png(stacked),
        "palette": [to_hex(colour) for colour in matplotlib.colormaps[style.MAP](np.linspace(0, 1, 9))],
    }


def _first_control_point(truth: Array, maps: Sequence[Array]) -> list[float]:
    """Return a control point [m] on the table where models differ: the last one is right, the first one wrong.

    It lies deepest inside such a region; without one it is `ANYWHERE`.
    """
    z, last, first = lattice(len(truth)), maps[-1] > 0.5, maps[0] > 0.5
    on_table = ((z > 0) & (z < 1)).all(-1).reshape(truth.shape)
    differ = np.pad(on_table & (last == truth) & (first != truth), 1)
    depth = distance_transform_edt(differ)[1:-1, 1:-1]
    return z[int(depth.argmax())].tolist() if depth.any() else ANYWHERE


def _png(pixels: Array) -> str:
    """Return grey or BGR pixels as the data URI of a PNG."""
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
