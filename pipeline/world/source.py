"""Draw what the render seed of a scene decides: light, sensor noise and where the table top lies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray as Array

from pipeline.world.layout import SIDE

Range = tuple[float, float]  # the least and the greatest value; the render seed draws one, uniformly


@dataclass(frozen=True)
class ImageSource:
    """Ranges that the render seed draws from; the defaults are those of conf/scenes.yaml."""

    exposure: Range = (0.86, 1.08)
    white_balance: float = 0.025
    fall_off: Range = (0.02, 0.12)
    vignette: Range = (0.02, 0.10)
    noise: Range = (0.006, 0.016)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "ImageSource":
        """Return the source in `scenes.source` of the parameters."""
        plain: dict[str, Any] = {
            name: tuple(map(float, v)) if isinstance(v, Sequence) else float(v) for name, v in values.items()
        }
        return cls(**plain)


DRAWN = ImageSource()


@dataclass(frozen=True)
class Light:
    """Everything that the render seed decides about a scene: the table top's offset, the light and the noise."""

    offset: Float[Array, "2"]  # of the texture [texture widths]
    rotation: float  # rotation of the texture [rad]
    direction: Float[Array, "2"]  # unit vector on the table towards the lamp
    gain: Float32[Array, "3"]  # brightness and tint per channel
    fall_off: float  # share of brightness lost from the lit edge of the table to the opposite one
    vignette: float  # share of brightness lost in the corners
    noise: Float32[Array, "side side 3"]  # sensor noise [1 = white]


def draw_light(seed: int, source: ImageSource = DRAWN) -> Light:
    """Draw the light and the table top's offset of the scene with render seed `seed`."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-np.pi, np.pi)
    offset, rotation = rng.uniform(0.0, 1.0, 2), rng.uniform(-np.pi, np.pi)
    gain = rng.uniform(*source.exposure) * rng.normal(1.0, source.white_balance, 3)
    fall_off, vignette = rng.uniform(*source.fall_off), rng.uniform(*source.vignette)
    noise = rng.standard_normal((SIDE, SIDE, 3), np.float32) * np.float32(rng.uniform(*source.noise))
    direction = np.array([np.cos(bearing), np.sin(bearing)])
    return Light(offset, rotation, direction, gain.astype(np.float32), fall_off, vignette, noise)
