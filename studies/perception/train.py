"""Train the segmenter on a pool of composites, without any user's label: `make segmenter`.

    python -m studies.perception.train --pool FOLDER [--minutes 45]

A second process draws the pool (studies/perception/draw.py). Step by step the training uses more of it, and waits for parts that are not there yet.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from safetensors.torch import save_file
from torch import Tensor
from torch.nn import functional as F

from pipeline.perception.segmenter import Segmenter, network_input
from studies.perception.pool import PART, Part, part_file

SEED = 0
BATCH = 32
RATE = 4e-3  # AdamW's peak learning rate
WEIGHT_DECAY = 1e-3
REUSE = 4  # times that a picture is used on average, each time changed
FIRST_PARTS = 4  # parts drawn before training begins
GAIN = 0.8, 1.2  # of each colour channel
MAX_LOG_GAMMA = 0.4
P_SHUFFLE = 0.5  # probability that colour channels change places
MAX_NOISE = 0.012  # standard deviation of the noise that is added [1 = white]
NOISE = np.random.default_rng(1).standard_normal(4_000_000, np.float32)  # drawn once: noise takes long to draw
P_EMPTY = 0.5  # probability that the empty table's picture is given
SEE_THROUGH_WEIGHT = 0.1  # weight of the third map in the loss: outlines matter more
CHECKPOINT_EVERY = 250  # steps


def change(
    rng: np.random.Generator, pictures: Part
) -> tuple[Float[Tensor, "picture 7 100 100"], Float[Tensor, "picture 3 100 100"]]:
    """Return pictures as the segmenter's input and the truth, each turned, mirrored, recoloured and with more noise."""
    n, levels = len(pictures), np.arange(256, dtype=np.float32) / 255
    colours, truth = np.empty((n, 100, 100, 6), np.float32), np.empty((n, 100, 100, 3), np.uint8)
    for i, picture in enumerate(pictures):
        turned = np.rot90(picture, rng.integers(4))
        turned = turned[:, ::-1] if rng.random() < 0.5 else turned
        truth[i] = turned[..., 6:]
        gamma = math.exp(rng.uniform(-MAX_LOG_GAMMA, MAX_LOG_GAMMA))
        order = rng.permutation(3) if rng.random() < P_SHUFFLE else range(3)
        for channel, source in enumerate(order):
            curve = levels**gamma * np.float32(rng.uniform(*GAIN))
            colours[i, ..., channel], colours[i, ..., channel + 3] = (
                curve[turned[..., source]],
                curve[turned[..., source + 3]],
            )
    first = rng.integers(len(NOISE) - colours.size)
    noise = NOISE[first : first + colours.size].reshape(colours.shape)
    colours += noise * rng.uniform(0, MAX_NOISE, (n, 1, 1, 1)).astype(np.float32)
    np.clip(colours, 0, 1, out=colours)
    inputs = network_input(colours[..., :3], colours[..., 3:])
    inputs[torch.from_numpy(rng.random(len(pictures)) >= P_EMPTY), 3:] = 0
    return inputs, torch.from_numpy(truth).permute(0, 3, 1, 2).float()


def loss(log_odds: Float[Tensor, "picture 3 100 100"], truth: Float[Tensor, "picture 3 100 100"]) -> Tensor:
    """Return cross-entropy and Dice of items and gaps, and the cross-entropy of what items are made of."""
    entropy = F.binary_cross_entropy_with_logits(log_odds, truth, reduction="none").mean((0, 2, 3))
    p = log_odds[:, :2].sigmoid()
    overlap, total = (p * truth[:, :2]).sum((0, 2, 3)), (p + truth[:, :2]).sum((0, 2, 3))
    dice = 1 - (2 * overlap + 1) / (total + 1)
    weight = truth[:, 0]
    material = F.binary_cross_entropy_with_logits(log_odds[:, 2], truth[:, 2], weight) / weight.mean().clamp(min=1e-3)
    return entropy[0] + 0.5 * dice[0] + 0.5 * entropy[1] + 0.1 * dice[1] + SEE_THROUGH_WEIGHT * material


def save(segmenter: Segmenter, path: Path) -> None:
    """Write the weights in half precision, without batch normalisation."""
    state = segmenter.folded().state_dict()
    save_file({name: value.half().contiguous() for name, value in state.items()}, path)


def train(pool: Path, out: Path, steps: int) -> None:
    """Train for `steps` steps; write the weights to `out` every CHECKPOINT_EVERY steps and at the end."""
    torch.manual_seed(SEED)
    rng = np.random.default_rng(SEED)
    segmenter = Segmenter(normalised=True).to(memory_format=torch.channels_last)  # pyright: ignore
    optimiser = torch.optim.AdamW(segmenter.parameters(), lr=RATE, weight_decay=WEIGHT_DECAY, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps, pct_start=0.15)
    parts: list[Part] = []
    began, running = time.monotonic(), 0.0
    for step in range(steps):
        while len(parts) * PART * REUSE < step * BATCH or len(parts) < FIRST_PARTS:
            path = part_file(pool, len(parts))
            while not path.exists():
                time.sleep(1)
            parts.append(np.load(path, mmap_mode="r"))
        chosen = rng.integers(len(parts) * PART, size=BATCH)
        inputs, truth = change(rng, np.stack([parts[i // PART][i % PART] for i in chosen]))
        with torch.autocast("cpu", torch.bfloat16):
            log_odds = segmenter(inputs)
        objective = loss(log_odds.float(), truth)
        optimiser.zero_grad()
        objective.backward()
        optimiser.step()
        schedule.step()
        running = 0.98 * running + 0.02 * float(objective.detach())
        if step % 50 == 49:
            print(
                f"{step + 1} steps, {time.monotonic() - began:.0f} s, loss {running / (1 - 0.98 ** (step + 1)):.4f}, parts {len(parts)}",
                flush=True,
            )
        if step % CHECKPOINT_EVERY == CHECKPOINT_EVERY - 1 or step == steps - 1:
            save(segmenter, out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, required=True)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    train(arguments.pool, arguments.out, arguments.steps)
