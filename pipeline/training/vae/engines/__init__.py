"""Three engines that fit the paper's model with the same gradients, behind one interface.

reference: one model at a time with torch. simd: one model per vector lane of the processor (Numba). cuda: all models at
once with torch on a GPU. Their results differ by rounding, which training amplifies.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import numpy as np
import torch

from pipeline.runtime.errors import InputError
from pipeline.training.loop import fit_sequentially


@dataclass(frozen=True)
class Engine:
    """An engine with `fit`(models, images, z_theta, valid, weights=, schedule=, seeds=, checkpoints=) -> curves."""

    name: str
    fit: Callable[..., list[np.ndarray]]
    batch_size: int  # models per call of `fit`
    device: str


def engine(name: str) -> Engine:
    """Return the engine called `name`; `auto`: cuda with a GPU, else simd with Numba, else reference.

    Raises InputError for an unknown name, and for simd without Numba.
    """
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "simd" if find_spec("numba") else "reference"
    if name not in ENGINES:
        raise InputError(f"engine {name!r}: expected one of auto, {', '.join(ENGINES)} (train.engine)")
    return ENGINES[name]()


def _reference() -> Engine:
    from pipeline.training.vae.engines.reference import fit

    return Engine("reference", partial(fit_sequentially, fit), 1, "cpu")


def _simd() -> Engine:
    if not find_spec("numba"):
        raise InputError("train.engine=simd needs Numba: install it, or choose train.engine=reference (slower)")
    from pipeline.training.vae.engines.simd import LANES, fit_stack  # compiles on first import

    return Engine("simd", fit_stack, LANES, "cpu")


def _cuda() -> Engine:
    from pipeline.training.vae.engines.cuda import BATCH_SIZE, device, fit_batch

    return Engine("cuda", fit_batch, BATCH_SIZE, str(device()))


ENGINES: dict[str, Callable[[], Engine]] = {"reference": _reference, "simd": _simd, "cuda": _cuda}
