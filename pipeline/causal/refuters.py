"""Attempts to refute the effects: questions whose true answer is "nothing", whatever the users mind.

Two answers are kept apart. Where a model could learn nothing about its scenes, a sound machinery finds nothing. And an
effect that is what it claims to be stays where only the table top or the choice of scenes changes, and is absent where
no item is added or none comes near.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped, UInt8
from numpy import ndarray as Array

from pipeline.stats.clusters import by_item
from pipeline.stats.crossed import add_pseudo_scenes, estimate, holm, verdict

PATCHES = {"placebo": 1, "mosaic": 2}  # refuters that show an item's shuffled pieces: pixels along a piece's side

MACHINERY, EFFECT = "is the machinery sound", "does the effect survive"


@dataclass(frozen=True)
class Refuter:
    """What is done, the question it serves, its null hypothesis, and what a p-value of it says."""

    done: str
    asks: str
    null: str
    reading: str


REFUTERS = {
    "permuted": Refuter(
        "the labels of the demonstrations are permuted before training",
        MACHINERY,
        "A model trained on permuted labels shows no effect.",
        "A small p means that the machinery finds effects where there was nothing to learn.",
    ),
    "untrained": Refuter(
        "the model is left as it was initialised",
        MACHINERY,
        "Untrained models show, on average, no effect.",
        "A small p means that the architecture reacts to an added item, one way, before it has learned anything.",
    ),
    "placebo": Refuter(
        "the pixels that an added item changed are shuffled among themselves: same outline, colours and contrast, "
        "no item",
        EFFECT,
        "A patch with an item's outline that shows no item has no effect.",
        "A small p means that the model reacts to something of that outline lying there, not to what it is.",
    ),
    "mosaic": Refuter(
        f"the same with pieces of {PATCHES['mosaic']} by {PATCHES['mosaic']} pixels; single ones where none fits in",
        EFFECT,
        "A mosaic of an item's pieces that shows no item has no effect.",
        "A small p means that the model takes for an item what looks like one closely and not as a whole.",
    ),
    "far": Refuter(
        "an item is added, and only paths that stay far away from it are judged",
        EFFECT,
        "An added item has no effect on paths far away from it.",
        "A small p means that the model's reaction is not tied to the place of the item.",
    ),
    "other_table": Refuter(
        "scenes and added items are pictured again on a table top never seen, under another light; each top by itself, "
        "since chance is over scenes and so few tops say nothing of others",
        EFFECT,
        "The effect is the same on this other table.",
        "A small p means that the effect depends on the table top or its light.",
    ),
}


def placebo(
    rng: np.random.Generator,
    before: UInt8[Array, "scene 100 100 3"],
    after: UInt8[Array, "scene 100 100 3"],
    piece: int = 1,
) -> UInt8[Array, "scene 100 100 3"]:
    """`after`, the pixels in which it differs from `before` shuffled among themselves within each scene.

    In squares of `piece` pixels a side, where all of a square has changed; what is left at the rim by single pixels.
    """
    patched = before.copy()
    for picture, old, new in zip(patched, before, after, strict=True):
        changed = (old != new).any(-1, keepdims=True)
        whole = _squares(changed, piece).all((2, 3, 4))
        rest = changed[..., 0] & ~np.repeat(np.repeat(whole, piece, 0), piece, 1)
        _squares(picture, piece)[whole] = rng.permutation(_squares(new, piece)[whole])
        picture[rest] = rng.permutation(new[rest])
    return patched


def _squares(picture: Shaped[Array, "row column channel"], side: int) -> Shaped[Array, "down across _ _ channel"]:
    """A picture's squares of `side` pixels: a view."""
    rows, columns, channels = picture.shape
    return picture.reshape(rows // side, side, columns // side, side, channels).swapaxes(1, 2)


def mean_over(p: Float[Array, "*#b path"], chosen: Bool[Array, "*#b path"]) -> Float[Array, "*b_all"]:
    """E[V] over the chosen paths alone; NaN where none is."""
    count = chosen.sum(-1)
    total = np.where(chosen, p, 0.0).sum(-1, dtype=np.float64)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=np.broadcast_to(count > 0, total.shape))


def halves(
    rng: np.random.Generator, effects: Float[Array, "cell seed scene"], splits: int
) -> tuple[Float[Array, " cell"], Float[Array, " cell"]]:
    """Over random halves of the scenes: the share whose verdict is the whole's, and how far their effects spread.

    The spread is the standard deviation of the halves' mean effects. Halves are drawn at random, so no hypothesis is
    tested: they show on how many scenes a verdict hangs. ValueError for fewer than four scenes.
    """
    scenes = effects.shape[-1]
    if scenes < 4 or splits < 2:
        raise ValueError(f"{scenes} scenes in {splits} splits: expected at least 4 scenes and 2 splits")
    whole, kept, means = _verdicts(add_pseudo_scenes(effects)), np.zeros(len(effects)), []
    for _ in range(splits):
        half = effects[..., rng.permutation(scenes)[: scenes // 2]]
        kept += np.array(_verdicts(add_pseudo_scenes(half))) == whole
        means.append(half.mean((1, 2)))
    return kept / splits, np.std(means, axis=0)


def stays_over_items(effects: Float[Array, "cell seed scene"], item: Int[Array, "cell scene"]) -> Bool[Array, " cell"]:
    """Whether each verdict stays if items (`item`: which one was added) take the place of scenes as a source of chance.

    An effect has to hold from item to item then, and not only for these items in other scenes. Items are too few for
    `add_pseudo_scenes`.
    """
    clustered = [by_item(e[..., None], i)[None, ..., 0] for e, i in zip(effects, item, strict=True)]
    return np.array(_verdicts(add_pseudo_scenes(effects))) == _verdicts(*clustered)


def _verdicts(*effects: Float[Array, "cell seed _"]) -> list[str]:
    """Of one family, whose cells need not have as many scenes, or items."""
    several = [estimate(e) for e in effects]
    effect, p, low, high = (
        np.concatenate([getattr(e, name) for e in several]) for name in ("effect", "p", "ci90_low", "ci90_high")
    )
    return [verdict(*cell) for cell in zip(effect, holm(p), low, high, strict=True)]
