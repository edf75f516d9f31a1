"""Simulate hand trajectories across the table, and judge them.

A trajectory is an array (sample, 4) of t [s], x, y, z [m]. The height z carries no information, since all
demonstrations are made in a plane above the table (paper, Section "Dataset").
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.runtime.settings import Distance, Group, Pair, Size, Spread
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, line_clearance, slack

ARC_POINTS = 513  # points on a smooth path, enough for measuring its length


class Hand(Group):
    """Parameters of the simulated hand and of the arm's sampling (conf/demos.yaml)."""

    rate_hz: Size  # sampling rate
    jitter_s: Spread  # standard deviation of the sampling times
    speed_m_s: Size  # median over movements of the mean speed along the path
    speed_spread: Spread  # standard deviation over movements of the log of the mean speed
    tremor_m: Distance  # root mean square tremor per coordinate
    tremor_hz: Pair  # frequency band of physiological tremor
    drift_m: Distance  # standard deviation per coordinate of the slowest deviation from the intended path
    height_m: float  # mean height of the hand above the table
    height_drift_m: Distance  # standard deviation of the height's slow variation


def simulate(rng: np.random.Generator, path: Float[Array, "point 2"], hand: Hand) -> Float[Array, "sample 4"]:
    """Simulate a hand that follows a path, given by ARC_POINTS points or about as many [m]; return its trajectory.

    The speed profile along the arc has minimum jerk (Flash and Hogan, 1985). The duration is the path's length divided
    by a random mean speed. Tremor and a slow drift are added; the drift vanishes at both ends.
    """
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    duration = passed[-1] / (hand.speed_m_s * np.exp(hand.speed_spread * rng.standard_normal()))
    count = max(3, round(duration * hand.rate_hz) + 1)
    t, step = np.linspace(0.0, duration, count, retstep=True)
    jitter = hand.jitter_s * rng.standard_normal(count - 2)
    t[1:-1] += np.clip(jitter, -0.45 * step, 0.45 * step)  # by less than half a period, so that times increase
    tau = t / t[-1]
    s = passed[-1] * tau**3 * (10 - 15 * tau + 6 * tau**2)
    xy = np.stack([np.interp(s, passed, path[:, i]) for i in (0, 1)], axis=-1)
    xy += _drift(rng, tau, hand.drift_m, 2, tied=True) + _tremor(rng, t, 2, hand)
    height = hand.height_m + _drift(rng, tau, hand.height_drift_m, 1, tied=False) + _tremor(rng, t, 1, hand)
    return np.concatenate([t[:, None], xy, height], axis=1)


def _tremor(rng: np.random.Generator, t: Float[Array, " sample"], axes: int, hand: Hand) -> Float[Array, "sample axis"]:
    """Draw the tremor [m]: a sum of six sinusoids in the band with random frequencies, phases and weights."""
    frequency = rng.uniform(hand.tremor_hz[0], hand.tremor_hz[1], (6, axes))
    phase = rng.uniform(0.0, 2 * np.pi, (6, axes))
    weight = rng.standard_normal((6, axes)) / np.sqrt(3)  # a sinusoid's mean square is 1/2
    waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase)  # (sample, wave, axis)
    return hand.tremor_m * (weight * waves).sum(1)


def _drift(rng: np.random.Generator, tau: Array, size_m: float, axes: int, tied: bool) -> Float[Array, "sample axis"]:
    """Draw a slow deviation [m]: three half-waves with amplitudes ~ 1/k, zero at both ends if `tied`."""
    k = np.arange(1, 4)
    weight = size_m * rng.standard_normal((3, axes)) / k[:, None]
    phase = 0.0 if tied else rng.uniform(0, 2 * np.pi, 3)
    return np.sin(np.pi * k * tau[:, None] + phase) @ weight


def join(trajectories: Sequence[Float[Array, "_ 4"]]) -> tuple[Float[Array, "total 4"], Int[Array, " bound"]]:
    """Return the concatenated trajectories, and the offset of each one's first sample."""
    offsets = np.concatenate([[0], np.cumsum([len(t) for t in trajectories])]).astype(np.int64)
    return np.concatenate(trajectories) if len(trajectories) else np.empty((0, 4)), offsets


def valid_trajectories(
    layouts: Layouts, samples: Float[Array, "total 4"], offsets: Int[Array, " bound"], margins: Margins
) -> Bool[Array, "scene demo"]:
    """Return whether each recorded trajectory keeps the user's margins [m].

    Trajectories are ordered by scene, with the same number per scene.
    """
    counts = np.diff(offsets)
    place = np.minimum(np.arange(counts.max()), counts[:, None] - 1)  # shorter ones repeat their last point
    lines = samples[offsets[:-1, None] + place, 1:3].reshape(len(layouts), -1, place.shape[1], 2)
    return slack(layouts, line_clearance(layouts, lines), margins) > 0
