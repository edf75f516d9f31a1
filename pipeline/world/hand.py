"""Recordings of a hand that moves an object across the table: simulated ones, and the check every one must pass.

A recording is an array (sample, 4) of t [s], x, y, z [m]; z is the height, which carries no information
(Section "Dataset" of the paper: kinesthetic demonstrations in the plane above the table).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT, curve
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, line_clearance, slack

FINE = 513  # points that stand for the intended path when its arc length is measured

SHORTEST_S, LONGEST_S = 0.2, 60.0  # of one movement across the table
BEYOND_M = 0.5  # how far beyond the table's edge a hand may go


@dataclass(frozen=True)
class Hand:
    """How a person moves an arm that gives way, and how the arm is sampled (conf/demos)."""

    rate_hz: float  # samples per second
    jitter_s: float  # standard deviation of the sampling instants
    speed_m_s: float  # median of the mean speeds along the path
    speed_spread: float  # standard deviation of the log of the mean speed, from movement to movement
    tremor_m: float  # root mean square of the tremor in each coordinate
    tremor_hz: tuple[float, float]  # band of physiological tremor
    drift_m: float  # standard deviation of the slowest deviation from the intended path, in each coordinate
    height_m: float  # where the object is held above the table
    height_drift_m: float  # how far that height wanders

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Hand":
        """The hand from `demos.hand` of conf/."""
        low, high = values["tremor_hz"]
        numbers = {name: float(value) for name, value in values.items() if name != "tremor_hz"}
        return cls(**numbers, tremor_hz=(float(low), float(high)))


def simulate(rng: np.random.Generator, z_theta: Float[Array, "2"], hand: Hand) -> Float[Array, "sample 4"]:
    """One recording of a hand that means to follow the Bezier path of `z_theta` [m].

    The speed along the arc is the minimum-jerk profile of Flash and Hogan (1985); the duration follows from the
    length and the person's speed. AddedItems are tremor and a slow drift; the drift vanishes at both ends.
    """
    path = curve(z_theta, FINE)
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    duration = passed[-1] / (hand.speed_m_s * np.exp(hand.speed_spread * rng.standard_normal()))
    t = _instants(rng, duration, hand)
    tau = t / t[-1]
    s = passed[-1] * tau**3 * (10 - 15 * tau + 6 * tau**2)
    xy = np.stack([np.interp(s, passed, path[:, i]) for i in (0, 1)], axis=-1)
    xy += _drift(rng, tau, hand.drift_m) + _tremor(rng, t, 2, hand)
    height = hand.height_m + _wander(rng, tau, hand.height_drift_m) + _tremor(rng, t, 1, hand)
    return np.concatenate([t[:, None], xy, height], axis=1)


def _instants(rng: np.random.Generator, duration: float, hand: Hand) -> Float[Array, " sample"]:
    """Sampling instants from 0 to `duration` [s], jittered by less than half a period so that time goes forward."""
    count = max(3, round(duration * hand.rate_hz) + 1)
    t, step = np.linspace(0.0, duration, count, retstep=True)
    jitter = hand.jitter_s * rng.standard_normal(count - 2)
    t[1:-1] += np.clip(jitter, -0.45 * step, 0.45 * step)
    return t


def _tremor(rng: np.random.Generator, t: Float[Array, " sample"], axes: int, hand: Hand) -> Float[Array, "sample axis"]:
    """Sum of six sinusoids within the band, of random frequencies, phases and weights [m]."""
    frequency = rng.uniform(*hand.tremor_hz, (6, axes))
    phase = rng.uniform(0.0, 2 * np.pi, (6, axes))
    weight = rng.standard_normal((6, axes)) / np.sqrt(3)  # the sinusoid's own mean square is 1/2
    waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase)  # (sample, wave, axis)
    return hand.tremor_m * (weight * waves).sum(1)


def _drift(rng: np.random.Generator, tau: Float[Array, " sample"], size_m: float) -> Float[Array, "sample 2"]:
    """Slow deviation [m] from the intended path, zero at both ends: three half waves, the k-th 1/k as strong."""
    k = np.arange(1, 4)
    weight = size_m * rng.standard_normal((3, 2)) / k[:, None]
    return np.sin(np.pi * k * tau[:, None]) @ weight


def _wander(rng: np.random.Generator, tau: Float[Array, " sample"], size_m: float) -> Float[Array, "sample 1"]:
    """Slow wander of the height [m], free at both ends, and drawn without regard to the path."""
    k = np.arange(1, 4)
    weight, phase = size_m * rng.standard_normal((3, 1)) / k[:, None], rng.uniform(0, 2 * np.pi, 3)
    return np.sin(np.pi * k * tau[:, None] + phase) @ weight


def check(recording: Array, name: str, ends_within_m: float) -> None:
    """Raise InputError, with the recording's `name`, unless it is one the fit can use.

    Needs (sample, 4) finite numbers t [s], x, y, z [m]; 3 samples or more; time that goes forward, for SHORTEST_S to
    LONGEST_S; its first and last point within `ends_within_m` [m] of p_init and p_f, because the fitted path's ends
    are fixed there; and every point within BEYOND_M of the table.
    """

    def need(holds: bool, got: str, expected: str) -> None:
        if not holds:
            raise InputError(f"recording {name}: {got}; expected {expected}; correct the recording or leave it out")

    shape, kind = np.shape(recording), np.asarray(recording).dtype.kind
    need(kind in "fiu", f"holds values of type {np.asarray(recording).dtype}", "numbers")
    need(len(shape) == 2 and shape[1] == 4, f"has shape {shape}", "(samples, 4): t [s], x, y, z [m]")
    need(shape[0] >= 3, f"has {shape[0]} samples", "at least 3")
    odd = np.argwhere(~np.isfinite(recording))
    if len(odd):
        row, column = odd[0]
        need(False, f"sample {row} has {'txyz'[column]} = {recording[row, column]}", "finite numbers")
    late = np.flatnonzero(np.diff(recording[:, 0]) <= 0)
    if len(late):
        t0, t1 = recording[late[0] : late[0] + 2, 0]
        need(
            False,
            f"time goes from {t0:g} to {t1:g} s at sample {late[0] + 1}",
            "increasing times, and one recording for each (seed, user, scene, demo)",
        )
    lasts = float(recording[-1, 0] - recording[0, 0])
    seconds = f"{SHORTEST_S:g} to {LONGEST_S:g} s; times are in seconds"
    need(SHORTEST_S <= lasts <= LONGEST_S, f"takes {lasts:g} s", seconds)
    for which, point, end in (("starts", recording[0, 1:3], P_INIT), ("ends", recording[-1, 1:3], P_F)):
        away = float(np.linalg.norm(point - end))
        place = f"within {ends_within_m:g} m of ({end[0]:g}, {end[1]:g}) m"
        need(
            away <= ends_within_m, f"{which} {away:.3g} m away from the task's end", f"{place}; positions are in metres"
        )
    beyond = np.maximum(-recording[:, 1:3], recording[:, 1:3] - 1).max(1)
    worst = int(beyond.argmax())
    place = f"all of it at most {BEYOND_M:g} m beyond the table, 0 to 1 m in x and y; positions are in metres"
    x, y = recording[worst, 1:3]
    need(bool(beyond[worst] <= BEYOND_M), f"is at ({x:g}, {y:g}) m at sample {worst}", place)


def join(recordings: Sequence[Float[Array, "_ 4"]]) -> tuple[Float[Array, "total 4"], Int[Array, " bound"]]:
    """Recordings one after the other, and the offsets at which each begins."""
    offsets = np.concatenate([[0], np.cumsum([len(r) for r in recordings])]).astype(np.int64)
    return np.concatenate(recordings) if len(recordings) else np.empty((0, 4)), offsets


def polylines(samples: Float[Array, "total 4"], offsets: Int[Array, " bound"]) -> Float[Array, "recording point 2"]:
    """The recorded lines as points [m]; those of shorter recordings end in their last one again and again."""
    place = np.minimum(np.arange(np.diff(offsets).max()), np.diff(offsets)[:, None] - 1)  # (recording, point)
    return samples[offsets[:-1, None] + place, 1:3]


def keeps(
    layouts: Layouts, samples: Float[Array, "total 4"], offsets: Int[Array, " bound"], margins: Margins
) -> Bool[Array, "scene demo"]:
    """Whether each recorded line keeps a user's margins [m]: as many recordings in every scene, scene by scene."""
    lines = polylines(samples, offsets)
    lines = lines.reshape(len(layouts), -1, *lines.shape[1:])  # (scene, demo, point, 2)
    return slack(layouts, line_clearance(layouts, lines), margins) > 0
