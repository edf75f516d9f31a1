"""Train the segmenter on a pool of composites, without any user's label; `make segmenter` runs it.

python -m making.segmenter.train --pool FOLDER --steps 11000

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
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional as F

from making.segmenter.changes import Truth, change
from making.segmenter.pool import PART, Part, part_file, read_path_traced
from pipeline.perception.segmenter import WEIGHTS, Segmenter

SEED = 0
BATCH = 16
RATE = 3e-3  # AdamW's peak learning rate
WARM_UP = 300  # steps in which the rate rises to its peak
COOL_DOWN = 0.25  # share of the steps, the last ones, in which it falls to 0
WEIGHT_DECAY = 1e-3
REUSE = 8  # times that a picture is used on average, each time changed
FIRST_PARTS = 8  # parts drawn before training begins
CHECKPOINT_EVERY = 250  # steps
P_PATH_TRACED = 0.14  # share of the pictures that are of the path-traced training split
PATH_TRACED = Path("rendered/pictures/train")

# Weights in the loss: outlines matter most
DICE, BETWEEN, BETWEEN_DICE, SEE_THROUGH = 0.5, 0.5, 0.1, 0.1
TYPICAL_PX, BALANCE = 200, (0.7, 2.5)  # an item's pixels weigh as the root of this area over its own, within bounds


def loss(log_odds: Float[Tensor, "picture 3 100 100"], truth: Truth) -> Tensor:
    """Return cross-entropy and Dice loss of items and gaps, plus the cross-entropy of see-through on items' pixels."""
    truth, known = truth[:, :3], truth[:, 3]
    entropy = F.binary_cross_entropy_with_logits(log_odds, truth, reduction="none")
    weight = known * balance(truth[:, 0])
    item, between = (weight * entropy[:, 0]).mean(), (known * entropy[:, 1]).mean()
    see_through = (entropy[:, 2] * truth[:, 0]).sum() / truth[:, 0].sum().clamp(min=1)
    weights, p = torch.stack([weight, known], 1), log_odds[:, :2].sigmoid()
    both = (weights * p * truth[:, :2]).sum((0, 2, 3))
    either = (weights * (p + truth[:, :2])).sum((0, 2, 3))
    dice = 1 - (2 * both + 1) / (either + 1)
    return item + DICE * dice[0] + BETWEEN * between + BETWEEN_DICE * dice[1] + SEE_THROUGH * see_through


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
            path = part_file(pool, len(parts))
            while not path.exists():
                time.sleep(1)
            parts.append(np.load(path, mmap_mode="r"))
        chosen = rng.integers(len(parts) * PART, size=BATCH)
        pictures = np.stack([parts[i // PART][i % PART] for i in chosen])
        replaced = rng.random(BATCH) < P_PATH_TRACED
        pictures[replaced] = path_traced[rng.integers(len(path_traced), size=replaced.sum())]
        yield pictures
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
        objective = loss(segmenter(inputs), truth)
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
    torch.set_num_threads(1)
    train(arguments.pool, arguments.out, arguments.steps)
