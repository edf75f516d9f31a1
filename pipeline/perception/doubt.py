"""Measure how unsure the segmenter is of a picture, without any label (docs/decisions/031-doubt.md)."""

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray as Array
from scipy.special import entr

from pipeline.perception.outlines import MIN_ITEM_PX, OUTLINE

SQUARE = np.ones((3, 3), np.uint8)


def doubt(item: Float32[Array, "row column"]) -> float:
    """Return the entropy [nat] of an item map over the length of its outlines [pixels].

    Every outline has unsure pixels, so a picture of more items may be less sure. Blur and noise widen outlines, and
    items that are almost missed add unsure pixels without an outline. A table without items counts as MIN_ITEM_PX.
    """
    inside = (item > OUTLINE).astype(np.uint8)
    length = int((cv2.dilate(inside, SQUARE) - inside).sum())
    return float((entr(item) + entr(1 - item)).sum() / max(length, MIN_ITEM_PX))
