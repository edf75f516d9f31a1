"""How much data a model needs: the least at which its accuracy reaches a threshold."""

from collections.abc import Mapping


def reaches(accuracy: Mapping[int, float], threshold: float) -> int | None:
    """The smallest amount of data whose accuracy is at least `threshold`; None if none's is."""
    return min((amount for amount, value in accuracy.items() if value >= threshold), default=None)
