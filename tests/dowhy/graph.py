"""Shared by both checks: a mechanism of the pipeline as dowhy takes it, and a printed comparison."""

import numpy as np
from dowhy.gcm.causal_mechanisms import FunctionalCausalModel


class Mechanism(FunctionalCausalModel):
    """A given mechanism for dowhy; parents come as columns in alphabetical order."""

    def __init__(self, assign, draw):
        self.assign, self.draw = assign, draw

    def fit(self, X, Y):
        """Do nothing: the mechanism is given."""

    def draw_noise_samples(self, num_samples):
        return self.draw(num_samples)

    def evaluate(self, parent_samples, noise_samples):
        return self.assign(noise_samples.ravel(), *np.asarray(parent_samples, dtype=float).T)

    def clone(self):
        return Mechanism(self.assign, self.draw)


def same(what: str, ours: float, theirs: float, limit: float) -> bool:
    """Print both numbers and return whether they lie within `limit` of each other."""
    agree = bool(abs(ours - theirs) <= limit)
    word = "same" if agree else "DIFFERENT"
    print(f"{word:10}{what}: {ours:.4f} by the pipeline, {theirs:.4f} by dowhy (within {limit:.4f})")
    return agree
