"""Items to set on a top: a picture with alpha, a silhouette and how the item bends and blocks light.

Coordinates x, y [m] are an item's own, with its long axis along x. `lamp` is the unit vector towards the lamp in them.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32
from numpy import ndarray as Array

from making.segmenter.paint import Rng, blend, colour, near, noise, ramp

EDGE_M = 0.004  # width over which an outline fades [m], less than a pixel of the camera
Plane = Float32[Array, "row column"]


class Drawn(NamedTuple):
    """An item in its window of the picture."""

    rgb: Float32[Array, "row column 3"]
    alpha: Plane
    silhouette: Bool[Array, "row column"]  # what counts as the item, its clear parts included
    height_m: float  # reach of its shadow under a lamp at 45 degrees
    blocks: Plane  # share of the light that it keeps from the table
    bend_m: Float[Array, "row column 2"] | None = None  # where a clear item shows the table from, relative to the pixel
    look: str = "other"  # of `pipeline.perception.segmenter.LOOKS`


class Frame(NamedTuple):
    """The pixels of a window in an item's own coordinates [m]."""

    x: Plane
    y: Plane
    lamp: Float[Array, "2"]


def inside(distance: Plane) -> Plane:
    """Return the cover of an outline from the signed distance [m] to it, negative inside."""
    return np.clip(0.5 - distance / np.float32(EDGE_M), 0, 1)


def to_segment(x: Plane, y: Plane, start: tuple[float, float], stop: tuple[float, float]) -> tuple[Plane, Plane]:
    """Return the distance [m] to a segment, and how far along it the nearest point lies, from 0 to 1."""
    dx, dy = stop[0] - start[0], stop[1] - start[1]
    t = np.clip(((x - start[0]) * dx + (y - start[1]) * dy) / max(dx * dx + dy * dy, 1e-9), 0, 1)
    return np.hypot(x - start[0] - t * dx, y - start[1] - t * dy), t


def decorated(rng: Rng, x: Plane, y: Plane, radius: float) -> Float32[Array, "row column 3"]:
    """Return the painted surface of a round item: rings, rays, dots, checks, stripes, petals, clouds or nothing."""
    base = colour(rng, saturation=(0, 0.2), value=(0.6, 1)) if rng.random() < 0.5 else colour(rng, value=(0.08, 1))
    picture = np.full((*x.shape, 3), base, np.float32)
    r, angle = np.hypot(x, y) / np.float32(radius), np.arctan2(y, x)
    for _ in range(rng.choice([0, 1, 2, 3], p=[0.4, 0.35, 0.17, 0.08])):
        paint = near(rng, base, 0.15) if rng.random() < 0.3 else colour(rng, value=(0.05, 1))
        inner, width = rng.uniform(0, 0.9), rng.uniform(0.04, 0.6)
        where = ((r > inner) & (r < inner + width)) if rng.random() < 0.8 else np.ones(r.shape, bool)
        kind, n = rng.integers(8), int(rng.integers(3, 24))
        if kind == 1:
            where &= np.sin(angle * n) > rng.uniform(-0.5, 0.8)
        elif kind == 2:
            spot = np.hypot((angle * n / 2 / np.pi) % 1 - 0.5, (r - inner - width / 2) * n / 6)
            where &= spot < rng.uniform(0.2, 0.45)
        elif kind == 3:
            size = radius * rng.uniform(0.1, 0.5)
            where &= (np.floor(x / size) + np.floor(y / size)) % 2 > 0
        elif kind == 4:
            where &= (x / (radius * rng.uniform(0.1, 0.6))) % 1 < rng.uniform(0.2, 0.7)
        elif kind == 5:
            where &= r < (0.5 + 0.35 * np.cos(angle * min(n, 12))) * rng.uniform(0.6, 1.2)
        elif kind == 6:
            size, (rows, columns) = max(*x.shape, 16), x.shape
            where &= noise(rng, size, rng.uniform(4, 12), 3)[:rows, :columns] > rng.uniform(-0.3, 1)
        picture[where] += (paint - picture[where]) * np.float32(rng.uniform(0.5, 1))
    return picture


CROCKERY = {  # places from the centre to the rim with the slopes there (height over distance), heights [m], look
    "plate": ([0, 0.62, 0.68, 0.76, 0.8, 0.95, 0.98, 1], [0, 0, 0.5, 0.5, 0.15, 0.15, 0, -0.8], (0.008, 0.03), "plate"),
    "bowl": ([0, 0.3, 0.6, 0.9, 0.93, 0.97, 1], [0, 0.15, 0.6, 1.6, 0, 0, -1], (0.02, 0.07), "bowl"),
    "lid": ([0, 0.12, 0.18, 0.2, 0.9, 1], [0, 0, -2, -0.1, -0.2, -1.5], (0.005, 0.03), "other"),
    "lump": ([0, 0.3, 0.6, 0.8, 0.95, 1], [0, -0.2, -0.6, -1.1, -2, -3], (0.02, 0.08), "other"),
    "pot": ([0, 0.78, 0.82, 0.9, 0.93, 0.97, 1], [0, 0, 1, 4, 0, 0, -1], (0.04, 0.1), "bowl"),
}


def crockery(rng: Rng, frame: Frame, radius: float) -> Drawn:
    """Draw a solid of revolution: plate, bowl, lid, fruit or pot, maybe oval, square or filled."""
    kind = str(rng.choice([*CROCKERY], p=[0.4, 0.33, 0.09, 0.08, 0.1]))
    places, slopes, heights, look = CROCKERY[kind]
    x, y = frame.x, frame.y / np.float32(rng.uniform(0.72, 1) if rng.random() < 0.25 else 1)
    if rng.random() < 0.18:
        power = rng.uniform(2.5, 8)
        r = (np.abs(x) ** power + np.abs(y) ** power) ** (1 / power) / radius
    elif rng.random() < 0.12:
        wave = rng.uniform(0.01, 0.06)
        r = np.hypot(x, y) / radius * (1 + wave * (1 + np.cos(np.arctan2(y, x) * rng.integers(5, 20))))
    else:
        r = np.hypot(x, y) / radius
    r = r.astype(np.float32)
    shifted = places[1:-1] + rng.normal(0, 0.04, len(places) - 2)
    knots = np.sort(np.clip([0, *shifted, 1], 0, 1))
    steep = np.interp(r, knots, np.array(slopes) * rng.uniform(0.4, 1.3)).astype(np.float32)
    scale = np.maximum(np.hypot(frame.x, frame.y), 1e-4)
    ambient, gloss, sharpness = rng.uniform(0.3, 0.8), rng.uniform(0, 0.9) ** 2, rng.uniform(8, 80)
    slope_x, slope_y = steep * frame.x / scale, steep * frame.y / scale
    length = np.sqrt(slope_x**2 + slope_y**2 + 1)
    towards = (1.2 - slope_x * frame.lamp[0] - slope_y * frame.lamp[1]) / length / 1.56
    halfway = np.clip((2.4 - slope_x * frame.lamp[0] - slope_y * frame.lamp[1]) / length / 2.6, 0, 1)
    diffuse = (ambient + (1 - ambient) * np.clip(towards, 0, 1) / 0.77).astype(np.float32)
    shine = (gloss * halfway**sharpness).astype(np.float32)
    rgb = decorated(rng, frame.x, y, radius)
    if kind in ("bowl", "pot"):
        depth = rng.uniform(0.1, 0.5) if kind == "bowl" else rng.uniform(0.3, 0.8)
        hollow = np.clip((0.93 - r) / 0.25, 0, 1)
        near_lamp = np.clip(0.4 + (frame.x * frame.lamp[0] + frame.y * frame.lamp[1]) / radius * 1.2, 0, 1)
        diffuse = diffuse * (1 - depth * hollow * (0.35 + 0.65 * near_lamp))
        if rng.random() < 0.25:
            level = np.clip((rng.uniform(0.55, 0.88) - r) / 0.03, 0, 1)
            food = colour(rng, (0, 0.2), (0.1, 0.9), (0.1, 0.9))
            food = food * (1 + 0.15 * rng.random() * np.sin(x * 300) * np.sin(y * 280))[..., None]
            rgb, diffuse = blend(rgb, food, level), diffuse + (1 - diffuse) * level * 0.7
    if rng.random() < 0.4:
        rim = np.exp(-(((r - 0.955) / 0.03) ** 2))[..., None]
        rgb = rgb + (colour(rng) - rgb) * rim * rng.uniform(0.3, 1)
    rgb = rgb * diffuse[..., None] + shine[..., None]
    alpha = inside((r - 1) * radius)
    return Drawn(rgb.astype(np.float32), alpha, alpha > 0.5, rng.uniform(*heights), alpha, look=look)


def mug(rng: Rng, frame: Frame, radius: float) -> Drawn:
    """Draw a mug or cup with a handle, empty or filled."""
    body = radius * rng.uniform(0.68, 0.82)
    x = frame.x + np.float32(radius - body)
    r = np.hypot(x, frame.y)
    wall = body * rng.uniform(0.06, 0.16)
    reach, half = radius * 2 - body, body * rng.uniform(0.1, 0.5)
    if rng.random() < 0.5:
        handle = to_segment(x, frame.y, (body * 0.9, 0), (reach - half * 0.3, 0))[0] - body * rng.uniform(0.07, 0.16)
    else:
        handle = np.abs(np.hypot((x - body) / (reach - body), frame.y / half) - 0.85) * half - body * 0.09
    base = colour(rng, saturation=(0, 0.9), value=(0.08, 1))
    towards = (x * frame.lamp[0] + frame.y * frame.lamp[1]) / body
    within = inside(r - (body - wall))
    depth = rng.uniform(0.3, 0.85)
    hollow = (colour(rng) if rng.random() < 0.3 else base) * (1 - depth * np.clip(0.5 + 0.6 * towards, 0, 1))[..., None]
    if rng.random() < 0.45:
        level = inside(r - (body - wall) * rng.uniform(0.85, 0.97))
        drink = colour(rng, (0.02, 0.15), (0.3, 0.9), (0.05, 0.7)) * (1 + 0.2 * towards[..., None])
        hollow = blend(hollow, drink, level)
    rgb = blend(base * (0.9 + 0.25 * towards)[..., None], hollow, within)
    cover = np.maximum(inside(r - body), inside(handle.astype(np.float32)))
    glint = np.exp(-(((r - body + wall / 2) / (wall * 0.5)) ** 2)) * np.clip(towards, 0, 1) ** 4 * rng.uniform(0, 0.8)
    rgb = (rgb + glint[..., None]).astype(np.float32)
    return Drawn(rgb, cover, cover > 0.5, rng.uniform(0.05, 0.11), cover, look="cup")


def clear_glass(rng: Rng, frame: Frame, radius: float, lean: Array) -> Drawn:
    """Draw a glass from above: rim, foot, highlights and tint over the table that it bends.

    `lean` [m] is the shift of the rim against the foot, as in a picture taken from the side.
    """
    taper = rng.uniform(0.5, 1.02)
    foot, rim_r = radius * min(taper, 1), radius / max(taper, 1)
    x, y, lamp = frame
    top_x, top_y = x - np.float32(lean[0]), y - np.float32(lean[1])
    r_top, r_foot, bearing = np.hypot(top_x, top_y), np.hypot(x, y), np.arctan2(top_y, top_x)
    if rng.random() < 0.15:  # many-sided
        r_top = r_top * (1 + 0.05 * np.cos(bearing * int(rng.integers(5, 13))))
    wall, along = to_segment(x, y, (0, 0), (float(lean[0]), float(lean[1])))
    body = wall - (foot + (rim_r - foot) * along)
    cover = inside(np.minimum(np.minimum(body, r_top - rim_r), r_foot - foot).astype(np.float32))
    stained = rng.random() < 0.3
    tint = colour(rng, (0, 1), (0.1, 0.8), (0.5, 1)) if stained else colour(rng, (0.3, 0.65), (0, 0.1), (0.6, 1))
    alpha = np.full(x.shape, rng.uniform(0, 0.08) if rng.random() < 0.7 else rng.uniform(0.1, 0.45), np.float32)
    rgb = tint * alpha[..., None]

    def over(shade: Array, share: Plane) -> None:
        nonlocal rgb, alpha
        rgb = rgb * (1 - share[..., None]) + shade * share[..., None]
        alpha = alpha * (1 - share) + share

    faint = rng.uniform(0.15, 0.6) if rng.random() < 0.4 else 1.0
    inner = np.clip(r_top / rim_r, 0, 1)
    over(tint * rng.uniform(0.1, 0.6), (inner ** rng.uniform(3, 12) * rng.uniform(0, 0.5) * faint).astype(np.float32))
    if rng.random() < 0.35 * faint:
        level = inside(r_top - rim_r * rng.uniform(0.75, 0.93))
        over(colour(rng, (0, 1), (0.2, 0.9), (0.1, 0.9)), level * np.float32(rng.uniform(0.05, 0.9)))
    towards_foot = (x * lamp[0] + y * lamp[1]) / np.maximum(r_foot, 1e-4)
    towards = (top_x * lamp[0] + top_y * lamp[1]) / np.maximum(r_top, 1e-4)
    strength = rng.uniform(0.15, 1.2) * faint
    rings = [(r_foot, foot * rng.uniform(0.7, 0.97), towards_foot), (r_top, rim_r * 0.95, towards)]
    if rng.random() < 0.3:
        rings.append((r_foot, foot * rng.uniform(0.1, 0.7), towards_foot))
    for r, ring, side in rings:
        width = radius * rng.uniform(0.03, 0.1)
        share = np.exp(-(((r - ring) / width) ** 2)) * np.float32(strength * rng.uniform(0.2, 0.9))
        bright = np.clip(rng.uniform(0, 1.2) + rng.uniform(-0.7, 0.7) * side, 0, 1.3)
        over(tint * bright[..., None], share * np.clip(0.6 + rng.uniform(-0.6, 0.6) * side, 0, 1))
    for _ in range(rng.integers(0, 5)):
        turn, width = rng.uniform(0, 2 * np.pi), rng.uniform(0.03, 0.4)
        if rng.random() < 0.6:
            turn = np.arctan2(lamp[1], lamp[0]) + np.pi * rng.integers(2) + rng.normal(0, 0.2)
        off = np.abs((bearing - turn + np.pi) % (2 * np.pi) - np.pi)
        away = (r_top / rim_r - rng.uniform(0.5, 0.97)) / rng.uniform(0.02, 0.08)
        glint = np.exp(-((off / width) ** 2) - (away**2))
        over(np.ones(3, np.float32), (glint * rng.uniform(0.2, 1) * faint).astype(np.float32))
    straight = (rgb / np.maximum(alpha, 1e-3)[..., None]).astype(np.float32)
    power, swap = rng.uniform(0, 4), rng.uniform(0.02, 0.9) * faint * (-1 if rng.random() < 0.7 else 1.5)
    pull = (np.clip(r_foot / radius, 0, 1) ** power * swap).astype(np.float32)
    bend = np.stack([x * pull, y * pull], -1) * cover[..., None]
    hollow = np.clip(rng.uniform(0.15, 0.6) + 0.8 * np.clip(inner, 0, 1) ** 4, 0, 1) * rng.uniform(0.1, 0.9)
    height, blocks = rng.uniform(0.04, 0.13), (cover * hollow).astype(np.float32)
    return Drawn(straight, (alpha * cover).astype(np.float32), cover > 0.5, height, blocks, bend, "cup")


PROFILES = {  # widths from foot to mouth, or from one end to the other
    "cup": ([0, 1], [0.78, 1]),
    "can": ([0, 0.04, 0.96, 1], [0.94, 1, 1, 0.92]),
    "bottle": ([0, 0.55, 0.72, 0.78, 0.93, 1], [1, 1, 0.6, 0.36, 0.36, 0.42]),
    "jar": ([0, 0.75, 0.84, 1], [1, 1, 0.82, 0.82]),
    "vase": ([0, 0.35, 0.75, 1], [0.6, 1, 0.45, 0.65]),
    "tube": ([0, 0.8, 0.85, 1], [1, 0.75, 0.45, 0.4]),
}


def revolved(rng: Rng, frame: Frame, half: float, radius: float, lying: bool, clear: bool) -> Drawn:
    """Draw a cup, can, bottle, jar, vase or tube along x, its foot to the left, of opaque or clear material.

    lying: seen from above on its side; else it stands and is seen aslant, with its mouth to the right.
    """
    kinds = ["bottle", "can", "cup", "jar", "tube"] if lying else ["cup", "can", "bottle", "jar", "vase"]
    kind = str(rng.choice(kinds, p=[0.3, 0.15, 0.3, 0.15, 0.1]))
    at, widths = PROFILES[kind]
    at = np.sort(np.clip(at + rng.normal(0, 0.05, len(at)), 0, 1))
    x, y, reach = frame.x, frame.y, half if lying else half - radius
    along = np.clip((x + reach) / max(2 * reach, 1e-4), 0, 1)
    width = np.interp(along, at, widths).astype(np.float32) * np.float32(radius)
    if lying:
        distance = np.maximum(np.abs(y) - width, np.abs(x) - half)
    else:
        beyond = np.hypot(np.maximum(np.abs(x) - reach, 0), y)
        distance = np.where(np.abs(x) <= reach, np.abs(y), beyond) - width
    mouth = np.float32(widths[-1] * radius)
    across = np.clip(y / np.maximum(width, 1e-4), -1, 1)
    side = np.float32(frame.lamp[1])
    tone = np.clip(rng.uniform(0.5, 0.95) + rng.uniform(0.1, 0.5) * across * side - 0.3 * across**2, 0.08, 1.5)
    for _ in range(rng.integers(0, 3)):
        tone = tone + rng.uniform(0, 0.6) * np.exp(-(((across - rng.uniform(-0.9, 0.9)) / rng.uniform(0.05, 0.3)) ** 2))
    base = colour(rng, saturation=(0, 0.9), value=(0.06, 1))
    rgb = (base * tone[..., None]).astype(np.float32)
    low, high = np.sort(rng.uniform(0.05, 0.8, 2))
    label = ((along > low) & (along < high)).astype(np.float32) * np.float32(rng.random() < 0.55)
    print_ = decorated(rng, x, y, half) if rng.random() < 0.6 else colour(rng, value=(0.05, 1))
    rgb = blend(rgb, print_ * tone[..., None], label)
    alpha = np.ones(x.shape, np.float32)
    if clear:
        edge = np.abs(across) ** rng.uniform(4, 14)
        alpha = np.clip(rng.uniform(0.02, 0.25) + rng.uniform(0.2, 0.9) * edge + 0.8 * (tone > 1.05) + label, 0, 1)
    cover = inside(distance.astype(np.float32))
    if lying and rng.random() < 0.5:  # a cap
        cap = (along > rng.uniform(0.85, 0.95))[..., None]
        rgb = np.where(cap, colour(rng) * tone[..., None], rgb)
    if not lying:
        r = np.hypot(x - reach, y) / mouth
        within, rim = inside((r - 0.9) * mouth), np.exp(-(((r - 0.95) / 0.06) ** 2))[..., None]
        deep = rng.uniform(0.15, 0.9) * np.clip(0.6 + 0.4 * (x - reach) / mouth, 0, 1)[..., None]
        filling = base * deep if rng.random() < 0.6 else colour(rng) * np.ones_like(deep)
        rgb = blend(rgb, filling, within)
        rgb += (base * rng.uniform(0.7, 1.4) - rgb) * rim * rng.uniform(0.2, 1)
        if clear:
            alpha = np.maximum(alpha * (1 - within * 0.7), 0.8 * rim[..., 0] * rng.uniform(0.3, 1))
    if not lying and not clear and rng.random() < 0.4:  # a handle
        lift, out = rng.uniform(-0.3, 0.3) * half, radius * rng.uniform(1.0, 1.5)
        ring = np.hypot((x - lift) / rng.uniform(0.35, 0.7), y - out * rng.choice([-0.8, 0.8])) - radius * 0.55
        handle = inside((np.abs(ring) - radius * rng.uniform(0.07, 0.16)).astype(np.float32)) * (1 - cover)
        rgb = blend(rgb, base * rng.uniform(0.6, 1.1), handle)
        cover = np.maximum(cover, handle)
    rgb, share, look = rgb.astype(np.float32), (alpha * cover).astype(np.float32), "cup" if kind == "cup" else "bottle"
    if not clear:
        return Drawn(rgb, share, cover > 0.5, rng.uniform(0.03, 0.1), cover, look=look)
    bend = np.stack([np.zeros_like(x), y * (np.float32(rng.uniform(-0.8, 0.3)) * cover)], -1)
    blocks = (cover * rng.uniform(0.1, 0.6)).astype(np.float32)
    return Drawn(rgb, share, cover > 0.5, rng.uniform(0.04, 0.13), blocks, bend, look)


def tool(rng: Rng, frame: Frame, half: float, breadth: float) -> Drawn:
    """Draw what has limbs and rings: scissors, pliers, spectacles, keys, a screwdriver, a brush, a cable's plug."""
    x, y = frame.x, frame.y
    rgb, cover = np.zeros((*x.shape, 3), np.float32), np.zeros(x.shape, np.float32)
    joint, turned = rng.uniform(-0.3, 0.3) * half, 1 if frame.lamp[1] > 0 else -1
    limbs = (-1.0, 1.0) if rng.random() < 0.6 else (1.0,)
    splay = breadth * rng.uniform(0.2, 1)
    for sign in limbs:
        ends = [(-half * 0.95, -sign * splay), (joint, 0.0), (half * 0.95, sign * splay * rng.uniform(0.1, 1))]
        thick = breadth * rng.uniform(0.12, 0.45, 3)
        for (start, stop), (first, last) in zip(pairwise(ends), pairwise(thick), strict=True):
            away, t = to_segment(x, y, start, stop)
            part = inside((away - (first + (last - first) * t)).astype(np.float32))
            rgb = blend(rgb, metal(rng, np.clip(away / breadth, -1, 1), t, turned), part)
            cover = np.maximum(cover, part)
        if rng.random() < 0.6:
            radius = breadth * rng.uniform(0.4, 0.75)
            ring = np.hypot((x + half - radius) / rng.uniform(1, 1.6), y + sign * splay) - radius * 0.8
            ring = ring if rng.random() < 0.25 else np.abs(ring) - radius * rng.uniform(0.12, 0.3)
            part = inside(ring.astype(np.float32))
            rgb = blend(rgb, colour(rng, saturation=(0, 0.95)) * (1 + 0.2 * y / breadth * turned)[..., None], part)
            cover = np.maximum(cover, part)
    return Drawn(rgb.astype(np.float32), cover, cover > 0.5, rng.uniform(0.003, 0.03), cover)


def metal(rng: Rng, across: Plane, along: Plane, turned: float) -> Float32[Array, "row column 3"]:
    """Return the surface of a long item: polished metal with a strip of light, wood or plastic."""
    kind = rng.random()
    if kind < 0.6:
        base = colour(rng, (0.05, 0.65), (0, 0.12) if rng.random() < 0.8 else (0.2, 0.6), (0.35, 0.95))
        strip = np.clip(across * turned, -1, 1)
        slope, waves = rng.uniform(-0.5, 0.5), rng.uniform(0, 0.35)
        sky = 0.75 + slope * strip + waves * np.sin(strip * rng.uniform(2, 6) + along * rng.uniform(0, 9))
        glint = rng.uniform(0, 0.6) * np.exp(-(((strip - rng.uniform(-0.6, 0.6)) / 0.25) ** 2))
        return base * np.clip(sky + glint, 0.1, 1.6)[..., None]
    base = colour(rng, (0.04, 0.11), (0.25, 0.7), (0.25, 0.85)) if kind < 0.8 else colour(rng, saturation=(0, 0.9))
    return base * (1 - rng.uniform(0, 0.4) * across**2 + rng.uniform(-0.2, 0.2) * across * turned)[..., None]


def cutlery(rng: Rng, frame: Frame, half: float, breadth: float) -> Drawn:
    """Draw a fork, knife, spoon, rod, pair of sticks or tongs, of this half-length and half-width [m]."""
    kind = rng.choice(["fork", "knife", "spoon", "sticks", "rod", "tongs"], p=[0.3, 0.27, 0.25, 0.06, 0.07, 0.05])
    x, y = frame.x, frame.y
    thin = max(breadth * rng.uniform(0.25, 0.75), 0.0035)
    neck = half * rng.uniform(-0.05, 0.45)
    handle, along = to_segment(x, y, (-half + thin, 0), (neck, 0))
    narrow = rng.uniform(0.35, 1)
    parts = [handle - thin * (1 - (1 - narrow) * along)]
    if kind in ("fork", "spoon"):
        parts.append(to_segment(x, y, (neck, 0), (half * 0.75, 0))[0] - thin * narrow)
    if kind == "fork":
        n, length = int(rng.integers(2, 5)), rng.uniform(0.15, 0.35) * half
        base = half - length
        parts.append(np.hypot((x - base) / 1.3, y) - breadth)
        tine = breadth / n * rng.uniform(0.5, 0.8)
        for place in np.linspace(-breadth + tine, breadth - tine, n):
            parts.append(to_segment(x, y, (base, float(place)), (half - tine, float(place)))[0] - tine)
        parts[2] = np.maximum(parts[2], x - base - breadth * 0.4)
    elif kind == "spoon":
        length = breadth * rng.uniform(1.1, 1.8)
        parts.append((np.hypot((x - half + length) / length, y / breadth) - 1) * breadth)
    elif kind == "knife":
        blade, t = to_segment(x, y, (neck, 0), (half - breadth * 0.3, 0))
        edge = breadth * rng.uniform(0.45, 0.95)
        curve = np.clip(1 - t ** rng.uniform(2, 8) * 0.7, 0.1, 1)
        parts.append(np.maximum(blade - edge * curve, -y - edge * rng.uniform(0.2, 1)))
    elif kind == "sticks":
        splay = rng.uniform(0, breadth * 0.6)
        ends = [((-half, s * (breadth - thin)), (half, s * splay)) for s in (-1.0, 1.0)]
        parts = [to_segment(x, y, *both)[0] - thin * 0.7 for both in ends]
    elif kind == "tongs":
        tips = [(half - thin, s * (breadth - thin)) for s in (-1.0, 1.0)]
        parts = [to_segment(x, y, (-half + thin, 0), tip)[0] - thin * 0.8 for tip in tips]
    else:
        parts = [to_segment(x, y, (-half + thin, 0), (half - thin, 0))[0] - thin]
    turned = 1 if frame.lamp[1] > 0 else -1
    along_all = (x + half) / (2 * half)
    rgb = metal(rng, y / thin, along_all, turned)
    if rng.random() < 0.4:
        rgb = np.where((x < neck)[..., None], metal(rng, y / thin, along_all, turned), rgb)
    if kind == "spoon":
        length = breadth * 1.4
        u, v = (x - half + length) / length, y / breadth
        hollow = np.clip(1 - u**2 - v**2, 0, 1)
        shade = 1 - rng.uniform(0, 0.7) * hollow * (0.5 + 0.5 * (u * frame.lamp[0] + v * frame.lamp[1]))
        glint = np.exp(-(((u - 0.3) ** 2 + (v + 0.3) ** 2) / 0.05)) * hollow * rng.uniform(0, 0.6)
        rgb = rgb * shade[..., None] + glint[..., None]
    alpha = inside(np.minimum.reduce(parts).astype(np.float32))
    return Drawn(rgb.astype(np.float32), alpha, alpha > 0.5, rng.uniform(0.002, 0.02), alpha, look="cutlery")


def box(rng: Rng, frame: Frame, half: float, breadth: float) -> Drawn:
    """Draw a rounded rectangle: a board, a tray, a box, a telephone."""
    corner = breadth * rng.uniform(0.05, 0.9)
    dx, dy = np.abs(frame.x) - (half - corner), np.abs(frame.y) - (breadth - corner)
    distance = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(np.maximum(dx, dy), 0) - corner
    rgb = decorated(rng, frame.x, frame.y, half)
    if rng.random() < 0.4:
        rows, columns = frame.x.shape
        field = noise(rng, max(rows, columns, 16), rng.uniform(2, 20), 3, 0.6, rng.uniform(1, 8))[:rows, :columns]
        rgb = ramp(0.5 + 0.25 * field, [colour(rng), colour(rng)])
    border = np.exp(-((distance + rng.uniform(0.003, 0.012)) ** 2) / 0.004**2)
    edge = (frame.x / half * frame.lamp[0] + frame.y / breadth * frame.lamp[1]) * rng.uniform(-0.4, 0.5)
    rgb = rgb * (1 + border * edge + rng.uniform(-0.15, 0.15) * frame.x / half)[..., None]
    alpha = inside(distance.astype(np.float32))
    return Drawn(rgb.astype(np.float32), alpha, alpha > 0.5, rng.uniform(0.003, 0.05), alpha)
