"""Augmented scenes show the same items in the same places, and symmetries keep each path on its image."""

import numpy as np
import pytest

from pipeline.training.irl.augment import ColorJitter
from pipeline.world.bezier import curve, random_z_theta
from pipeline.world.layout import SIDE
from studies.search.augment import SYMMETRIES, turn_images, turn_paths

JITTER = ColorJitter(hue=0.3, gain=0.15, shift=0.01, scene_gain=0.1, other_table=0.67)


@pytest.mark.parametrize("symmetry", range(SYMMETRIES))
def test_a_turned_path_covers_the_turned_pixels(symmetry: int):
    z = random_z_theta(np.random.default_rng(symmetry), 1)[0]
    np.testing.assert_array_equal(drawn(turn_paths(z, symmetry)), turn_images(drawn(z), symmetry))


def drawn(z: np.ndarray) -> np.ndarray:
    """An image (100, 100, 1) whose pixels on the path are true; its ends lie on corners of pixels and are left out."""
    points = curve(z[None], 1001)[0, 5:-5]
    points = points[((points > 0) & (points < 1)).all(-1)]
    image = np.zeros((SIDE, SIDE, 1), bool)
    image[SIDE - 1 - (SIDE * points[:, 1]).astype(int), (SIDE * points[:, 0]).astype(int)] = True
    return image
