"""The empty table: its colour over the image, and how much it varies."""

import torch
from jaxtyping import Float
from torch import Tensor

TABLE_SHARE = 0.85  # of the pixels, at least, show the table
FLOOR = 0.004  # smallest spread of the table's colour [1 = white], that of a grey level


def subtract_background(
    images: Float[Tensor, "scene 3 100 100"],
) -> tuple[Float[Tensor, "scene 3 100 100"], Float[Tensor, "scene 3 3"]]:
    """How each pixel's colour differs from the table's there, and the matrix that whitens the table's own variation.

    The table's colour is a quadratic in the pixel's place, since light falls off smoothly, fitted to the pixels that
    differ least; every third row and column says enough.
    """
    sample = images[..., ::3, ::3]
    colours = sample.flatten(2).mT  # (scene, pixel, 3)
    place = _quadratic(images.shape[-1]).to(colours)  # (row, column, 6)
    seen = place[::3, ::3].flatten(0, 1)  # (pixel, 6)
    left = colours - colours.median(1, keepdim=True).values
    surface = torch.zeros(len(images), 6, 3).to(colours)
    for _ in range(2):
        weighted = seen * _nearest(left)
        surface = torch.linalg.solve(weighted.mT @ seen, weighted.mT @ colours)  # (scene, 6, 3)
        left = colours - seen @ surface
    table = _nearest(left)
    covariance = (left * table).mT @ left / table.sum(1, keepdim=True) + FLOOR**2 * torch.eye(3).to(colours)
    values, vectors = torch.linalg.eigh(covariance)
    whitening = vectors / values.sqrt()[:, None] @ vectors.mT  # symmetric: colours keep their meaning
    return images - (place.flatten(0, 1) @ surface).mT.unflatten(-1, images.shape[-2:]), whitening


def _nearest(plain: Float[Tensor, "scene pixel 3"]) -> Float[Tensor, "scene pixel 1"]:
    """1 at the TABLE_SHARE of the pixels that differ least from the table."""
    distance = plain.norm(dim=-1)
    return (distance <= distance.quantile(TABLE_SHARE, dim=-1, keepdim=True)).to(plain)[..., None]


def _quadratic(side: int) -> Float[Tensor, "row column 6"]:
    """1, x, y, xy, x^2, y^2 at every pixel, x and y from -1 to 1."""
    axis = torch.linspace(-1, 1, side)
    y, x = torch.meshgrid(axis, axis, indexing="ij")
    return torch.stack([torch.ones_like(x), x, y, x * y, x * x, y * y], dim=-1)
