"""The segmenter: a small U-Net (Ronneberger et al., 2015) that marks the items in a table image.

It was trained once, without any user's labels, on composites (making/segmenter); its weights are part of the package.
"""

from functools import cache
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn import functional as F

from pipeline.runtime.errors import InputError
from pipeline.world.layout import SIDE

WEIGHTS = Path(__file__).with_name("segmenter.safetensors")
CHANNELS = 32, 64, 128, 192  # at 1/2, 1/4, 1/8 and 1/16 of the image's resolution
MAPS = ("item", "between", "see_through")  # what the first outputs say of a pixel, see `Maps`
LOOKS = ("bowl", "plate", "cutlery", "cup", "bottle", "other")  # what an item looks like: the other outputs
INPUTS = 7  # colours, differences from the empty table's colours, and whether that is known
TURNS, AXES = 3, (-2, -1)  # the outputs are means over an image's first quarter turns: one takes 12 ms
OUTLINE = 0.35  # probability on an outline: at .5 some handles are missed (validation)
# Chosen on validation photographs; on path-traced validation tops the second view changes nothing
NEAR_PX = 200  # a region larger than this is a large item: the image is segmented at half its size, too [pixels]
LARGE_PX = 500  # of the regions at half the size, those larger than this are averaged [pixels of the image]
# A close-up (docs/decisions/035-close-ups.md): items sum to more, and a region at two thirds of the size is larger
MANY_PX, CLOSE_UP_PX = 400, 575
STRIDE = 3  # median and spread are those of every third row and column
Pictures = Float32[Array, "scene 100 100 3"]  # [1 = white]
MIN_SPREAD = 4 / 255  # smallest standard deviation by which colours are divided [1 = white]: sensor noise


class Maps(NamedTuple):
    """Hold what the segmenter says of each pixel, as probabilities in steps of 1 / 255."""

    item: Float32[Array, "row column"]  # an item covers it
    between: Float32[Array, "row column"]  # two items are within two pixels
    see_through: Float32[Array, "row column"]  # the item there, if any, lets the table show through
    looks: Float32[Array, "look row column"]  # what the item there, if any, looks like, of LOOKS


class Segmenter(nn.Module):
    """A U-Net on squares of 2 x 2 pixels: fewer positions make it fast, and no pixel is lost.

    `normalised` adds batch normalisation, for training (making/segmenter/train.py).
    """

    def __init__(self, normalised: bool = False):
        super().__init__()
        widths = (4 * INPUTS, *CHANNELS)
        self.down = nn.ModuleList(_two_layers(a, b, normalised) for a, b in pairwise(widths))
        self.lift = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(CHANNELS))
        self.up = nn.ModuleList(_two_layers(a, a, normalised) for a in CHANNELS[:-1])
        self.head = nn.Conv2d(CHANNELS[0], 4 * len(MAPS + LOOKS), 1)

    def forward(self, inputs: Float[Tensor, "scene 7 row column"]) -> Float[Tensor, "scene 9 row column"]:
        """Return the log-odds of each of MAPS, and the unnormalised log-probabilities of LOOKS."""
        x, skipped = F.pixel_unshuffle(inputs, 2), []  # (scene, 28, 50, 50)
        for depth, layers in enumerate(self.down):
            x = layers(F.max_pool2d(x, 2, ceil_mode=True) if depth else x)
            skipped.append(x)
        for lift, layers, fine in reversed(list(zip(self.lift, self.up, skipped, strict=False))):
            x = layers(fine + F.interpolate(lift(x), fine.shape[-2:], mode="bilinear"))
        return F.pixel_shuffle(self.head(x), 2)


def _two_layers(inputs: int, outputs: int, normalised: bool) -> nn.Sequential:
    layers = []
    for width in (inputs, outputs):
        layers += [nn.Conv2d(width, outputs, 3, padding=1), nn.BatchNorm2d(outputs) if normalised else nn.Identity()]
        layers += [nn.ReLU()]
    return nn.Sequential(*layers)


def network_input(images: Pictures, empty: Pictures | None) -> Float[Tensor, "scene 7 100 100"]:
    """Return images [1 = white] as the segmenter's input: relative to their own median and spread.

    `empty`: the same tables without items, in the same light; None where there is no such picture.
    """
    sample = np.ascontiguousarray(images[:, ::STRIDE, ::STRIDE].reshape(len(images), -1, 3).swapaxes(1, 2))
    spread = np.maximum(sample.std(-1).mean(-1), MIN_SPREAD)[:, None, None, None]
    inputs = np.zeros((*images.shape[:3], INPUTS), np.float32)
    inputs[..., :3] = (images - np.median(sample, -1)[:, None, None]) / spread
    if empty is not None:
        inputs[..., 3:6], inputs[..., 6] = (images - empty) / spread, 1
    return torch.from_numpy(inputs).permute(0, 3, 1, 2)  # in channels-last memory format


@torch.inference_mode()
def segment(image: UInt8[Array, "100 100 3"], empty: UInt8[Array, "100 100 3"] | None = None) -> Maps:
    """Return the maps of one image; images are segmented one by one, so that they never change each other's bits.

    Where an item is large, the camera is nearer than in most of the training: the image is segmented at half its size,
    too, and what both say is averaged in the large items that show there. In a close-up without a picture of the empty
    table, the surer of both counts at each pixel, and both are means over all eight turned and mirrored images.
    """
    pictures = [image] if empty is None else [image, empty]
    outputs = _outputs(pictures)
    near = empty is None and outputs[0].sigmoid().sum() > MANY_PX
    if near and _large(_far(pictures, 2 / 3, every=True), CLOSE_UP_PX).any():
        outputs = torch.maximum(_outputs(pictures, every=True), _far(pictures, 1 / 2, every=True))
    elif _large(outputs, NEAR_PX).any():
        far = _far(pictures, 1 / 2)
        large = cv2.dilate(_large(far, LARGE_PX), np.ones((7, 7), np.uint8)) > 0  # with what is just beside them
        outputs = torch.where(torch.from_numpy(large), (outputs + far) / 2, outputs)
    item, between, see_through = outputs[: len(MAPS)].sigmoid().mul(255).round().div(255).numpy()
    return Maps(item, between, see_through, outputs[len(MAPS) :].softmax(0).numpy())


def _outputs(pictures: list[UInt8[Array, "100 100 3"]], every: bool = False) -> Float[Tensor, "9 row column"]:
    """Return the segmenter's outputs for a picture, followed or not by the empty table's.

    They are means over TURNS quarter turns; `every`: over all four and those of the mirrored picture.
    """
    image, *empty = (picture[None] / np.float32(255) for picture in pictures)
    inputs = network_input(image, *empty or [None])
    views = [(k, False) for k in range(TURNS)] if not every else list(product(range(4), (False, True)))
    return torch.stack([_view(inputs, *view) for view in views]).mean(0)


def _view(inputs: Float[Tensor, "1 7 row column"], turns: int, mirrored: bool) -> Float[Tensor, "9 row column"]:
    """Return the outputs of a picture that is turned and then mirrored, as they lie in the picture as it is."""
    mirror = [-1] if mirrored else []
    outputs = read_segmenter()(torch.rot90(inputs, turns, AXES).flip(mirror)).flip(mirror)
    return torch.rot90(outputs, -turns, AXES)[0]


def _far(pictures: list[UInt8[Array, "100 100 3"]], share: float, every: bool = False) -> Float[Tensor, "9 row column"]:
    """Return the outputs for pictures at a share of their size, with their edges continued."""
    side = round(share * SIDE)
    edge = (SIDE - side) // 2, SIDE - side - (SIDE - side) // 2
    small = [cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA) for picture in pictures]
    far = _outputs([cv2.copyMakeBorder(x, *edge, *edge, cv2.BORDER_REPLICATE) for x in small], every)
    inner = slice(edge[0], edge[0] + side)
    return F.interpolate(far[None, :, inner, inner], (SIDE, SIDE), mode="bilinear")[0]


def _large(outputs: Float[Tensor, "9 row column"], pixels: int) -> UInt8[Array, "row column"]:
    """Return where regions of more than so many pixels are items."""
    inside = (outputs[0].sigmoid() > OUTLINE).numpy().astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] > pixels
    large[0] = False  # the table
    return large.astype(np.uint8)[labels.astype(int)]


@cache
def read_segmenter(path: Path = WEIGHTS) -> Segmenter:
    """Return the trained segmenter, read once per process; raise InputError if its weights are missing or damaged."""
    again = "restore it with `git checkout`, install the package again, or train it by `make segmenter`"
    if not path.is_file():
        raise InputError(f"{path} is missing: {again}")
    segmenter = Segmenter()
    try:
        segmenter.load_state_dict({name: value.float() for name, value in load_file(path).items()})
    except (SafetensorError, RuntimeError) as error:
        why = str(error).split("\n")[0]
        raise InputError(f"{path} does not hold this segmenter's weights ({why}): {again}") from error
    return segmenter.eval().to(memory_format=torch.channels_last)  # pyright: ignore
