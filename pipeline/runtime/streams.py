"""Random streams, each seeded by its own names: what one draws changes nothing in another."""

import hashlib

import numpy as np


def job_seed(*names: str | int) -> int:
    """Return a 63-bit seed that depends on `names` alone, e.g. (seed, user, n_demos, variant)."""
    digest = hashlib.sha256("/".join(map(str, names)).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def stream(*names: str | int) -> np.random.Generator:
    """Return a generator that depends on `names` alone, a stage's root seed first."""
    return np.random.default_rng(job_seed(*names))
