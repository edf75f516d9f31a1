"""The data of the widget: tables, and maps of what is true and what models state, packed for the browser."""

import base64
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import fewer_levels
from pipeline.report.results import Results
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW


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
        "sources": ["Truth", *map(style.label, models)],
        "scenes": drawn.mapped,
        "images": shown,  # of each scene on its own table top, then on the patterned one
        "maps": _png(stacked),
        "palette": [to_hex(colour) for colour in matplotlib.colormaps[style.MAP](np.linspace(0, 1, 9))],
    }


def _png(pixels: Array) -> str:
    """Return grey or BGR pixels as the data URI of a PNG."""
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
