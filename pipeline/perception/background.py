"""Estimate the empty table: its colour over the image and the variation of that colour."""

import torch
from jaxtyping import Float
from torch import Tensor

from pipeline.runtime.roots import square_root

MIN_TABLE_SHARE = 0.85  # share of the pixels assumed to show the table
MIN_COLOUR_STD = 0.004  # smallest standard deviation of the table's colour [1 = white]: one grey level
Pixels = Float[Tensor, "scene 3 100 100"]  # [1 = white]
STRIDE = 3  # the fit uses every third row and column


def subtract_background(images: Pixels) -> tuple[Pixels, Float[Tensor, "scene 3 3"]]:
    """Subtract the table's colour from each pixel; return the difference and the table's whitening matrix.

    The table's colour is a quadratic in the pixel's position, since light falls off smoothly. It is fitted to the
    pixels closest to it, MIN_TABLE_SHARE of all.
    """
    sample = images[..., ::STRIDE, ::STRIDE]
    colours = sample.flatten(2).mT  # (scene, pixel, 3)
    axis = torch.linspace(-1, 1, images.shape[-1])
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    place = torch.stack([torch.ones_like(x), x, y, x * y, x * x, y * y], dim=-1).to(colours)  # (row, column, 6)
    sampled_place = place[::STRIDE, ::STRIDE].flatten(0, 1)  # (pixel, 6)
    residual = colours - colours.median(1, keepdim=True).values
    surface = torch.zeros(len(images), 6, 3).to(colours)
    for _ in range(2):
        weighted = sampled_place * _is_table(residual)
        surface = torch.linalg.solve(weighted.mT @ sampled_place, weighted.mT @ colours)  # (scene, 6, 3)
        residual = colours - sampled_place @ surface
    table = _is_table(residual)
    floor = MIN_COLOUR_STD**2 * torch.eye(3).to(colours)
    covariance = (residual * table).mT @ residual / table.sum(1, keepdim=True) + floor
    values, vectors = torch.linalg.eigh(covariance)
    whitening = vectors / square_root(values)[:, None] @ vectors.mT  # symmetric, so that colours keep their meaning
    return images - (place.flatten(0, 1) @ surface).mT.unflatten(-1, images.shape[-2:]), whitening


def _is_table(residual: Float[Tensor, "scene pixel 3"]) -> Float[Tensor, "scene pixel 1"]:
    """Return 1 for the MIN_TABLE_SHARE of the pixels closest to the table's colour, 0 for the others."""
    distance = residual.norm(dim=-1)
    return (distance <= distance.quantile(MIN_TABLE_SHARE, dim=-1, keepdim=True)).to(residual)[..., None]
