"""Read and check table.yaml of a person's folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from numpy import ndarray as Array
from pydantic import AllowInfNan, Field, Strict, TypeAdapter, ValidationError

from pipeline.own.csv_files import normal
from pipeline.runtime.errors import InputError

SETTINGS = "table.yaml"
KNOWN = ("side_m", "corners", "rectified", "start", "goal")
MIN_APART = 0.2  # smallest distance from start to goal, relative to the table's side
MIN_TABLE_PX = 50  # shortest side of the table in a picture
ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal [m]; a hand that is not in a hurry
MIN_SAMPLES = 3  # rows of a demonstration
MIN_SCENES = 4  # scenes of a user: fewer leave nothing to fit on and nothing to judge by
SIDES_M = (0.1, 10.0)  # side of a table [m]
ENDS = {"start": 0.08, "goal": 0.92}  # x and y, the paper's, relative to the table's side
ORDER = "far left, far right, near right, near left"

Number = Annotated[float, Strict(), AllowInfNan(False)]
Pair = tuple[Number, Number]
SIDE = TypeAdapter(Annotated[Number, Field(ge=SIDES_M[0], le=SIDES_M[1])])
PLACE, CORNERS = TypeAdapter(Pair), TypeAdapter(tuple[Pair, Pair, Pair, Pair])


@dataclass
class Settings:
    """Hold what table.yaml says."""

    side_m: float
    corners: Array | dict[str, Array] | None  # (4, 2) [px], of all scenes or by scene
    rectified: bool  # pictures show just the table
    start: Array  # (2,) [m]
    goal: Array

    def corners_of(self, scene: str) -> Array | None:
        """Return the corners (4, 2) [column, row] of the table in a scene's picture; None: the whole picture."""
        return self.corners.get(scene) if isinstance(self.corners, dict) else self.corners


class _Loader(yaml.SafeLoader):
    """Reads keys as text: 01 and 20260105_101112 are names of scenes, no numbers."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                key.tag = self.DEFAULT_SCALAR_TAG
        return super().construct_mapping(node, deep)


def read_settings(path: Path) -> Settings:
    """Return the settings of table.yaml, or the defaults; raise InputError with a line for each fault."""
    if not (path / SETTINGS).is_file():
        return check_settings({})
    try:
        content = yaml.load((path / SETTINGS).read_text(encoding="utf-8"), _Loader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{SETTINGS} cannot be read: {' '.join(str(error).split())}; correct it") from error
    return check_settings(content or {})


def check_settings(content: Any) -> Settings:
    """Return what table.yaml holds as settings; raise InputError with a line for each fault."""
    if not isinstance(content, dict) or set(content) - set(KNOWN):
        names = ", ".join(map(repr, content)) if isinstance(content, dict) else type(content).__name__
        raise InputError(f"{SETTINGS} holds {names}: expected some of {', '.join(KNOWN)}")
    side, faults = content.get("side_m", 1.0), []
    if _parsed(SIDE, side) is None:
        raise InputError(f"{SETTINGS}: side_m is {side!r}: expected metres from {SIDES_M[0]} to {SIDES_M[1]:g}")
    rectified = content.get("rectified", "corners" not in content)
    if not isinstance(rectified, bool):
        faults.append(f"rectified is {rectified!r}: expected true or false")
    ends = []
    for name, share in ENDS.items():
        place = _parsed(PLACE, value := content.get(name, [share * side] * 2))
        if place is None or (place < 0).any() or (place > side).any():
            faults.append(f"{name} is {value!r}: expected [x, y] in metres on the table, 0 to {side:g}")
        else:
            ends.append(place)
    if len(ends) == 2 and np.linalg.norm(ends[1] - ends[0]) < MIN_APART * side:
        faults.append(f"start and goal are closer than {MIN_APART * side:g} m: expected two places")
    corners = content.get("corners")
    if isinstance(corners, dict):
        corners = {normal(scene): _corners(value, f"corners of {scene}", faults) for scene, value in corners.items()}
    elif corners is not None:
        corners = _corners(corners, "corners", faults)
    if corners is not None and rectified:
        faults.append("both corners and `rectified: true` are given, and they exclude each other: remove one of them")
    if faults:
        raise InputError("\n".join(f"{SETTINGS}: {fault}" for fault in faults))
    return Settings(float(side), corners, rectified, *ends)


def _parsed(kind: TypeAdapter, value: Any) -> Array | None:
    """Return the finite numbers in lists that table.yaml holds, or None if they are of another kind."""
    try:
        return np.array(kind.validate_python(value), float)
    except ValidationError:
        return None


def _corners(value: Any, name: str, faults: list[str]) -> Array:
    """Return four corners; add a fault unless they bound a convex quadrilateral in the right order."""
    corners = _parsed(CORNERS, value)
    if corners is None:
        faults.append(f"{name} are {value!r}: expected four [column, row] in pixels, {ORDER}")
        return np.zeros((4, 2))
    sides = np.roll(corners, -1, axis=0) - corners
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if (turns < 0).all():
        faults.append(f"{name} run counter-clockwise: expected {ORDER}")
    elif not (turns > 0).all():
        faults.append(f"{name} cross or lie on a line: expected a convex quadrilateral, {ORDER}")
    elif np.linalg.norm(sides, axis=1).min() < MIN_TABLE_PX:
        faults.append(f"{name} are less than {MIN_TABLE_PX} pixels apart: expected a larger table in the picture")
    return corners
