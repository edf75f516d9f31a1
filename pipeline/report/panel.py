"""The panel in which a reader moves a path: what every model believes of a few tables, packed for the page's script."""

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array
from PIL import Image

from pipeline.report.figures.tabletop import MAP
from pipeline.report.wording import split_label, variant_label, variant_phrase
from pipeline.table.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, lattice
from pipeline.table.layout import SYMBOLS, Layouts
from pipeline.table.rules import SAMPLES, Margins, valid

TENTH_OF_A_MILLIMETRE = 1e-4  # [m]: what control points of repairs are rounded to
PICTURE = {"format": "webp", "quality": 98, "method": 6}  # about 3 kB a table


@dataclass(frozen=True)
class Ascents:
    """One model's repairs in one scene, each start first."""

    start: Int[Array, " start"]  # number of each among the scene's starts
    z: Float[Array, "start point 2"]  # [m]
    p: Float[Array, "start point"]  # P(valid) as the model sees it


@dataclass(frozen=True)
class Scene:
    """One scene of the panel: first the table as it is, then maybe the same table with one more item, each in turn."""

    name: str
    added: list[str]  # symbol of the added item, by further table
    images: UInt8[Array, "table 100 100 3"]
    layouts: Layouts  # by table
    maps: dict[str, dict[str, Float[Array, "table cell"]]]  # by user and variant: P(valid) on `lattice(side)`
    repairs: dict[str, dict[str, Ascents]]  # by user and variant, in the table as it is; may be empty


def panel(
    splits: Mapping[str, Sequence[Scene]], users: Mapping[str, Margins], variants: Sequence[str], side: int
) -> dict:
    """The panel's data as JSON knows them: lengths in metres, arrays as base64 of their bytes (see `_scene`).

    splits: scenes by split; users: the margins [m] of those a reader can choose; side: cells of a map, per side.
    """
    return {
        "side": side,
        "low": Z_LOW,
        "high": Z_HIGH,
        "ends": [P_INIT.tolist(), P_F.tolist()],
        "samples": SAMPLES,
        "unit": TENTH_OF_A_MILLIMETRE,
        "palette": _packed(matplotlib.colormaps[MAP](np.arange(256), bytes=True)[:, :3]),
        "users": [{"name": u, "margins": {s: margins[s] for s in SYMBOLS}} for u, margins in users.items()],
        "variants": [{"label": variant_label(v), "phrase": variant_phrase(v)} for v in variants],
        "splits": [
            {"label": split_label(name), "scenes": [_scene(scene, users, variants, side) for scene in scenes]}
            for name, scenes in splits.items()
        ],
    }


def script_json(data: Mapping) -> str:
    """JSON that can stand in a script element: nothing in it ends the element."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _scene(scene: Scene, users: Mapping[str, Margins], variants: Sequence[str], side: int) -> dict:
    """Tables with picture, items, true maps by user and believed ones by user and variant; repairs likewise.

    Maps run along x first: bits (truth) or bytes (255 P(valid)). Control points are int16, bytes in little-endian
    order, (start, point, 2) in units of TENTH_OF_A_MILLIMETRE; their P(valid) bytes as in maps, (start, point).
    """
    cells = np.broadcast_to(lattice(side), (len(scene.images), side**2, 2))
    truth = {user: valid(scene.layouts, cells, margins) for user, margins in users.items()}
    tables = [
        {
            "added": added,
            "picture": _picture(scene.images[i]),
            "items": _items(scene.layouts, i),
            "truth": [_packed(np.packbits(truth[user][i])) for user in users],
            "maps": [[_packed(_quantised(scene.maps[user][v][i])) for v in variants] for user in users],
        }
        for i, added in enumerate([None, *scene.added])
    ]
    repairs = [
        {
            "starts": scene.repairs[user][variants[0]].start.tolist(),
            "ascents": [_ascents(scene.repairs[user][v]) for v in variants],
        }
        for user in users
        if scene.repairs
    ]
    return {"label": scene.name, "tables": tables, "repairs": repairs}


def _items(layouts: Layouts, table: int) -> list[dict]:
    """Each item's capsule: both ends of its segment and its radius, rounded to a hundredth of a millimetre [m]."""
    return [
        {
            "symbol": SYMBOLS[layouts.symbol[table, slot]],
            "ends": layouts.ends[table, slot].round(5).tolist(),
            "radius": round(float(layouts.radius[table, slot]), 5),
        }
        for slot in np.flatnonzero(layouts.present[table])
    ]


def _ascents(ascents: Ascents) -> dict[str, str]:
    z = np.rint(ascents.z / TENTH_OF_A_MILLIMETRE).astype("<i2")
    return {"z": _packed(z), "p": _packed(_quantised(ascents.p))}


def _quantised(p: Float[Array, "*shape"]) -> UInt8[Array, "*shape"]:
    """Probabilities as 255 P(valid), rounded."""
    return np.rint(255 * p).astype(np.uint8)


def _picture(image: UInt8[Array, "100 100 3"]) -> str:
    """A table's picture as an address that holds it."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, **PICTURE)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _packed(array: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
