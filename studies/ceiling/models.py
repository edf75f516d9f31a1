"""What a perfect encoder gives the paper's classifier: the truth about each item."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE
from pipeline.world.layout import SYMBOLS, Layouts

LENGTH_UNIT_M = 0.1  # unit of an item's size in its code [m]


def true_code(layouts: Layouts, slots: int) -> Float[Array, "scene number"]:
    """Return what a perfect encoder knows of each scene: position, size, direction and symbol of each item.

    Numbers of an empty slot are 0. A direction is that of a segment without sign, so it is given by twice its angle.
    """
    x, y = np.moveaxis((layouts.centre - Z_CENTRE) / Z_SCALE, -1, 0)
    twice = layouts.half_length / LENGTH_UNIT_M * np.exp(2j * layouts.angle)
    symbol = layouts.symbol[..., None] == np.arange(len(SYMBOLS))
    numbers = [x, y, layouts.radius / LENGTH_UNIT_M, twice.real, twice.imag, *np.moveaxis(symbol, -1, 0)]
    code = np.where(layouts.present[..., None], np.stack(numbers, -1), 0.0)[:, :slots]
    return code.reshape(len(layouts), -1)
