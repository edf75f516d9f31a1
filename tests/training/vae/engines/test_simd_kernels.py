"""Facts about the kernels' sigmoid, the one function they compute themselves."""

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from scipy.special import expit

from pipeline.training.vae.engines import simd_kernels as lanes


@intrinsic
def in_place(typingctx, array, index):
    """The index-th vector of `array` becomes its sigmoid."""

    def generate(context, builder, sig, args):
        pointer = lanes._pointer(context, builder, array, *args)
        builder.store(lanes._sigmoid(builder, lanes._load(builder, pointer)), pointer).align = 4
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


@njit
def each_vector(x):
    for i in range(x.size // lanes.LANES):
        in_place(x, i)  # pyright: ignore[reportCallIssue]


def sigmoid(x: np.ndarray) -> np.ndarray:
    y = x.copy()
    each_vector(y)
    return y


def test_sigmoid_is_within_3_units_in_the_last_place():
    drawn = np.random.default_rng(0).integers(0, 2**32, 2**20, dtype=np.uint32).view(np.float32)  # any bits
    x = np.concatenate([np.linspace(-87, 87, 2**21, dtype=np.float32), np.where(np.abs(drawn) <= 87, drawn, 0)])
    exact = expit(x.astype(np.float64))
    assert (np.abs(sigmoid(x) - exact) / np.spacing(exact.astype(np.float32))).max() < 3


def test_beyond_87_sigmoid_stays_as_it_is_there_and_nan_passes_through():
    x = np.array([np.nan, -np.nan, np.inf, 88, -87, -88, -1e30, -np.inf], np.float32)
    y = sigmoid(x)
    assert np.isnan(y[:2]).all() and (y[2:4] == 1).all()
    assert 0 < y[4] < 2e-38 and (y[5:] == y[4]).all()
