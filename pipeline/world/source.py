"""Draw what the render seed of a scene decides: light, camera and table top, in the ranges of conf/source/."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray as Array

from pipeline.world.layout import SIDE
from pipeline.world.paint import Top
from pipeline.world.patterns import CLOTHS, PATTERNS, folded

MAX_BRIGHTNESS = 0.85  # of a pattern, as of the catalogue's brightest textures [1 = white]
OPTICS = "shadow_length", "shadow_softness", "shadow_depth", "refraction", "caustic", "highlight", "glare", "parallax"
Range = tuple[float, float]  # the least and the greatest value; the render seed draws one, uniformly


@dataclass(frozen=True)
class ImageSource:
    """Ranges and chances that the render seed draws from, as in conf/source/; by default those of the drawn world."""

    exposure: Range = (0.86, 1.08)
    white_balance: float = 0.025
    fall_off: Range = (0.02, 0.12)
    vignette: Range = (0.02, 0.10)
    noise: Range = (0.006, 0.016)
    shadow_length: Range = (1.0, 1.0)
    shadow_softness: Range = (0.0, 0.0)
    shadow_depth: Range = (1.0, 1.0)
    refraction: Range = (0.0, 0.0)
    caustic: Range = (0.0, 0.0)
    highlight: Range = (0.0, 0.0)
    glare: Range = (0.0, 0.0)
    pattern_chance: float = 0.0
    patterns: tuple[str, ...] = tuple(PATTERNS)
    fold_chance: float = 0.0
    parallax: Range = (0.0, 0.0)
    tilt_px: Range = (0.0, 0.0)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "ImageSource":
        """Return the source in `scenes.source` of the parameters."""
        numbers = {name: v for name, v in values.items() if name != "patterns"}
        plain: dict[str, Any] = {
            name: tuple(map(float, v)) if isinstance(v, Sequence) else float(v) for name, v in numbers.items()
        }
        return cls(patterns=tuple(values["patterns"]), **plain)


DRAWN = ImageSource()


@dataclass(frozen=True)
class Pattern:
    """A procedural table top that takes the place of the scene's texture."""

    name: str
    seed: int
    folded: bool  # whether it is a cloth with folds and creases

    def draw(self, side: int) -> Top:
        """Draw the top of SIDE_M as a square of `side` pixels."""
        rng = np.random.default_rng(self.seed)
        top = PATTERNS[self.name](rng, side)
        if self.folded:
            top = folded(rng, top)
        return np.clip(top, 0.0, MAX_BRIGHTNESS).astype(np.float32)


@dataclass(frozen=True)
class Light:
    """Everything that the render seed decides about a scene: table top and its offset, light and camera."""

    offset: Float[Array, "2"]  # of the texture [texture widths]
    rotation: float  # rotation of the texture [rad]
    direction: Float[Array, "2"]  # unit vector on the table towards the lamp
    gain: Float32[Array, "3"]  # brightness and tint per channel
    fall_off: float  # share of brightness lost from the lit edge of the table to the opposite one
    vignette: float  # share of brightness lost in the corners
    noise: Float32[Array, "side side 3"]  # sensor noise [1 = white]
    shadow_length: float  # shift of a shadow over the item's height
    shadow_softness: float  # standard deviation of a shadow's blur over its shift
    shadow_depth: float  # factor on the share of light that a shadow takes
    refraction: float  # share by which a transparent item's middle magnifies the table
    caustic: float  # share of light that a transparent item adds behind itself
    highlight: float  # brightness of the lamp's reflection in an item [1 = white]
    glare: float  # brightness of the lamp's reflection in the table top [1 = white]
    glare_centre: Float[Array, "2"]  # of that reflection [m]
    glare_radius: float  # of that reflection [m]
    pattern: Pattern | None  # takes the place of the texture
    parallax: float  # 1 / height of the camera above the table [1/m]
    foot: Float[Array, "2"]  # the point of the table below the camera [m]
    view: Float[Array, "3 3"] | None  # homography from the image to the straight view [px]; None: they are the same


def draw_light(seed: int, source: ImageSource = DRAWN) -> Light:
    """Draw the light, camera and pattern of the scene with render seed `seed`.

    Every value is drawn whether its effect is off or on, so that turning one effect off leaves the others as they are.
    """
    rng, more = np.random.default_rng(seed), np.random.default_rng([seed, 1])  # the drawn world's draws stay its own
    bearing = rng.uniform(-np.pi, np.pi)
    offset, rotation = rng.uniform(0.0, 1.0, 2), rng.uniform(-np.pi, np.pi)
    gain = rng.uniform(*source.exposure) * rng.normal(1.0, source.white_balance, 3)
    fall_off, vignette = rng.uniform(*source.fall_off), rng.uniform(*source.vignette)
    noise = rng.standard_normal((SIDE, SIDE, 3), np.float32) * np.float32(rng.uniform(*source.noise))
    optics = {name: more.uniform(*getattr(source, name)) for name in OPTICS}
    patterned, folded = more.uniform(size=2) < (source.pattern_chance, source.fold_chance)
    pick, pattern_seed = more.uniform(), int(more.integers(2**31))
    name = source.patterns[int(pick * len(source.patterns))]
    return Light(
        offset=np.array([0.5, 0.5]) if patterned else offset,  # a pattern is as large as the table: it is not shifted
        rotation=rotation,
        direction=np.array([np.cos(bearing), np.sin(bearing)]),
        gain=gain.astype(np.float32),
        fall_off=fall_off,
        vignette=vignette,
        noise=noise,
        **optics,
        glare_centre=more.uniform(0.0, 1.0, 2),
        glare_radius=more.uniform(0.1, 0.4),
        pattern=Pattern(name, pattern_seed, bool(folded) and name in CLOTHS) if patterned else None,
        foot=more.uniform(0.2, 0.8, 2),
        view=_view(more.uniform(-1.0, 1.0, (4, 2)) * more.uniform(*source.tilt_px)),
    )


def _view(shifts: Float[Array, "4 2"]) -> Float[Array, "3 3"] | None:
    """Return the homography that moves the image's corners by `shifts` [px]; None if it moves none."""
    if not shifts.any():
        return None
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * SIDE - 0.5
    return cv2.getPerspectiveTransform(np.float32(corners), np.float32(corners + shifts))  # pyright: ignore
