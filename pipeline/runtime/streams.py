"""Named random streams: draws from one stream do not affect another."""

import hashlib

import numpy as np


def job_seed(*names: str | int) -> int:
    """Return a 63-bit seed that depends only on `names`, e.g. (seed, user, n_demos, variant)."""
    digest = hashlib.sha256("/".join(map(str, names)).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def stream(*names: str | int) -> np.random.Generator:
    """Return a generator that depends only on `names`, the first of which is a stage's root seed."""
    return np.random.default_rng(job_seed(*names))
