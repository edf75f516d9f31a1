"""Train the segmenter on a pool of composites, without any user's label; `make segmenter` runs it.

python -m making.segmenter.train --pool FOLDER --steps 14000

Another process draws the pool meanwhile (making/segmenter/pool.py). The training waits for parts that are not there
yet, so its result does not depend on their speeds.
"""

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional as F

from making.segmenter.pool import COLOURS, EMPTY, ITEM, KNOWN, PART, SEE_THROUGH, Part, part_file, read_path_traced
from pipeline.perception.segmenter import WEIGHTS, Segmenter, network_input
from pipeline.world.layout import SIDE

SEED = 0
BATCH = 16
RATE = 3e-3  # AdamW's peak learning rate
WARM_UP = 300  # steps in which the rate rises to its peak
COOL_DOWN = 0.25  # share of the steps, the last ones, in which it falls to 0
WEIGHT_DECAY = 1e-3
REUSE = 4  # times that a picture is used on average, each time changed
FIRST_PARTS = 8  # parts drawn before training begins
REPORT_EVERY = 250  # steps
PATIENCE_S = 600  # longest wait for a part
P_PATH_TRACED = 0.18  # share of the pictures that are of the path-traced training split
PATH_TRACED = Path("rendered/pictures/train")

# Weights in the loss: outlines matter most
DICE, BETWEEN, BETWEEN_DICE, CLEAR, LOOKS_LIKE = 0.5, 0.5, 0.1, 0.1, 0.1
TYPICAL_PX, BALANCE = 200, (0.7, 2.5)  # an item's pixels weigh as the root of this area over its own, within bounds

# Changes of a picture each time it is used: turns, colours, noise, fainter items, and patterns on items
GAIN = 0.8, 1.2  # of each colour channel
MAX_LOG_GAMMA = 0.4
P_SHUFFLE = 0.5  # probability that colour channels change places
MAX_NOISE = 0.012  # standard deviation of the noise that is added [1 = white]
NOISE = np.random.default_rng(1).standard_normal(4_000_000, np.float32)  # drawn once: noise takes long to draw
P_EMPTY = 0.5  # probability that the empty table's picture is given
P_FADE, MIN_FADE = 0.3, 0.3  # probability that items and shadows become fainter, and the least share that stays
P_PATTERN = 0.18  # probability that an opaque item is painted with a fine pattern
MIN_PATTERN_PX = 60  # smallest item that is painted [pixels]

Inputs = Float[Tensor, "picture 7 100 100"]
Truth = Float[Tensor, "picture 5 100 100"]  # item, between, see-through, known, look


def change(rng: np.random.Generator, pictures: Part) -> tuple[Inputs, Truth]:
    """Return pictures as the segmenter's input and the truth, each of them changed at random."""
    n, levels = len(pictures), np.arange(256, dtype=np.float32) / 255
    colours, truth = np.empty((n, SIDE, SIDE, 6), np.float32), np.empty((n, SIDE, SIDE, 5), np.uint8)
    for i, picture in enumerate(pictures.copy()):
        paint(rng, picture)
        if rng.random() < P_FADE:
            table, share = picture[..., EMPTY].astype(np.float32), rng.uniform(MIN_FADE, 1)
            picture[..., COLOURS] = np.rint(table + share * (picture[..., COLOURS] - table))
        turned = np.rot90(picture, int(rng.integers(4)))
        turned = turned[:, ::-1] if rng.random() < 0.5 else turned
        truth[i] = turned[..., ITEM:]
        gamma = math.exp(rng.uniform(-MAX_LOG_GAMMA, MAX_LOG_GAMMA))
        order = rng.permutation(3) if rng.random() < P_SHUFFLE else range(3)
        for channel, source in enumerate(order):
            curve = levels**gamma * np.float32(rng.uniform(*GAIN))
            for first in (0, 3):  # the picture, and the empty table's
                colours[i, ..., first + channel] = curve[turned[..., first + source]]
    first = rng.integers(len(NOISE) - colours.size)
    noise = NOISE[first : first + colours.size].reshape(colours.shape)
    colours += noise * rng.uniform(0, MAX_NOISE, (n, 1, 1, 1)).astype(np.float32)
    np.clip(colours, 0, 1, out=colours)
    inputs = network_input(colours[..., :3], colours[..., 3:])
    inputs[torch.from_numpy(rng.random(n) >= P_EMPTY), 3:] = 0
    return inputs, torch.from_numpy(truth).permute(0, 3, 1, 2).float()


def paint(rng: np.random.Generator, picture: Array) -> None:
    """Paint stripes, checks, rays or rings on some opaque items: an item is known by its outline, not by its texture.

    See-through and small items stay as they are, and so do path-traced ones, whose outlines are not known.
    """
    if not picture[..., KNOWN].all():
        return
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(picture[..., ITEM], connectivity=4)
    for k in range(1, count):
        left, top, width, height, area = stats[k]
        window = picture[top : top + height, left : left + width]
        item = labels[top : top + height, left : left + width] == k
        if area < MIN_PATTERN_PX or rng.random() > P_PATTERN or window[..., SEE_THROUGH][item].mean() > 0.5:
            continue
        y, x = np.mgrid[:height, :width] - (centroids[k][::-1] - (top, left))[:, None, None]
        share = _pattern(rng, x, y)
        if rng.random() < 0.4:  # a middle, or a rim, of one colour
            share[np.hypot(x, y) < rng.uniform(0.3, 0.8) * np.sqrt(area / np.pi)] = rng.integers(2)
        first = rng.uniform(0, 255, 3)
        second = rng.uniform(0, 255, 3) if rng.random() < 0.6 else first + rng.normal(0, 90, 3)
        colour = second + share[..., None] * (first - second)
        opacity = rng.uniform(0.3, 1) * item[..., None]
        window[..., COLOURS] = np.clip(np.rint(window[..., COLOURS] * (1 - opacity) + opacity * colour), 0, 255)


def _pattern(rng: np.random.Generator, x: Array, y: Array) -> Array:
    """Return the share of the first of two colours at each place [pixels from the item's middle]."""
    turn, frequency = rng.uniform(0, np.pi), 2 * np.pi / rng.uniform(2.2, 9)
    u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    wave = (
        lambda: np.sin(frequency * u),
        lambda: np.sin(frequency * u) * np.sin(frequency * v),
        lambda: np.sin(rng.integers(5, 24) * np.arctan2(y, x) + turn),
        lambda: np.sin(frequency * np.hypot(x, y) + turn),
    )[rng.integers(4)]()
    return np.clip(0.5 + rng.uniform(0.5, 3) * wave, 0, 1)


def loss(outputs: Float[Tensor, "picture 9 100 100"], truth: Truth) -> Tensor:
    """Return cross-entropy and Dice loss of items and gaps, plus the cross-entropy of what is said of items' pixels."""
    truth, known, look = truth[:, :3], truth[:, 3], truth[:, 4].long()
    log_odds, looks = outputs[:, :3], outputs[:, 3:]
    entropy = F.binary_cross_entropy_with_logits(log_odds, truth, reduction="none")
    looks_like = F.cross_entropy(looks, look - 1, ignore_index=-1)
    weight = known * balance(truth[:, 0])
    item, between = (weight * entropy[:, 0]).mean(), (known * entropy[:, 1]).mean()
    see_through = (entropy[:, 2] * truth[:, 0]).sum() / truth[:, 0].sum().clamp(min=1)
    weights, p = torch.stack([weight, known], 1), log_odds[:, :2].sigmoid()
    both = (weights * p * truth[:, :2]).sum((0, 2, 3))
    either = (weights * (p + truth[:, :2])).sum((0, 2, 3))
    dice = 1 - (2 * both + 1) / (either + 1)
    shape = item + DICE * dice[0] + BETWEEN * between + BETWEEN_DICE * dice[1]
    return shape + CLEAR * see_through + LOOKS_LIKE * looks_like


def balance(item: Float[Tensor, "picture 100 100"]) -> Float[Tensor, "picture 100 100"]:
    """Return weights of pixels: those of small and thin items count more, those of the table 1."""
    weights = np.ones(item.shape, np.float32)
    for weight, mask in zip(weights, item.numpy().astype(np.uint8), strict=True):
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        of_region = np.sqrt(TYPICAL_PX / stats[:, cv2.CC_STAT_AREA]).clip(*BALANCE).astype(np.float32)
        of_region[0] = 1
        weight[:] = of_region[labels]
    return torch.from_numpy(weights)


def batches(rng: np.random.Generator, pool: Path) -> Iterator[Part]:
    """Yield batches from a growing number of parts, so that each picture is used REUSE times on average."""
    parts: list[Part] = []
    path_traced = read_path_traced(PATH_TRACED)
    step = 0
    while True:
        while len(parts) < max(FIRST_PARTS, math.ceil(step * BATCH / (PART * REUSE))):
            path, asked = part_file(pool, len(parts)), time.monotonic()
            while not path.exists():
                if time.monotonic() - asked > PATIENCE_S:
                    raise SystemExit(
                        f"error: {path} did not come: the pool's process has ended, or has too few --parts"
                    )
                time.sleep(1)
            parts.append(np.load(path, mmap_mode="r"))
        chosen = rng.integers(len(parts) * PART, size=BATCH)
        pictures = np.stack([parts[i // PART][i % PART] for i in chosen])
        replaced = rng.random(BATCH) < P_PATH_TRACED
        pictures[replaced] = path_traced[rng.integers(len(path_traced), size=replaced.sum())]
        yield pictures
        step += 1


def train(pool: Path, out: Path, steps: int) -> list[float]:
    """Train for `steps` steps and return the losses; write the weights at the end."""
    torch.manual_seed(SEED)
    rng = np.random.default_rng(SEED)
    segmenter = Segmenter(normalised=True).to(memory_format=torch.channels_last)  # pyright: ignore
    optimiser = torch.optim.AdamW(segmenter.parameters(), lr=RATE, weight_decay=WEIGHT_DECAY, fused=True)
    losses, began = [], time.monotonic()
    for step, pictures in zip(range(steps), batches(rng, pool), strict=False):
        optimiser.param_groups[0]["lr"] = RATE * min(step / WARM_UP, 1, (1 - step / steps) / COOL_DOWN)
        inputs, truth = change(rng, pictures)
        objective = loss(segmenter(inputs), truth)
        optimiser.zero_grad()
        objective.backward()
        optimiser.step()
        losses.append(float(objective.detach()))
        if len(losses) % REPORT_EVERY == 0 or len(losses) == steps:
            mean = np.mean(losses[-REPORT_EVERY:])
            print(f"{len(losses)} of {steps} steps, {time.monotonic() - began:.0f} s, loss {mean:.4f}", flush=True)
    save(segmenter, out)
    return losses


@torch.no_grad()
def folded(segmenter: Segmenter) -> Segmenter:
    """Return the same function with each batch normalisation folded into the convolution before it."""
    plain = Segmenter()
    state = {name: value for name, value in segmenter.state_dict().items() if name in plain.state_dict()}
    for name, module in segmenter.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            stem, position = name.rsplit(".", 1)
            convolution = f"{stem}.{int(position) - 1}"
            gain = module.weight * (module.running_var + module.eps).rsqrt()  # pyright: ignore
            weight, before = (segmenter.get_parameter(f"{convolution}.{part}") for part in ("weight", "bias"))
            state[f"{convolution}.weight"] = weight * gain[:, None, None, None]
            state[f"{convolution}.bias"] = (before - module.running_mean) * gain + module.bias  # pyright: ignore
    plain.load_state_dict(state)
    return plain


def save(segmenter: Segmenter, path: Path) -> None:
    """Write the weights in half precision, without batch normalisation."""
    state = folded(segmenter).state_dict()
    partial = path.with_suffix(".partial")
    save_file({name: value.half().contiguous() for name, value in state.items()}, partial)
    partial.rename(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pool", type=Path, required=True, help="folder of the composites")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--out", type=Path, default=WEIGHTS, help="file for the weights")
    arguments = parser.parse_args()
    torch.set_num_threads(2)  # once the pool is drawn, its core is free
    train(arguments.pool, arguments.out, arguments.steps)
