"""Composites are exact, and never show a held-out family in training."""

import cv2
import numpy as np
import pytest

from making.segmenter.composites import FAMILIES, Palette, draw_composites, family_names, read_palette

CLEAR_OF_SHADOWS_PX = 25  # shadows, caustics and contact shade end within this distance of an item


@pytest.fixture(scope="module")
def palette() -> Palette:
    return read_palette("data")


def test_far_from_items_the_picture_is_the_empty_table(palette: Palette):
    composites = draw_composites(np.random.default_rng(5), 20, family_names("taught"), palette)
    for image, instances, empty in zip(composites.images, composites.instances, composites.empty, strict=True):
        distance = cv2.distanceTransform((instances == 0).astype(np.uint8), cv2.DIST_L2, 5) if instances.any() else None
        away = np.ones((100, 100), bool) if distance is None else distance > CLEAR_OF_SHADOWS_PX
        difference = (image.astype(float) - empty)[away]
        assert difference.size == 0 or abs(difference.mean()) < 2  # noise alone


def test_taught_draws_never_show_a_held_out_family(palette: Palette, monkeypatch: pytest.MonkeyPatch):
    def never(rng: np.random.Generator, side: int):
        raise AssertionError("a held-out family was drawn")

    for name in family_names("held_out"):
        monkeypatch.setitem(FAMILIES, name, FAMILIES[name]._replace(draw=never))
    taught = draw_composites(np.random.default_rng(0), 16, family_names("taught"), palette)
    assert set(taught.family) <= set(family_names("taught"))
