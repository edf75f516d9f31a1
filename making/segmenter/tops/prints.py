"""Table tops with printed pictures: flowers, text, maps, halftones."""

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
    shades,
    sheet,
    step,
)


def flowers(rng: np.random.Generator, side: int) -> Top:
    """Draw sprigs: blossoms of petals about a heart, with stalks and leaves."""
    picture = sheet(cloth(rng), side)
    petals, hearts, leaves = shades(rng, 1, 3), colour(rng), colour(rng, (0.2, 0.5), (0.1, 0.7), (0.15, 0.8))
    size = side * rng.uniform(0.015, 0.06)
    for centre in rng.uniform(0, side, (int(min(rng.uniform(0.15, 0.5) * (side / size / 2) ** 2, 90)), 2)):
        turn, count, radius = rng.uniform(0, 360), int(rng.integers(4, 9)), size * rng.uniform(0.6, 1.2)
        bow = centre + rng.normal(0, 2, (4, 2)).cumsum(0) * radius / 2
        cv2.polylines(picture, [points(bow)], False, ink(leaves), 1, cv2.LINE_AA, FRACTION_BITS)
        for end in bow[2:]:
            leaf = points(end).tolist(), points([radius * 0.5, radius * 0.2]).tolist(), turn, 0, 360
            cv2.ellipse(picture, *leaf, ink(leaves), -1, cv2.LINE_AA, FRACTION_BITS)
        shade = ink(petals[rng.integers(len(petals))])
        for k in range(count):
            angle = turn + 360 * k / count
            away = centre + radius * 0.55 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
            petal = points(away).tolist(), points([radius * 0.5, radius * 0.25]).tolist(), angle, 0, 360
            cv2.ellipse(picture, *petal, shade, -1, cv2.LINE_AA, FRACTION_BITS)
        cv2.circle(picture, points(centre).tolist(), int(radius * 4), ink(hearts), -1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def writing(rng: np.random.Generator, side: int) -> Top:
    """Draw lines of letters in one or two sizes."""
    picture = sheet(cloth(rng), side)
    letters = np.array(list("abcdefghiklmnoprstuvwxyzABCDEMRST   "))
    scale = side / 240 * rng.uniform(0.25, 1.2)
    for base in np.arange(0, side + 20, 24 * scale):
        text = "".join(rng.choice(letters, 60))
        shade = ink(colour(rng, value=(0.02, 0.5)))
        origin = int(rng.uniform(-30, 5)), int(base)
        cv2.putText(picture, text, origin, int(rng.integers(0, 7)), scale, shade, 1 + (scale > 0.7), cv2.LINE_AA)
    return dried(picture)


def contours(rng: np.random.Generator, side: int) -> Top:
    """Draw a map: coloured heights with contour lines and roads."""
    height = noise(rng, side, rng.uniform(1.5, 5), 4, 0.45)
    picture = ramp(0.5 + 0.25 * height, shades(rng, 2, 5))
    lines = 1 - step(np.abs((height * rng.uniform(2, 8)) % 1 - 0.5) - 0.03, 0.06)
    picture = blend(picture, colour(rng, value=(0.05, 0.6)), lines * rng.uniform(0.2, 1))
    roads = np.exp(-((noise(rng, side, 3, 2) / 0.04) ** 2))
    return blend(picture, colour(rng), roads * float(rng.integers(0, 2)))


def halftone(rng: np.random.Generator, side: int) -> Top:
    """Draw a picture printed in dots whose size follows its darkness."""
    x, y = grid(side)
    n, turn = rng.uniform(25, 80), rng.uniform(0, np.pi)
    u, v = (x * np.cos(turn) + y * np.sin(turn)) * n, (y * np.cos(turn) - x * np.sin(turn)) * n
    screen = np.cos(2 * np.pi * u) + np.cos(2 * np.pi * v)
    tone = noise(rng, side, rng.uniform(1.5, 5), 2) * rng.uniform(0.3, 1.2)
    return ramp(step(screen + tone, 0.4), shades(rng, 2, 2))


def patchwork(rng: np.random.Generator, side: int) -> Top:
    """Draw patches of printed cloth sewn together, each with its own print."""
    n = int(rng.integers(4, 11))
    x, y = grid(side)
    column, row = np.floor(x * n).astype(int), np.floor(y * n).astype(int)
    kinds = rng.integers(0, 4, (n, n))[row, column]
    ground, print_ = rng.random((n, n, 3)).astype(np.float32)[row, column], rng.random((n, n, 3)).astype(np.float32)
    k = rng.uniform(3, 9) * n
    u, v = x * k % 1 - 0.5, y * k % 1 - 0.5
    share = np.select([kinds == 1, kinds == 2, kinds == 3], [np.hypot(u, v) < 0.3, u > 0, (u > 0) ^ (v > 0)], False)
    if rng.random() < 0.4:
        share &= (x * n % 1) > (y * n % 1)
    picture = blend(ground, print_[row, column], share.astype(np.float32))
    tone = cloth(rng)
    return (picture + (tone - picture) * np.float32(rng.uniform(0, 0.6))).astype(np.float32)


def houndstooth(rng: np.random.Generator, side: int) -> Top:
    """Draw houndstooth: broken checks of two colours."""
    x, y = grid(side)
    n = rng.uniform(6, 30)
    u, v = x * n % 1, y * n % 1
    stripe = ((u + v) * 2) % 1 < 0.5
    dark = np.where((u < 0.5) & (v < 0.5), True, np.where((u >= 0.5) & (v >= 0.5), False, stripe))
    return ramp(dark.astype(np.float32), [cloth(rng), cloth(rng)])


def argyle(rng: np.random.Generator, side: int) -> Top:
    """Draw diamonds with thin lines that cross them."""
    x, y = grid(side)
    n, slim = rng.uniform(3, 12), rng.uniform(0.5, 0.9)
    u, v = x * n + y * n * slim, x * n - y * n * slim
    colours = shades(rng, 3, 4)
    number = ((np.floor(u) + np.floor(v)) % 2 + (np.floor(u) % 2) * 0.5) / 1.5
    picture = ramp(number, colours)
    line = np.minimum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5))
    return blend(picture, colour(rng), 1 - step(line - 0.015, 0.03))


def ruled(rng: np.random.Generator, side: int) -> Top:
    """Draw a cutting mat or squared paper: fine lines and bold ones."""
    x, y = grid(side)
    n = rng.uniform(8, 50)
    every = int(rng.integers(2, 11))
    fine = np.minimum(np.abs(x * n % 1 - 0.5), np.abs(y * n % 1 - 0.5)) / n
    bold = np.minimum(np.abs(x * n / every % 1 - 0.5), np.abs(y * n / every % 1 - 0.5)) * every / n
    base, line = colour(rng), colour(rng)
    picture = blend(flat(side, base), line, (1 - step(fine, 0.003)) * rng.uniform(0.1, 0.6))
    return blend(picture, line, 1 - step(bold - 0.001, 0.004))


def bubbles(rng: np.random.Generator, side: int) -> Top:
    """Draw crowded translucent rings and discs of many sizes."""
    picture = sheet(colour(rng), side)
    colours = shades(rng, 2, 5)
    for _ in range(rng.integers(25, 90)):
        layer, centre = picture.copy(), points(rng.uniform(0, side, 2)).tolist()
        radius = int(points(side * rng.gamma(2, 0.018)))
        thick = -1 if rng.random() < 0.6 else int(rng.integers(1, 5))
        cv2.circle(layer, centre, radius, ink(colours[rng.integers(len(colours))]), thick, cv2.LINE_AA, FRACTION_BITS)
        picture = cv2.addWeighted(layer, 0.6, picture, 0.4, 0)
    return dried(picture)


def brush(rng: np.random.Generator, side: int) -> Top:
    """Draw broad strokes of a brush, each with streaks of its own."""
    picture = sheet(colour(rng), side)
    for _ in range(rng.integers(15, 70)):
        start, turn = rng.uniform(0, side, 2), rng.uniform(0, 2 * np.pi)
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        base, length, width = colour(rng), side * rng.uniform(0.05, 0.5), side * rng.uniform(0.01, 0.06)
        for offset in np.linspace(-width, width, 6):
            first = start + across * offset + along * rng.normal(0, width)
            last = first + along * length * rng.uniform(0.8, 1.1)
            shade, thick = ink(near(rng, base, 0.08)), max(int(width / 2.5), 1)
            cv2.line(picture, points(first).tolist(), points(last).tolist(), shade, thick, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def spirals(rng: np.random.Generator, side: int) -> Top:
    """Draw seeds in the spirals of a sunflower, growing outwards."""
    picture = sheet(colour(rng), side)
    colours = shades(rng, 1, 3)
    centre, gap = rng.uniform(0.2, 0.8, 2) * side, side * rng.uniform(0.012, 0.03)
    for k in range(int(min((side / gap) ** 2 * 0.5, 800))):
        radius, angle = gap * np.sqrt(k), k * 2.399963
        place = points(centre + radius * np.array([np.cos(angle), np.sin(angle)])).tolist()
        shade = ink(colours[k % len(colours)])
        cv2.circle(picture, place, int(points(gap * 0.45)), shade, -1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def newspaper(rng: np.random.Generator, side: int) -> Top:
    """Draw printed pages: columns of words, headlines and grey pictures."""
    paper, black = colour(rng, (0.08, 0.16), (0, 0.2), (0.7, 0.97)), colour(rng, saturation=(0, 0.3), value=(0.02, 0.3))
    share = np.zeros((side, side), np.float32)
    line, gutter = max(int(side * rng.uniform(0.008, 0.02)), 3), int(side * 0.02)
    width = int(side / rng.integers(3, 8))
    for left in range(0, side, width):
        top = 0
        while top < side:
            kind = rng.random()
            tall = int(side * rng.uniform(0.05, 0.2)) if kind < 0.1 else 2 * line if kind < 0.2 else line
            rows, columns = slice(top, top + int(tall * 0.65)), slice(left, left + width - gutter)
            if kind < 0.1:
                share[rows, columns] = rng.uniform(0.2, 0.8)
            else:
                words = cv2.resize((rng.random((1, width // 3)) < 0.75).astype(np.float32), (width - gutter, 1))
                share[rows, columns] = words[:, : share[rows, columns].shape[1]] * rng.uniform(0.5, 0.9)
            top += tall
    return blend(flat(side, paper), black, share)


TAUGHT = (flowers, writing, contours, patchwork, argyle, ruled, bubbles, brush)
HELD_OUT = (newspaper, houndstooth, halftone, spirals)
