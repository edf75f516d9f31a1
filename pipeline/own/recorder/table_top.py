"""Where the table is in the pictures, and where paths begin and end: table.yaml."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from pipeline.own.recorder.geometry import check_corners
from pipeline.own.recorder.pictures import inside
from pipeline.own.recorder.tables import write_durably
from pipeline.runtime.errors import InputError

SIDE_M = 1.0  # of the table, unless table.yaml says otherwise
START, GOAL = 0.08, 0.92  # places on both axes, as shares of the side, unless table.yaml says otherwise
ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal
HEADER = (
    "# The table in the pictures, written by the recorder. Corners: far left, far right, near right, near left [px].\n"
)


class TableTop:
    """What table.yaml says, with defaults for what it leaves out. Lengths are in metres, corners in pixels."""

    def __init__(self, values: dict[str, Any]) -> None:
        """Check the values of table.yaml; raise InputError for those that make no sense."""
        self.values = values
        self.side_m = _length(values.get("side_m", SIDE_M))
        self.start = self._place("start", START)
        self.goal = self._place("goal", GOAL)
        if math.dist(self.start, self.goal) <= 2 * ENDS_WITHIN_M:
            raise InputError(f"table.yaml: start and goal are less than {200 * ENDS_WITHIN_M:.0f} cm apart")
        corners = values.get("corners")
        shared = corners if isinstance(corners, list) else None
        self.corners = {str(scene): _corners(c) for scene, c in corners.items()} if isinstance(corners, dict) else {}
        self.shared_corners = None if shared is None else _corners(shared)
        self.rectified = bool(values.get("rectified", False))

    def corners_in(self, scene: str, size: tuple[int, int]) -> Float[np.ndarray, "4 2"] | None:
        """Return the corners [px] in a scene's picture of `size` (width, height), or None if nobody marked them."""
        if scene in self.corners:
            return self.corners[scene]
        if self.shared_corners is not None:
            return self.shared_corners
        width, height = size
        whole = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        return whole if self.rectified or (width == height and "corners" not in self.values) else None

    def _place(self, name: str, share: float) -> list[float]:
        """Return start or goal; raise InputError if it is not on the table."""
        place = self.values.get(name, [share * self.side_m] * 2)
        if not _numbers(place, 2) or not all(0 <= value <= self.side_m for value in place):
            raise InputError(f"table.yaml: {name} is {place}: expected two numbers from 0 to side_m ({self.side_m} m)")
        return [float(value) for value in place]


def read_table_top(folder: Path) -> TableTop:
    """Return what table.yaml says; without that file, the defaults."""
    path = inside(folder, folder / "table.yaml")
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"table.yaml is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(values or {}, dict):
        raise InputError("table.yaml: expected lines such as `side_m: 1.0`")
    return TableTop(values or {})


def write_table_top(
    folder: Path, scene: str | None, corners: list[list[float]] | None, side_m: float, ends: dict[str, list[float]]
) -> None:
    """Replace table.yaml by one with these values; other keys stay.

    `corners` [px] hold for `scene`, or for all pictures if that is None; corners of None stay as they are. Raise
    InputError, and leave the file alone, if the values make no sense.
    """
    values = dict(read_table_top(folder).values) | {"side_m": side_m} | ends
    if corners is not None:
        values.pop("rectified", None)
        earlier = values.get("corners")
        rounded = [[round(value, 1) for value in corner] for corner in corners]
        if scene is None:
            values["corners"] = rounded
        elif isinstance(earlier, list):
            raise InputError("the corners in table.yaml hold for all pictures: mark them for all, or remove them first")
        else:
            values["corners"] = {**(earlier or {}), scene: rounded}
    TableTop(values)
    text = HEADER + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
    write_durably(inside(folder, folder / "table.yaml"), lambda path: path.write_text(text, encoding="utf-8"))


def _length(value: Any) -> float:
    if not _numbers([value], 1) or not 0.1 <= value <= 10:
        raise InputError(f"table.yaml: side_m is {value}: expected a length from 0.1 to 10 m")
    return float(value)


def _corners(corners: Any) -> Float[np.ndarray, "4 2"]:
    if not isinstance(corners, list) or len(corners) != 4 or not all(_numbers(corner, 2) for corner in corners):
        raise InputError(f"table.yaml: corners are {corners}: expected four pairs of numbers [column, row]")
    array = np.array(corners, dtype=float)
    check_corners(array)
    return array


def _numbers(values: Any, count: int) -> bool:
    """Whether `values` are so many finite numbers."""
    kinds = isinstance(values, list) and len(values) == count and all(type(v) in (int, float) for v in values)
    return kinds and all(math.isfinite(v) for v in values)
