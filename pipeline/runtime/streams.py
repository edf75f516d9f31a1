"""Random streams, each from what names it: what another one draws, or how much, changes nothing in it."""

import hashlib

import numpy as np


def job_seed(*names: str | int) -> int:
    """A 63-bit seed of its own for whatever `names` name: e.g. (seed, user, n, variant)."""
    digest = hashlib.sha256("/".join(map(str, names)).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def stream(*names: str | int) -> np.random.Generator:
    """A generator of its own for whatever `names` name, a stage's root seed first."""
    return np.random.default_rng(job_seed(*names))
