"""The canvas on which a scene is drawn, the light on it with the shadows of items, and the camera above it.

The canvas is finer than the camera's picture, and wider than the table. The camera adds perspective, blur, glare, tone,
noise and JPEG artefacts.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray as Array

from making.segmenter.items import Drawn
from making.segmenter.paint import Rng, noise
from pipeline.world.layout import SIDE

SAMPLES = 2  # samples per pixel along each axis
PX_PER_M = SIDE * SAMPLES
FINE = SIDE * SAMPLES  # side of the camera's finer picture [pixels]
CANVAS_M = 1.08  # side of the drawn table [m]: the camera's perspective stays within it
CANVAS = round(CANVAS_M * PX_PER_M)  # [pixels]
Window = tuple[slice, slice]  # rows and columns of the canvas
Plane = Float32[Array, "side side"]
Picture = Float32[Array, "side side 3"]
MAX_SHADOW_M = 0.08  # longest shadow [m]
SHADOW_STEPS = (0.15, 0.4, 0.7, 1.0)  # shares of a shadow's length at which an item's outline is laid down
MIN_COVER = 62  # share [1 / 255] from which a pixel is an item's: a quarter, as handles are thinner than pixels


class Camera(NamedTuple):
    """A camera: where it sees the table, its blur, noise, gamma and JPEG quality."""

    view: Array  # homography from its finer picture to the canvas
    blur: float  # [fine pixels]
    noise: float
    shot: float  # noise that grows with the square root of the light
    gamma: float
    shoulder: bool  # whether highlights are compressed, as on film, or clipped
    jpeg: int | None
    glare: Plane | None

    def take(self, rng: Rng, canvas: Array) -> UInt8[Array, "100 100 3"]:
        """Return the picture of a canvas."""
        flags, canvas = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, canvas.astype(np.float32)
        seen = cv2.warpPerspective(canvas, self.view, (FINE, FINE), flags=flags, borderMode=cv2.BORDER_REFLECT)
        if self.blur > 0.3:
            seen = cv2.GaussianBlur(seen, (0, 0), self.blur)
        picture = cv2.resize(seen, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        if self.glare is not None:
            picture = picture + self.glare[..., None]
        picture = np.clip(picture, 0, None) ** np.float32(self.gamma)
        if self.shoulder:
            picture = 1.05 * (1 - np.exp(-1.5 * picture))
        spread = self.noise + self.shot * np.sqrt(np.clip(picture, 0, 1))
        picture = picture + rng.standard_normal(picture.shape, np.float32) * spread
        picture = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
        if self.jpeg is not None:
            coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            picture = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
        return picture

    def label(self, labels: UInt8[Array, "side side"], count: int) -> UInt8[Array, "100 100"]:
        """Return the item that covers most of each pixel, at least a quarter; 0 for the table."""
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(labels, self.view, (FINE, FINE), flags=flags, borderMode=cv2.BORDER_REFLECT)
        result, best = np.zeros((SIDE, SIDE), np.uint8), np.full((SIDE, SIDE), MIN_COVER, np.uint8)
        for k in range(1, count + 1):
            mask = np.where(seen == k, np.uint8(255), np.uint8(0))
            share = cv2.resize(mask, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
            larger = share > best
            result[larger], best[larger] = k, share[larger]
        return result


def draw_camera(rng: Rng) -> Camera:
    """Draw a camera above the table, tilted by up to a few degrees."""
    margin = (CANVAS_M - 1) / 2
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    tilt = rng.uniform(-1, 1, (4, 2)) * margin * rng.choice([0.0, 0.3, 1.0])
    corners = (square + margin + tilt) * PX_PER_M - 0.5
    view = cv2.getPerspectiveTransform(np.float32(square * FINE - 0.5), np.float32(corners))  # pyright: ignore
    glare = None
    if rng.random() < 0.25:
        along = np.linspace(-0.5, 0.5, SIDE, dtype=np.float32)
        centre, turn, width = rng.uniform(-0.6, 0.6, 2), rng.uniform(0, np.pi), rng.uniform(0.05, 0.5, 2)
        x, y = along[None, :] - np.float32(centre[0]), along[:, None] - np.float32(centre[1])
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        glare = (rng.uniform(0.05, 0.5) * np.exp(-((u / width[0]) ** 2) - (v / width[1]) ** 2)).astype(np.float32)
    return Camera(
        view,
        rng.uniform(0.3, 1.6) if rng.random() < 0.6 else 0.0,
        float(np.exp(rng.uniform(-7, -4))),
        rng.uniform(0, 0.15) ** 2,
        float(np.exp(rng.normal(0, 0.15))),
        rng.random() < 0.5,
        int(rng.integers(50, 96)) if rng.random() < 0.3 else None,
        glare,
    )


class Lamp(NamedTuple):
    """A lamp: its direction on the picture (columns, rows), shadow length over height, and share of the light."""

    direction: Array
    slant: float
    share: float
    softness_m: float


def draw_lamps(rng: Rng) -> list[Lamp]:
    """Draw one to three lamps that share the direct light; the rest is ambient."""
    count = int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1]))
    direct, lamps = rng.uniform(0.2, 0.9), []
    for share in rng.dirichlet(np.full(count, 2.0)) * direct:
        bearing = rng.uniform(0, 2 * np.pi)
        direction = np.array([np.cos(bearing), np.sin(bearing)])
        slant = float(np.exp(rng.uniform(-1.2, 1.1))) if rng.random() < 0.5 else rng.uniform(1, 4)
        lamps.append(Lamp(direction, slant, float(share), rng.uniform(0.002, 0.03)))
    return lamps


def draw_illumination(rng: Rng, lamps: list[Lamp]) -> Picture:
    """Return the light on the bare table: exposure, white balance, fall-off, pools of light, glare and soft shade."""
    x = np.linspace(-0.5, 0.5, CANVAS, dtype=np.float32)
    y = x[:, None]
    field = 1 + rng.uniform(0, 0.5) ** 1.5 * (x * lamps[0].direction[0] + y * lamps[0].direction[1])
    centre = rng.uniform(-0.5, 0.5, 2)
    field = field * (1 - rng.uniform(0, 0.35) ** 1.5 * ((x - 0.3 * centre[0]) ** 2 + (y - 0.3 * centre[1]) ** 2) * 2)
    if rng.random() < 0.25:
        width = rng.uniform(0.15, 0.6)
        field = field * (1 + rng.uniform(0, 0.5) * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / width**2))
    if rng.random() < 0.2:
        shade = noise(rng, CANVAS, rng.uniform(2, 6), 2)
        depth = rng.uniform(0.05, 0.4)
        field = field * (1 - depth * np.clip((shade - rng.uniform(-0.5, 1)) / rng.uniform(0.1, 1), 0, 1))
    if rng.random() < 0.2:
        field = field * (1 - rng.uniform(0.1, 0.6) * outside_shadow(rng))
    return field[..., None].astype(np.float32) * rng.normal(1, 0.06, 3).astype(np.float32)


def outside_shadow(rng: Rng) -> Plane:
    """Return the shadow of what stands or hangs outside the picture: window bars, edges, blots."""
    mask = np.zeros((CANVAS, CANVAS), np.uint8)
    turn, kind = rng.uniform(0, 180), rng.integers(3)
    for _ in range(rng.integers(1, 5)):
        centre = rng.uniform(0, CANVAS, 2)
        if kind < 2:
            size = [2.0 * CANVAS, rng.uniform(0.02, 0.08 if kind else 0.5) * CANVAS]
            turn += 90.0 * rng.integers(2)
            cv2.fillConvexPoly(mask, np.int32(cv2.boxPoints((centre.tolist(), list(size), turn))), 255)  # pyright: ignore
        else:
            size, turn = rng.uniform(0.06, 0.4, 2) * CANVAS, rng.uniform(0, 180)
            cv2.ellipse(mask, (centre.tolist(), list(size), turn), 255, -1)  # pyright: ignore
    return cv2.GaussianBlur(mask, (0, 0), np.exp(rng.uniform(0, 2.3))).astype(np.float32) / 255


def shadows(placed: list[tuple[Window, Drawn]], lamps: list[Lamp], rng: Rng) -> Picture:
    """Return the share of the light that reaches the table: shadows of each lamp, contact shade and caustics."""
    light = np.ones((CANVAS, CANVAS, 3), np.float32)
    if not placed:
        return light
    tint = 1 - rng.uniform(0, 0.12, 3).astype(np.float32) * np.array([1, 0.8, 0.4], np.float32)
    contact = np.zeros((CANVAS, CANVAS), np.uint8)
    for window, item in placed:
        contact[window] = np.maximum(contact[window], (item.blocks * 255).astype(np.uint8))
    for lamp in lamps:
        shade = np.zeros((CANVAS, CANVAS), np.uint8)
        for step in SHADOW_STEPS:
            layer = np.zeros((CANVAS, CANVAS), np.uint8)
            for window, item in placed:
                shift = -lamp.direction * min(item.height_m * lamp.slant, MAX_SHADOW_M) * step * PX_PER_M
                corner = np.array([window[1].start, window[0].start])
                move, mask = np.column_stack([np.eye(2), corner + np.rint(shift)]), (item.blocks * 255).astype(np.uint8)
                moved = cv2.warpAffine(mask, move, (CANVAS, CANVAS), flags=cv2.INTER_NEAREST)
                layer = np.maximum(layer, moved)
            sigma = 0.6 + lamp.softness_m * PX_PER_M * step
            shade = np.maximum(shade, cv2.GaussianBlur(layer, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE))
        light -= (shade.astype(np.float32) * np.float32(lamp.share / 255))[..., None] * tint
    around = cv2.GaussianBlur(contact, (0, 0), rng.uniform(1.5, 6)).astype(np.float32) / 255
    light *= (1 - rng.uniform(0, 0.4) * around)[..., None]
    for window, item in placed:
        if item.bend_m is not None and rng.random() < 0.6:
            caustic(light, window, item, lamps[0], rng)
    return np.clip(light, 0.05, 2)


def caustic(light: Array, window: Window, item: Drawn, lamp: Lamp, rng: Rng) -> None:
    """Brighten the middle of a clear item's shadow."""
    rows, columns = window
    size = (columns.stop - columns.start) / 2
    centre = np.array([columns.start + columns.stop, rows.start + rows.stop]) / 2
    length = min(item.height_m * lamp.slant, MAX_SHADOW_M) * rng.uniform(0.3, 1) * PX_PER_M
    centre = centre - lamp.direction * (length + size * 0.2)
    reach = int(size) + 1
    low = np.clip(np.floor(centre - reach), 0, CANVAS).astype(int)
    high = np.clip(np.ceil(centre + reach), 0, CANVAS).astype(int)
    if (low >= high).any():
        return
    x = (np.arange(low[0], high[0], dtype=np.float32) - np.float32(centre[0])) / np.float32(size)
    y = ((np.arange(low[1], high[1], dtype=np.float32) - np.float32(centre[1])) / np.float32(size))[:, None]
    along = x * lamp.direction[0] + y * lamp.direction[1]
    across = y * lamp.direction[0] - x * lamp.direction[1]
    glow = np.exp(-((along / rng.uniform(0.15, 0.5)) ** 2) - (across / rng.uniform(0.1, 0.4)) ** 2)
    light[low[1] : high[1], low[0] : high[0]] += (glow * rng.uniform(0.1, 0.7) * lamp.share)[..., None]
