"""Train the segmenter on a pool of composites, without any user's label; `make segmenter` runs it.

python -m studies.perception.train --pool FOLDER --steps 14000

Another process draws the pool meanwhile (studies/perception/draw.py). The training waits for parts that are not there
yet, so its result does not depend on their speeds.
"""

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from safetensors.torch import save_file
from torch import Tensor
from torch.nn import functional as F

from pipeline.perception.segmenter import WEIGHTS, Segmenter, network_input
from pipeline.world.layout import SIDE
from studies.perception.pool import PART, Part, part_file

SEED = 0
BATCH = 16
RATE = 3e-3  # AdamW's peak learning rate
WARM_UP = 300  # steps in which the rate rises to its peak
COOL_DOWN = 0.25  # share of the steps, the last ones, in which it falls to 0
WEIGHT_DECAY = 1e-3
REUSE = 8  # times that a picture is used on average, each time changed
FIRST_PARTS = 8  # parts drawn before training begins
CHECKPOINT_EVERY = 250  # steps

# What is changed in a picture each time
GAIN = 0.8, 1.2  # of each colour channel
MAX_LOG_GAMMA = 0.4
P_SHUFFLE = 0.5  # probability that colour channels change places
MAX_NOISE = 0.012  # standard deviation of the noise that is added [1 = white]
NOISE = np.random.default_rng(1).standard_normal(4_000_000, np.float32)  # drawn once: noise takes long to draw
P_EMPTY = 0.5  # probability that the empty table's picture is given

# Weights in the loss: outlines matter most
DICE, BETWEEN, BETWEEN_DICE, SEE_THROUGH = 0.5, 0.5, 0.1, 0.1

Inputs = Float[Tensor, "picture 7 100 100"]
Truth = Float[Tensor, "picture 3 100 100"]


def change(rng: np.random.Generator, pictures: Part) -> tuple[Inputs, Truth]:
    """Return pictures as the segmenter's input and the truth, each turned, mirrored, recoloured and with more noise."""
    n, levels = len(pictures), np.arange(256, dtype=np.float32) / 255
    colours, truth = np.empty((n, SIDE, SIDE, 6), np.float32), np.empty((n, SIDE, SIDE, 3), np.uint8)
    for i, picture in enumerate(pictures):
        turned = np.rot90(picture, int(rng.integers(4)))
        turned = turned[:, ::-1] if rng.random() < 0.5 else turned
        truth[i] = turned[..., 6:]
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


def loss(log_odds: Float[Tensor, "picture 3 100 100"], truth: Truth) -> Tensor:
    """Return cross-entropy and Dice loss of items and gaps, plus the cross-entropy of see-through on items' pixels."""
    entropy = F.binary_cross_entropy_with_logits(log_odds, truth, reduction="none")
    item, between, _ = entropy.mean((0, 2, 3))
    see_through = (entropy[:, 2] * truth[:, 0]).sum() / truth[:, 0].sum().clamp(min=1)
    p = log_odds[:, :2].sigmoid()
    both, either = (p * truth[:, :2]).sum((0, 2, 3)), (p + truth[:, :2]).sum((0, 2, 3))
    dice = 1 - (2 * both + 1) / (either + 1)
    return item + DICE * dice[0] + BETWEEN * between + BETWEEN_DICE * dice[1] + SEE_THROUGH * see_through


def batches(rng: np.random.Generator, pool: Path) -> Iterator[Part]:
    """Yield batches from a growing number of parts, so that each picture is used REUSE times on average."""
    parts: list[Part] = []
    step = 0
    while True:
        while len(parts) < max(FIRST_PARTS, math.ceil(step * BATCH / (PART * REUSE))):
            path = part_file(pool, len(parts))
            while not path.exists():
                time.sleep(1)
            parts.append(np.load(path, mmap_mode="r"))
        chosen = rng.integers(len(parts) * PART, size=BATCH)
        yield np.stack([parts[i // PART][i % PART] for i in chosen])
        step += 1


def train(pool: Path, out: Path, steps: int) -> list[float]:
    """Train for `steps` steps and return the losses; write the weights every CHECKPOINT_EVERY steps and at the end."""
    torch.manual_seed(SEED)
    rng = np.random.default_rng(SEED)
    segmenter = Segmenter(normalised=True).to(memory_format=torch.channels_last)  # pyright: ignore
    optimiser = torch.optim.AdamW(segmenter.parameters(), lr=RATE, weight_decay=WEIGHT_DECAY, fused=True)
    losses, began = [], time.monotonic()
    for step, pictures in enumerate(batches(rng, pool)):
        optimiser.param_groups[0]["lr"] = RATE * min(step / WARM_UP, 1, (1 - step / steps) / COOL_DOWN)
        inputs, truth = change(rng, pictures)
        with torch.autocast("cpu", torch.bfloat16):
            log_odds = segmenter(inputs)
        objective = loss(log_odds.float(), truth)
        optimiser.zero_grad()
        objective.backward()
        optimiser.step()
        losses.append(float(objective.detach()))
        if len(losses) % CHECKPOINT_EVERY == 0 or len(losses) == steps:
            save(segmenter, out)
            mean = np.mean(losses[-CHECKPOINT_EVERY:])
            print(f"{len(losses)} of {steps} steps, {time.monotonic() - began:.0f} s, loss {mean:.4f}", flush=True)
        if len(losses) == steps:
            return losses
    raise AssertionError("batches never end")


def save(segmenter: Segmenter, path: Path) -> None:
    """Write the weights in half precision, without batch normalisation."""
    state = segmenter.folded().state_dict()
    partial = path.with_suffix(".partial")
    save_file({name: value.half().contiguous() for name, value in state.items()}, partial)
    partial.rename(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pool", type=Path, required=True, help="folder of the composites")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--out", type=Path, default=WEIGHTS, help="file for the weights")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    train(arguments.pool, arguments.out, arguments.steps)
