"""Place table and robot once for all: the largest table on which every training demonstration is executed."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.robot.arm import Arm, load_arm
from pipeline.robot.bench import Bench
from pipeline.robot.execution import FAILURES
from pipeline.robot.inverse import FREE, PostureMap, posture_map
from pipeline.robot.motion import minimum_jerk
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.world.bezier import P_INIT


@dataclass(frozen=True)
class Try:
    """One placement, and the demonstrations that judge it."""

    name: str
    settings: str  # JSON, so that a worker loads each arm once
    bench: Bench
    side: int  # points a side of the map of postures
    tallest_m: float  # height of the tallest item on a table of 1 m
    points: Float[Array, "path instant 2"]


@lru_cache(maxsize=2)
def arm_of(name: str, settings: str) -> Arm:
    """Return an arm, loaded once in each process."""
    return load_arm(name, json.loads(settings))


def mapped(one: Try) -> PostureMap:
    """Return the map of postures of a placement."""
    return posture_map(arm_of(one.name, one.settings), one.bench, one.side, one.bench.side_m * one.tallest_m)


def judge(one: Try) -> dict[str, Any]:
    """Return the placement with the shares of demonstrations that are executed and that fail, by name."""
    worst = mapped(one).worst(one.points)
    bench = one.bench
    row = {"arm": one.name, "side_m": bench.side_m, "base_x_m": bench.base_x, "base_y_m": bench.base_y}
    return row | {FAILURES[status] or "executed": float((worst == status).mean()) for status in range(4)}


def place(
    name: str, settings: Mapping[str, Any], study: Any, z_theta: Float[Array, "path 2"], tallest_m: float, workers: int
) -> tuple[Bench, PostureMap, pd.DataFrame]:
    """Return the placement of one arm, its fine map of postures, and a row for each placement tried.

    z_theta: the demonstrations that judge it, those left out that cross the table's edge. Sizes are tried from the
    largest down to the first at which some base executes every demonstration, and the base is the first such one. If
    there is no such size, the placement that executes most. Raise InputError if that is none, and name the start of
    all paths if that is out of reach.
    """
    points = minimum_jerk(z_theta, study.instants)
    points = points[(np.abs(points - 0.5) <= 0.5).all((1, 2))]
    text, tried, placed = json.dumps(settings), [], []
    for side_m in sorted(settings["side_m"], reverse=True):
        jobs = [
            Try(name, text, _bench(settings, study, side_m, x, y), study.coarse, tallest_m, points)
            for x, y in product(settings["base_x"], settings["base_y_m"])
        ]
        rows = map_jobs(judge, jobs, workers, f"{name} at a table of {side_m:g} m")
        tried += rows
        placed += jobs
        if any(row["executed"] == 1 for row in rows):
            break
    best = int(np.argmax([row["executed"] for row in tried]))
    if tried[best]["executed"] == 0:
        start = int(mapped(placed[best]).worst(P_INIT[None, None])[0])
        why = FAILURES[start] or max(FAILURES[1:4], key=lambda failure: tried[best][failure])
        start_at = f"cannot reach the start of all paths, ({P_INIT[0]:g}, {P_INIT[1]:g}) of the table's side,"
        what = "executes no demonstration" if start == FREE else start_at
        raise InputError(
            f"{name} {what} on any table of studies.execution.arms.{name}.side_m ({why}): "
            "move its base (base_x, base_y_m) or list a smaller table"
        )
    chosen = replace(placed[best], side=study.lattice)
    return chosen.bench, mapped(chosen), pd.DataFrame(tried).assign(chosen=np.arange(len(tried)) == best)


def _bench(settings: Mapping[str, Any], study: Any, side_m: float, x: float, y: float) -> Bench:
    return Bench(side_m, x * side_m, y, settings["turn_deg"], settings["height_m"], study.grip_m)
