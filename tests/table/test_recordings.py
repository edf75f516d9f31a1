"""Simulated hands move as hands do, and no unusable recording gets past the door."""

import numpy as np
import pytest

from pipeline.table.bezier import P_F, P_INIT, curve, random_z_theta
from pipeline.table.layout import SYMBOLS, Layouts
from pipeline.table.recordings import Hand, check, join, keeps, polylines, simulate

HAND = Hand(50.0, 0.002, 0.35, 0.2, 0.0007, (8.0, 12.0), 0.002, 0.1, 0.01)
STEADY = Hand(50.0, 0.0, 0.35, 0.0, 0.0, (8.0, 12.0), 0.0, 0.1, 0.0)
WITHIN = 0.03  # [m]


def recordings(count: int, hand: Hand = HAND) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [simulate(rng, z, hand) for z in random_z_theta(rng, count)]


def good() -> np.ndarray:
    return simulate(np.random.default_rng(0), np.array([0.2, 0.7]), HAND)


def test_every_simulated_recording_passes_the_check():
    for i, recording in enumerate(recordings(200)):
        check(recording, str(i), WITHIN)


def test_recordings_vary_in_length_and_are_sampled_at_about_50_hz():
    made = recordings(200)
    assert len({len(r) for r in made}) > 50
    steps = np.concatenate([np.diff(r[:, 0]) for r in made])
    assert abs(steps.mean() - 0.02) < 2e-4
    assert 0.002 < steps.std() < 0.004  # two jittered instants a step


def test_a_steady_hand_follows_the_arc_with_minimum_jerk():
    z = np.array([0.1, 0.9])
    t, x, y, _ = simulate(np.random.default_rng(0), z, STEADY).T
    passed = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    tau = t / t[-1]
    np.testing.assert_allclose(passed / passed[-1], 10 * tau**3 - 15 * tau**4 + 6 * tau**5, atol=1e-3)
    assert passed[-1] / t[-1] == pytest.approx(STEADY.speed_m_s, rel=1e-3)
    path = curve(z, 2000)
    gaps = np.linalg.norm(np.stack([x, y], -1)[:, None] - path, axis=-1).min(1)
    assert gaps.max() < 5e-4


def test_tremor_lies_in_its_band_and_has_its_size():
    still = Hand(50.0, 0.0, 0.35, 0.2, 0.0007, (8.0, 12.0), 0.0, 0.1, 0.0)
    made = recordings(300, still)
    heights = np.concatenate([r[:, 3] - 0.1 for r in made])
    assert heights.std() == pytest.approx(0.0007, rel=0.1)
    power = np.zeros(26)
    for r in made:
        spectrum = np.abs(np.fft.rfft((r[:, 3] - 0.1) * np.hanning(len(r)), 500)) ** 2
        frequency = np.fft.rfftfreq(500, 1 / 50)
        power += np.bincount(np.round(frequency).astype(int), spectrum, 26)
    assert power[7:14].sum() / power.sum() > 0.95


def test_drift_vanishes_at_both_ends():
    drifting = Hand(50.0, 0.0, 0.35, 0.2, 0.0, (8.0, 12.0), 0.01, 0.1, 0.0)
    for r in recordings(20, drifting):
        np.testing.assert_allclose(r[0, 1:3], P_INIT, atol=1e-12)
        np.testing.assert_allclose(r[-1, 1:3], P_F, atol=1e-12)


def test_the_height_says_nothing_about_the_path():
    rng = np.random.default_rng(5)
    z = random_z_theta(rng, 400)
    mean = [simulate(rng, one, HAND)[:, 3].mean() for one in z]
    assert all(abs(np.corrcoef(mean, z[:, i])[0, 1]) < 0.15 for i in (0, 1))  # three standard errors


def with_value(row: int, column: int, value: float) -> np.ndarray:
    recording = good()
    recording[row, column] = value
    return recording


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (with_value(7, 1, np.nan), r"sample 7 has x = nan"),
        (with_value(0, 3, np.inf), r"sample 0 has z = inf"),
        (good()[:2], r"has 2 samples; expected at least 3"),
        (np.empty((0, 4)), r"has 0 samples"),
        (with_value(5, 0, 0.0), r"time goes from .* to 0 s at sample 5"),
        (np.repeat(good(), 2, axis=0), r"time goes from 0 to 0 s at sample 1"),
        (good()[:, :3], r"has shape \(\d+, 3\); expected \(samples, 4\)"),
        (good()[:, 0], r"has shape"),
        (good().astype(str), r"holds values of type <U"),
        (good() * [1000, 1, 1, 1], r"takes [\d.]+ s; expected 0.2 to 60 s; times are in seconds"),
        (good() * [0.001, 1, 1, 1], r"takes [\d.]+ s; expected 0.2 to 60 s; times are in seconds"),
        (
            with_value(7, 1, 5.0),
            r"is at \(5, [\d.]+\) m at sample 7; expected all of it at most 0.5 m beyond",
        ),
        (with_value(7, 2, -0.6), r"is at \([\d.]+, -0.6\) m at sample 7; expected all of it at most 0.5 m beyond"),
        (good()[40:], r"starts .* m away from the task's end; expected within 0.03 m of \(0.08, 0.08\)"),
        (good()[:-60], r"ends .* m away from the task's end; expected within 0.03 m of \(0.92, 0.92\)"),
    ],
)
def test_an_unusable_recording_ends_with_one_message_that_names_it(recording: np.ndarray, says: str):
    with pytest.raises(ValueError, match=rf"^recording demo 3: {says}") as caught:
        check(recording, "demo 3", WITHIN)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "change", [{"rate_hz": 0.0}, {"speed_m_s": -1.0}, {"tremor_m": -0.1}, {"tremor_hz": (8.0, 30.0)}]
)
def test_a_hand_out_of_range_is_refused(change: dict):
    with pytest.raises(ValueError, match=f"demos.hand.{next(iter(change))}"):
        Hand(**{**vars(HAND), **change})


def test_polylines_pass_through_every_sample_and_end_with_the_last():
    made = recordings(5)
    samples, offsets = join(made)
    lines = polylines(samples, offsets, between=3)
    for line, r in zip(lines, made, strict=True):
        np.testing.assert_allclose(line[: 4 * len(r) : 4][: len(r)], r[:, 1:3], atol=1e-12)
        np.testing.assert_allclose(line[4 * len(r) - 3 :], np.broadcast_to(r[-1, 1:3], line[4 * len(r) - 3 :].shape))


def test_a_line_keeps_a_user_s_margins_if_it_passes_far_enough_from_what_the_user_cares_about():
    made = [simulate(np.random.default_rng(0), np.array(z), STEADY) for z in ([0.5, 0.5], [-0.2, 1.2])]
    zero = np.zeros((2, 1))
    glass = np.full((2, 1), SYMBOLS.index("glass"))
    tables = Layouts(glass, glass, np.full((2, 1, 2), 0.5), zero, zero + 1, zero, zero + 0.05)  # one in the middle
    nothing: dict[str, float | None] = dict.fromkeys(SYMBOLS)
    samples, offsets = join([*made, *made])  # straight through and far around, in both scenes
    np.testing.assert_array_equal(keeps(tables, samples, offsets, nothing | {"glass": 0.04}), [[False, True]] * 2)
    assert keeps(tables, samples, offsets, nothing).all()


def test_a_hand_is_read_from_its_settings():
    settings = {**vars(HAND), "tremor_hz": [8, 12], "rate_hz": 50}
    assert Hand.of(settings) == HAND
