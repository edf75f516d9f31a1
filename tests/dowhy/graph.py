"""What both checks share: a mechanism of ours as dowhy takes it, and a comparison that is printed."""

import numpy as np
from dowhy.gcm.causal_mechanisms import FunctionalCausalModel


class Mechanism(FunctionalCausalModel):
    """A mechanism of ours for dowhy: parents come in alphabetical order, as columns."""

    def __init__(self, assign, draw):
        self.assign, self.draw = assign, draw

    def fit(self, X, Y):
        """Nothing: it is given."""

    def draw_noise_samples(self, num_samples):
        return self.draw(num_samples)

    def evaluate(self, parent_samples, noise_samples):
        return self.assign(noise_samples.ravel(), *np.asarray(parent_samples, dtype=float).T)

    def clone(self):
        return Mechanism(self.assign, self.draw)


def said(what: str, ours: float, theirs: float, limit: float) -> bool:
    """Print both sides; whether they lie within `limit`."""
    fine = bool(abs(ours - theirs) <= limit)
    print(f"{'same' if fine else 'DIFFERENT':10}{what}: {ours:.4f} here, {theirs:.4f} there (within {limit:.4f})")
    return fine
