"""Read and check table.yaml of a person's folder."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy import ndarray as Array

from pipeline.own.csv_files import Faults, normal

SETTINGS = "table.yaml"
MIN_APART = 0.2  # smallest distance from start to goal, relative to the table's side
MIN_TABLE_PX = 50  # shortest side of the table in a picture
SIDES_M = (0.1, 10.0)  # side of a table [m]
DEFAULT_START, DEFAULT_GOAL = (0.08, 0.08), (0.92, 0.92)  # the paper's ends, relative to the table's side


@dataclass
class Settings:
    """Hold what table.yaml says: side [m], corners (4, 2) of all scenes or by scene [px], start and goal (2,) [m]."""

    side_m: float = 1.0
    corners: Array | dict[str, Array] | None = None
    rectified: bool = False
    start: Array = field(default_factory=lambda: np.array(DEFAULT_START))
    goal: Array = field(default_factory=lambda: np.array(DEFAULT_GOAL))

    def corners_of(self, scene: str) -> Array | None:
        """Return the corners (4, 2) [column, row] of the table in a scene's picture; None: the whole picture."""
        return self.corners.get(scene) if isinstance(self.corners, dict) else self.corners


def read_settings(path: Path, faults: Faults) -> Settings | None:
    """Return the settings of table.yaml, or the defaults; None after a fault."""
    if not (path / SETTINGS).is_file():
        return Settings(rectified=True)
    try:
        content = yaml.safe_load((path / SETTINGS).read_text(encoding="utf-8")) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        faults.append(f"{SETTINGS} cannot be read: {' '.join(str(error).split())}; correct it")
        return None
    known = ("side_m", "corners", "rectified", "start", "goal")
    if not isinstance(content, dict) or set(content) - set(known):
        names = ", ".join(map(repr, content)) if isinstance(content, dict) else type(content).__name__
        faults.append(f"{SETTINGS} holds {names}: expected some of {', '.join(known)}")
        return None
    before = len(faults)
    side = content.get("side_m", 1.0)
    if not _is_number(side) or not SIDES_M[0] <= side <= SIDES_M[1]:
        faults.append(f"{SETTINGS}: side_m is {side!r}: expected metres from {SIDES_M[0]} to {SIDES_M[1]:g}")
        return None
    settings = Settings(float(side))
    settings.rectified = content.get("rectified", False)
    if not isinstance(settings.rectified, bool):
        faults.append(f"{SETTINGS}: rectified is {settings.rectified!r}: expected true or false")
    settings.start = _point(content, "start", DEFAULT_START, side, faults)
    settings.goal = _point(content, "goal", DEFAULT_GOAL, side, faults)
    if len(faults) == before and np.linalg.norm(settings.goal - settings.start) < MIN_APART * side:
        faults.append(f"{SETTINGS}: start and goal are closer than {MIN_APART * side:g} m: expected two places")
    settings.corners = _corners(content.get("corners"), faults)
    if settings.corners is not None and settings.rectified:
        faults.append(f"{SETTINGS}: corners and rectified: true exclude each other: remove one of them")
    if settings.corners is None and "corners" not in content:
        settings.rectified = True
    return settings if len(faults) == before else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _point(content: Mapping, name: str, default: tuple[float, float], side: float, faults: Faults) -> Array:
    value = content.get(name, [side * c for c in default])
    if isinstance(value, list) and len(value) == 2 and all(_is_number(v) and 0 <= v <= side for v in value):
        return np.array(value, float)
    faults.append(f"{SETTINGS}: {name} is {value!r}: expected [x, y] in metres on the table, 0 to {side:g}")
    return np.zeros(2)


def _corners(value: Any, faults: Faults) -> Array | dict[str, Array] | None:
    """Return corners of all scenes or by scene; add a fault unless each is a quadrilateral in the right order."""
    if value is None:
        return None
    if isinstance(value, dict):
        made = {normal(str(scene)): _quadrilateral(points, f" of {scene}", faults) for scene, points in value.items()}
        return {scene: points for scene, points in made.items() if points is not None}
    return _quadrilateral(value, "", faults)


def _quadrilateral(value: Any, whose: str, faults: Faults) -> Array | None:
    name = f"{SETTINGS}: corners{whose}"
    order = "far left, far right, near right, near left"
    pairs = isinstance(value, list) and len(value) == 4 and all(isinstance(p, list) and len(p) == 2 for p in value)
    if not pairs or not all(_is_number(number) for pair in value for number in pair):
        faults.append(f"{name} are {value!r}: expected four [column, row] in pixels, {order}")
        return None
    points = np.array(value, float)
    sides = np.roll(points, -1, axis=0) - points
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if (turns < 0).all():
        faults.append(f"{name} run counter-clockwise: expected {order}")
    elif not (turns > 0).all():
        faults.append(f"{name} cross or lie on a line: expected a convex quadrilateral, {order}")
    elif np.linalg.norm(sides, axis=1).min() < MIN_TABLE_PX:
        faults.append(f"{name} are less than {MIN_TABLE_PX} pixels apart: expected a larger table in the picture")
    else:
        return points
    return None
