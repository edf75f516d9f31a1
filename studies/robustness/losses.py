"""How well paths are judged, and what a change of the pictures, tables or labels takes from that."""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.causal.interventions import DIGITS
from pipeline.stats.crossed import Estimates, estimate, linearised, quartiles, ratio

Accepted = Bool[Array, "user seed scene path"]  # whether a model calls each path valid
Valid = Bool[Array, "user scene path"]  # whether it is


def score(accepted: Accepted, valid: Valid) -> dict:
    """Accuracy, its mean and quartiles over seeds, and each user's; and how the wrong answers divide.

    `false_rejects`: share of the valid paths that is rejected; `false_accepts`: of the invalid ones that is accepted,
    `false_accepts_ci` its 95 % interval over seeds crossed with scenes; None where there is no such path.
    """
    right = (accepted == valid[:, None]).mean((2, 3))  # (user, seed)
    return {
        "accuracy": {name: round(value, DIGITS) for name, value in quartiles(right.mean(0)).items()},
        "by_user": [round(float(share), DIGITS) for share in right.mean(1)],
        "false_rejects": _share(~accepted, valid),
        "false_accepts": _share(accepted, ~valid),
        "false_accepts_ci": _interval(accepted, valid),
    }


def kept(accepted: Accepted, valid: Valid, familiar: Bool[Array, "seed scene"]) -> dict[str, float | None]:
    """What abstaining in pictures that are not `familiar` would leave of what is accepted.

    `false_accepts` and `accepted` are shares of all invalid and of all valid paths, those abstained from among them.
    """
    still = accepted & familiar[None, :, :, None]
    refused = _share(~still, valid)
    return {"false_accepts": _share(still, ~valid), "accepted": None if refused is None else round(1 - refused, DIGITS)}


def _share(wrong: Accepted, among: Valid) -> float | None:
    """Share of the paths `among` that is `wrong`, over all users, seeds and scenes."""
    if not among.any():
        return None
    counted = (wrong & among[:, None]).sum() / (among.sum() * wrong.shape[1])
    return round(float(counted), DIGITS)


def _interval(accepted: Accepted, valid: Valid) -> list[float] | None:
    """Of the share of the invalid paths that is accepted."""
    if valid.all():
        return None
    e = ratio(*(x[None] for x in _false_accepts(accepted, valid)))
    return [round(float(np.clip(bound[0], 0, 1)), DIGITS) for bound in (e.ci_low, e.ci_high)]


def _false_accepts(accepted: Accepted, valid: Valid) -> tuple[Float[Array, "seed scene"], Float[Array, "seed scene"]]:
    """How many invalid paths are accepted, and of how many."""
    parts = (accepted & ~valid[:, None]).sum((0, 3)).astype(float)
    return parts, np.broadcast_to((~valid).sum((0, 2)), parts.shape).astype(float)


def change(accepted: Accepted, valid: Valid, accepted_before: Accepted, valid_before: Valid) -> dict[str, float]:
    """What is added to accuracy, the users' mean, with a 95 % interval over seeds crossed with scenes."""
    after, before = _right(accepted, valid), _right(accepted_before, valid_before)
    e = estimate((after - before)[None])
    return _numbers(e)


def more_accepted(
    accepted: Accepted, valid: Valid, accepted_before: Accepted, valid_before: Valid
) -> dict[str, float] | None:
    """What is added to the share of the invalid paths that is accepted, with a 95 % interval; None without such paths.

    The same seeds and scenes before and after: their difference, each share linearised as in `statistics.ratio`.
    """
    if valid.all() or valid_before.all():
        return None
    after, before = _linearised(accepted, valid), _linearised(accepted_before, valid_before)
    return _numbers(estimate((after - before)[None]))


def _linearised(accepted: Accepted, valid: Valid) -> Float[Array, "seed scene"]:
    parts, wholes = _false_accepts(accepted, valid)
    return linearised(parts[None], wholes[None])[0]


def _numbers(e: Estimates) -> dict[str, float]:
    numbers = {"difference": e.effect, "ci_low": e.ci_low, "ci_high": e.ci_high}
    return {name: round(float(value[0]), DIGITS) + 0.0 for name, value in numbers.items()}


def _right(accepted: Accepted, valid: Valid) -> Float[Array, "seed scene"]:
    """Share of the paths rightly judged, the users' mean."""
    return (accepted == valid[:, None]).mean((0, 3))
