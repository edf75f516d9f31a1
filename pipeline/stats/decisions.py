"""Accuracy of accept-or-reject decisions, and its loss under changed conditions."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.stats.crossed import Estimates, estimate, ratio
from pipeline.stats.scores import accuracy, auroc

Accepted = Bool[Array, "user seed scene path"]  # whether the model accepts the path
Valid = Bool[Array, "user scene path"]  # whether the path is truly valid
DIGITS = 9  # decimals of a loss, so that equal accuracies differ by exactly 0


def accuracy_by_seed(
    p: Float[Array, "user seed scene path"], valid: Valid, users: Sequence[str], seeds: Sequence[int]
) -> pd.DataFrame:
    """Return accuracy and auroc, one row per user and seed; auroc is NaN if all labels are equal."""
    rows = [
        (user, seed, accuracy(p[i, j].ravel(), valid[i].ravel()), auroc(p[i, j].ravel(), valid[i].ravel()))
        for i, user in enumerate(users)
        for j, seed in enumerate(seeds)
    ]
    return pd.DataFrame(rows, columns=["user", "seed", "accuracy", "auroc"])


def accuracy_estimate(accepted: Accepted, valid: Valid) -> dict[str, float]:
    """Return accuracy, averaged over users, and `unsafe`, the share of invalid paths that are accepted.

    Both have a 95 % interval over seeds crossed with scenes. If every path is valid, `unsafe` is NaN.
    """
    accuracy = _within_0_and_1(estimate((accepted == valid[:, None]).mean((0, 3))[None]))
    unsafe = [np.nan] * 3
    if not valid.all():
        parts = (accepted & ~valid[:, None]).sum((0, 3)).astype(float)  # (seed, scene)
        wholes = np.broadcast_to((~valid).sum((0, 2)), parts.shape).astype(float)
        unsafe = _within_0_and_1(ratio(parts[None], wholes[None]))
    names = ("accuracy", "ci_low", "ci_high", "unsafe", "unsafe_ci_low", "unsafe_ci_high")
    return dict(zip(names, [*accuracy, *unsafe], strict=True))


def _within_0_and_1(e: Estimates) -> list[float]:
    return [float(np.clip(x[0], 0, 1)) for x in (e.effect, e.ci_low, e.ci_high)]


def accuracy_loss(accepted: Accepted, valid: Valid, accepted_before: Accepted, valid_before: Valid) -> dict[str, float]:
    """Return the loss of accuracy, before minus after, with its 95 % interval: loss, loss_ci_low, loss_ci_high.

    Seeds and scenes are the same before and after, so the differences are paired.
    """
    before, after = accepted_before == valid_before[:, None], accepted == valid[:, None]
    e = estimate((before.mean((0, 3)) - after.mean((0, 3)))[None])
    losses = {"loss": e.effect, "loss_ci_low": e.ci_low, "loss_ci_high": e.ci_high}
    return {name: round(float(value[0]), DIGITS) + 0.0 for name, value in losses.items()}  # + 0.0 turns -0.0 into 0.0
