"""Table tops of other materials: metal, rattan, ceramic, paper, sand, fur."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Top,
    blend,
    cloth,
    colour,
    dried,
    flat,
    grid,
    ink,
    near,
    noise,
    points,
    ramp,
    sheet,
    step,
    stone,
    wood,
)


def basket(rng: np.random.Generator, side: int) -> Top:
    """Draw a basket weave: pairs or triples of canes, over and under."""
    x, y = grid(side)
    n, canes = rng.uniform(8, 30), int(rng.integers(2, 5))
    lies = (np.floor(x * n) + np.floor(y * n)) % 2 > 0
    u, v = x * n % 1, y * n % 1
    across, along = np.where(lies, v, u), np.where(lies, u, v)
    round_cane = np.abs(np.sin(np.pi * across * canes)) ** rng.uniform(0.3, 1)
    light = (0.4 + 0.6 * round_cane) * (0.6 + 0.4 * np.sin(np.pi * along))
    base = wood(rng) if rng.random() < 0.7 else cloth(rng)
    picture = ramp(np.clip(0.5 + 0.15 * noise(rng, side, 60, 2), 0, 1), [near(rng, base, 0.1), base])
    return picture * light[..., None]


def rush_mat(rng: np.random.Generator, side: int) -> Top:
    """Draw slats or rushes side by side, tied with threads across."""
    x, y = grid(side)
    n = rng.uniform(40, 130)
    row = np.floor(y * n).astype(int)
    shade = rng.normal(1, rng.uniform(0.03, 0.2), row.max() + 1).astype(np.float32)[row]
    light = shade * (0.6 + 0.4 * np.abs(np.sin(np.pi * y * n)))
    thread = np.abs((x * rng.uniform(3, 15)) % 1 - 0.5) < rng.uniform(0.01, 0.06)
    picture = wood(rng) * light[..., None]
    return blend(picture, cloth(rng), (thread & (row % 2 == 0)).astype(np.float32) * 0.8)


def bricks(rng: np.random.Generator, side: int) -> Top:
    """Draw bricks or pavers, each weathered on its own."""
    x, y = grid(side)
    n = rng.uniform(6, 20)
    row = np.floor(y * n)
    across = x * n / rng.uniform(1.5, 3) + 0.5 * (row % 2)
    number = rng.random((64, 64)).astype(np.float32)[row.astype(int) % 64, np.floor(across).astype(int) % 64]
    base = colour(rng, (0, 0.12), (0.1, 0.6), (0.25, 0.85))
    rough = 1 + rng.uniform(0.03, 0.15) * noise(rng, side, 25, 4, 0.7)
    picture = ramp(number, [near(rng, base, 0.2), base]) * rough[..., None]
    edge = np.minimum(0.5 - np.abs(across % 1 - 0.5), 0.5 - np.abs(y * n % 1 - 0.5)) + 0.02 * noise(rng, side, 40)
    return blend(stone(rng) * rough[..., None], picture, step(edge - 0.05, 0.06))


def sand(rng: np.random.Generator, side: int) -> Top:
    """Draw rippled sand, water or satin: bent parallel waves, lit from one side."""
    _, y = grid(side)
    phase = (y + rng.uniform(0.01, 0.08) * noise(rng, side, rng.uniform(1.5, 5), 2)) * rng.uniform(4, 30)
    wave = np.sin(2 * np.pi * phase) * np.clip(0.7 + 0.4 * noise(rng, side, 4), 0, 1.5)
    base = colour(rng, (0.05, 0.7), (0, 0.5), (0.3, 0.9))
    return base * np.clip(1 + rng.uniform(0.05, 0.3) * wave + 0.05 * noise(rng, side, 100), 0.1, 1.6)[..., None]


def marbled_paper(rng: np.random.Generator, side: int) -> Top:
    """Draw marbled paper: stripes of ink, combed and stirred."""
    x, y = grid(side)
    u, v = x, y
    for _ in range(rng.integers(1, 4)):
        u = u + rng.uniform(0.02, 0.15) * noise(rng, side, rng.uniform(1.5, 6), 2)
        v = v + rng.uniform(0.01, 0.05) * np.sin(2 * np.pi * u * rng.uniform(2, 12))
    field = (v * rng.uniform(3, 15)) % 1
    shades = [colour(rng) for _ in range(rng.integers(3, 7))]
    return np.asarray(shades)[np.minimum((field * len(shades)).astype(int), len(shades) - 1)]


def rust(rng: np.random.Generator, side: int) -> Top:
    """Draw worn metal: patina or rust that eats a painted sheet."""
    paint, eaten = colour(rng), colour(rng, (0.02, 0.5), (0.2, 0.8), (0.15, 0.6))
    field = noise(rng, side, rng.uniform(3, 12), 6, 0.7)
    rough = 1 + 0.12 * noise(rng, side, 60, 2)
    picture = blend(flat(side, paint), eaten * rough[..., None], step(field - rng.uniform(-0.5, 1), 0.4))
    return picture * (1 - 0.3 * step(np.abs(field - 0.3) * -1 + 0.05, 0.05))[..., None]


def fur(rng: np.random.Generator, side: int) -> Top:
    """Draw a carpet, fur or grass: thousands of short hairs, combed in patches."""
    base = colour(rng, value=(0.15, 0.9))
    picture = sheet(base * np.float32(0.6), side)
    lean = noise(rng, side, rng.uniform(1.5, 6), 2)
    length = side * rng.uniform(0.015, 0.05)
    starts = rng.uniform(0, side, (900, 2))
    turn = rng.uniform(0, 6) + 0.6 * lean[starts[:, 1].astype(int), starts[:, 0].astype(int)] + rng.normal(0, 0.3, 900)
    stops = starts + np.stack([np.cos(turn), np.sin(turn)], -1) * length
    strands = points(np.stack([starts, stops], 1))
    for part in np.array_split(strands, 12):
        cv2.polylines(picture, list(part), False, ink(near(rng, base, 0.25)), 1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def perforated(rng: np.random.Generator, side: int) -> Top:
    """Draw perforated or embossed sheet: holes or studs in rows, each lit from one side."""
    x, y = grid(side)
    n = rng.uniform(12, 45)
    row = np.floor(y * n)
    u, v = (x * n + 0.5 * (row % 2)) % 1 - 0.5, y * n % 1 - 0.5
    if rng.random() < 0.4:
        u, v = u + v * (1 - 2 * (row % 2)), v - u * (1 - 2 * (row % 2))
    radius = np.hypot(u, v * rng.uniform(0.5, 1.5))
    spot = 1 - step(radius - rng.uniform(0.15, 0.35), 0.08)
    base = colour(rng, saturation=(0, 0.4), value=(0.3, 0.9))
    light = 1 + spot * (rng.uniform(-0.8, 0.2) + rng.uniform(-1.5, 1.5) * u + rng.uniform(-1.5, 1.5) * v)
    return base * np.clip(light + 0.03 * noise(rng, side, 40, 2), 0.05, 1.6)[..., None]


def carbon_fibre(rng: np.random.Generator, side: int) -> Top:
    """Draw a satin twill of glossy ribbons: each crossing shines by its direction."""
    x, y = grid(side)
    n = rng.uniform(20, 70)
    i, j = np.floor(x * n), np.floor(y * n)
    over = (i + j) % 4 < 2
    gloss = np.where(over, np.sin(np.pi * (x * n % 1)), np.sin(np.pi * (y * n % 1)))
    base = colour(rng, saturation=(0, 0.6), value=(0.15, 0.7))
    return base * (np.where(over, 0.6, 1.0) * (0.6 + 0.4 * gloss))[..., None].astype(np.float32)


def frosted(rng: np.random.Generator, side: int) -> Top:
    """Draw a pane of frosted or ribbed glass over something blurred."""
    under = dried(cv2.GaussianBlur(sheet_of_blots(rng, side), (0, 0), side * rng.uniform(0.02, 0.06)))
    x, _ = grid(side)
    ribs = rng.uniform(0, 0.1) * np.sin(2 * np.pi * x * rng.uniform(10, 70)) if rng.random() < 0.5 else 0
    return under * (1 + ribs + 0.03 * noise(rng, side, 80, 2))[..., None]


def sheet_of_blots(rng: np.random.Generator, side: int) -> np.ndarray:
    """Return a sheet with large blots of many colours."""
    drawn = sheet(colour(rng), side)
    for _ in range(rng.integers(4, 12)):
        centre, axes = rng.uniform(0, side, 2), rng.uniform(0.05, 0.4, 2) * side
        whole = points(centre).tolist(), points(axes).tolist(), rng.uniform(0, 180), 0, 360
        cv2.ellipse(drawn, *whole, ink(colour(rng)), -1, cv2.LINE_AA, FRACTION_BITS)
    return drawn


def towel(rng: np.random.Generator, side: int) -> Top:
    """Draw terry or velvet: a dense pile that is darker where it was stroked the other way."""
    base = cloth(rng)
    pile = rng.uniform(0.05, 0.2) * noise(rng, side, side / rng.uniform(1.5, 4))
    stroked = step(noise(rng, side, rng.uniform(1.5, 5), 2, 0.5, rng.uniform(1, 4)), rng.uniform(0.1, 2))
    picture = base * (1 + pile - rng.uniform(0, 0.3) * stroked)[..., None]
    _, y = grid(side)
    border = (np.abs((y * rng.uniform(1, 4)) % 1 - 0.5) < rng.uniform(0.02, 0.08)) & (rng.random() < 0.5)
    return blend(picture, cloth(rng), border.astype(np.float32))


def quilt(rng: np.random.Generator, side: int) -> Top:
    """Draw padding stitched in diamonds or squares."""
    x, y = grid(side)
    n = rng.uniform(4, 18)
    u, v = ((x + y) * n, (x - y) * n) if rng.random() < 0.6 else (x * n, y * n)
    height = np.abs(np.sin(np.pi * u) * np.sin(np.pi * v)) ** rng.uniform(0.3, 0.8)
    light = cv2.Sobel(height.astype(np.float32), -1, 1, 0) * rng.uniform(-0.5, 0.5) + cv2.Sobel(
        height.astype(np.float32), -1, 0, 1
    ) * rng.uniform(-0.5, 0.5)
    return cloth(rng) * np.clip(0.8 + 0.2 * height + light, 0.2, 1.6)[..., None]


TAUGHT = (basket, bricks, marbled_paper, rust, frosted, towel, quilt, rush_mat, perforated)
HELD_OUT = (sand, fur, carbon_fibre)
