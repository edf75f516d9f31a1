"""Cut what a log recorded into demonstrations, and bring its positions to metres on the table."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from pydantic import BaseModel, ConfigDict, FiniteFloat

from pipeline.own.demonstrations import thinned
from pipeline.runtime.errors import InputError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
USUAL_SPAN_M, SPANS_M = 0.7, (0.05, 10.0)  # of the paths on a table; what is outside is no table in that unit
NEAR = 0.25  # a way back starts and ends so near to the other's end and start, relative to their distance
REST_M, REST_S = 0.005, 0.5  # a hand rests where it stays within this distance for this long
GRID_S = 0.05  # steps of the search for rests
GAP_S = 1.0  # a longer step in time ends a demonstration
MIN_PATH_M = 0.1  # shorter movements are left out
MIN_STEP_S = 0.02  # between rows of a demonstration: robots report up to a thousand a second


class Choices(BaseModel):
    """Hold how a log is read, `import` in table.yaml; docs/import.md says what each is. None: open, or not needed."""

    model_config = ConfigDict(extra="forbid")

    topic: str | None = None
    hand: str | None = None
    frame: str | None = None
    columns: dict[str, str] | None = None
    delimiter: str | None = None
    decimal: Literal[".", ","] | None = None
    time: Literal["s", "ms", "us", "ns"] | None = None
    picture: str | None = None
    gripper: str | None = None
    label: str | None = None
    closed: Literal["high", "low"] | None = None
    segments: Literal["whole", "gripper", "stops", "moves"] | None = None
    unit: Literal["m", "cm", "mm"] | None = None
    y: Literal["up", "down"] | None = None
    origin: tuple[FiniteFloat, FiniteFloat] = (0.0, 0.0)
    turn_deg: FiniteFloat = 0.0

    @property
    def named(self) -> dict[str, str]:
        """Return the columns that are chosen, by what they hold."""
        by_option = {"gripper": self.gripper, "valid": self.label}
        return {**(self.columns or {}), **{role: name for role, name in by_option.items() if name}}


@dataclass(frozen=True)
class Recording:
    """Hold a hand's movement as a log has it, in one piece."""

    name: str
    t: Float[Array, " n"]  # [s]
    places: Float[Array, "n 2"]  # in the log's unit
    gripper: Float[Array, " n"] | None = None
    words: Sequence[tuple[int, str]] = ()  # labels, each after so many samples
    whole: bool = False  # the log says that it is one demonstration
    labels: dict[str, str] = field(default_factory=dict)  # scene, user, demo, as far as the log has them
    pictures: Callable[[Sequence[int]], Iterable[bytes | None]] = lambda rows: repeat(None, len(rows))  # png or jpeg


def check_times(recording: Recording) -> None:
    """Raise InputError where times go back, or mostly stand still."""
    for i in np.flatnonzero(np.diff(recording.t) < 0)[:1]:
        wrong = f"time goes back from {recording.t[i]:.9g} to {recording.t[i + 1]:.9g} s at sample {i + 2}"
        advice = "cut the log there, or add --columns demo=NAME"
        raise InputError(f"{recording.name}: {wrong}: expected times that increase; {advice}")
    if len(recording.t) > 1 and np.median(np.diff(recording.t)) == 0:
        raise InputError(f"{recording.name}: most samples have the time of the one before: choose other times")


def guess_unit(recordings: Sequence[Recording]) -> str:
    """Return m, cm or mm, whichever brings the paths' span nearest to USUAL_SPAN_M; InputError if none can be."""
    span = float(np.ptp(np.concatenate([recording.places for recording in recordings]), axis=0).max())
    possible = [unit for unit, metres in METRES.items() if SPANS_M[0] <= span * metres <= SPANS_M[1]]
    if not possible:
        ask = "choose others, or write `import: {unit: mm}` into table.yaml of the new folder"
        raise InputError(f"the positions span {span:.4g}, no path on a table in {', '.join(METRES)}: {ask}")
    return min(possible, key=lambda unit: abs(np.log(span * METRES[unit] / USUAL_SPAN_M)))


def on_table(places: Float[Array, "n 2"], choices: Choices, depth_m: float) -> Float[Array, "n 2"]:
    """Return metres on the table: scaled, moved to the table's corner, turned, and mirrored if y runs down."""
    angle = np.radians(choices.turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # from the table to the log
    metres = (places * METRES[choices.unit or "m"] - np.array(choices.origin)) @ turn
    return metres * [1, -1] + [0, depth_m] if choices.y == "down" else metres


def grip(recordings: Sequence[Recording]) -> tuple[float, str]:
    """Return the middle of a gripper's values, and on which side it is closed, as it is open at first.

    Raise InputError if it never moves.
    """
    values = np.concatenate([r.gripper for r in recordings if r.gripper is not None] or [np.empty(0)])
    values = values[np.isfinite(values)]
    if not len(values) or np.ptp(values) == 0:
        raise InputError("the gripper has the same value throughout, or none: expected one that opens and closes")
    middle = (values.min() + values.max()) / 2
    return float(middle), "low" if values[0] > middle else "high"


def cut(recording: Recording, metres: Float[Array, "n 2"], choices: Choices, middle: float) -> list[Array]:
    """Return the rows of each demonstration; metres: on the table; middle: of the gripper's values."""
    active = np.ones(len(metres), bool)
    if choices.segments == "gripper":
        values = np.full(len(metres), np.nan) if recording.gripper is None else recording.gripper
        active = values > middle if choices.closed == "high" else values < middle
    elif choices.segments in ("stops", "moves"):
        active = moving(recording.t, metres)
    split = (active[1:] != active[:-1]) | ((np.diff(recording.t) > GAP_S) & (not recording.whole))
    runs = np.split(np.arange(len(metres)), np.flatnonzero(split) + 1)
    return [
        rows[thinned(recording.t[rows], MIN_STEP_S)]
        for rows in runs
        if active[rows[0]] and np.linalg.norm(np.diff(metres[rows], axis=0), axis=1).sum() >= MIN_PATH_M
    ]


def without_ways_back(metres: Float[Array, "n 2"], runs: list[Array]) -> list[Array]:
    """Return the rows of those movements that do not lead from the end of the one before back to its start.

    After a movement that ended where it began, none is a way back.
    """
    kept = runs[:1]
    for rows in runs[1:]:
        before = metres[kept[-1][[0, -1]]]
        away = np.linalg.norm(metres[rows[[-1, 0]]] - before, axis=1).max()
        length = np.linalg.norm(before[1] - before[0])
        if length < MIN_PATH_M or away > NEAR * length:
            kept.append(rows)
    return kept


def moving(t: Float[Array, " n"], metres: Float[Array, "n 2"]) -> Bool[Array, " n"]:
    """Return where the hand does not stay within REST_M for REST_S; t: does not decrease."""
    active, window = np.ones(len(t), bool), round(REST_S / GRID_S) + 1
    for rows in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > GAP_S) + 1):
        grid = np.arange(float(t[rows[0]]), float(t[rows[-1]]) + GRID_S, GRID_S)
        if len(grid) >= window:
            places = np.stack([np.interp(grid, t[rows], metres[rows, axis]) for axis in (0, 1)])  # (2, time)
            windows = np.lib.stride_tricks.sliding_window_view(places, window, axis=1)  # (2, time, window)
            rests = (np.ptp(windows, axis=-1) <= REST_M).all(axis=0)
            active[rows] = np.interp(t[rows], grid, np.convolve(rests, np.ones(window)) > 0) < 1
    return active
