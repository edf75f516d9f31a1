"""The oracle's paths are truly valid and the nearest, up to the resolution of its lattice."""

import numpy as np
import pytest

from pipeline.planning.oracle import constant_detour, nearest_valid
from pipeline.world.bezier import curve, lattice, random_z_theta
from pipeline.world.layout import Layouts, empty, random_layouts
from pipeline.world.rules import valid
from tests.factories import ITEMS, RULES

CAREFUL = {"bowl": 0.045, "plate": 0.045, "cutlery": 0.045, "glass": 0.045}
NORMAL = {"bowl": None, "plate": None, "cutlery": None, "glass": 0.038}
BELOW, ABOVE = (0.85, 0.15), (0.15, 0.85)  # of the lattice of side 2; its two others lead straight through the middle


@pytest.fixture(scope="module")
def layouts() -> Layouts:
    return random_layouts(np.random.default_rng(0), 6, ITEMS, np.arange(4), RULES)


def with_glasses(*scenes: list) -> Layouts:
    """Scenes with 4 cm wide glasses at these points [m], at most two a scene."""
    layouts = empty(len(scenes), 2)
    for scene, centres in enumerate(scenes):
        n = len(centres)
        layouts.symbol[scene, :n], layouts.item[scene, :n], layouts.radius[scene, :n] = 3, 3, 0.02
        layouts.centre[scene, :n] = centres
    return layouts


def outside(z: tuple[float, float], room: float) -> np.ndarray:
    """Where a glass, on the outer side of the bend of z's path, leaves the path so much room [m] beyond its margin."""
    outward = (np.array(z) - 0.5) / np.linalg.norm(np.array(z) - 0.5)
    return curve(np.array(z), 3)[1] + (0.02 + 0.038 + room) * outward


@pytest.fixture(scope="module")
def starts() -> np.ndarray:
    return random_z_theta(np.random.default_rng(1), 6, 8)


@pytest.mark.parametrize("margins", [CAREFUL, NORMAL])
def test_every_end_is_valid_and_no_point_of_the_lattice_is_nearer(layouts, starts, margins):
    ends = nearest_valid(layouts, starts, margins, 28, 2)
    assert valid(layouts, ends, margins).all()
    points = np.broadcast_to(lattice(28), (6, 28 * 28, 2))
    distance = np.linalg.norm(points[:, None] - starts[:, :, None], axis=-1)  # (scene, start, point)
    distance[~np.broadcast_to(valid(layouts, points, margins)[:, None], distance.shape)] = np.inf
    assert (np.linalg.norm(ends - starts, axis=-1) <= distance.min(-1) + 1e-12).all()


def test_the_constant_detour_is_valid_in_as_many_scenes_as_any_other_rather_than_roomier(layouts):
    z = constant_detour(layouts, CAREFUL, 28)
    share = valid(layouts, np.broadcast_to(lattice(28), (6, 784, 2)), CAREFUL).mean(0)
    assert valid(layouts, np.broadcast_to(z, (6, 1, 2)), CAREFUL).mean() == share.max()
    narrow = [outside(BELOW, 0.01)]
    layouts = with_glasses(narrow, narrow, [(0.5, 0.5), outside(ABOVE, -0.01)])
    np.testing.assert_allclose(constant_detour(layouts, NORMAL, 2), BELOW)
