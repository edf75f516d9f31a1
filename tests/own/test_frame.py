"""A photograph becomes the model's image: the homography and the similarity keep what they should."""

import cv2
import numpy as np
import pytest

from pipeline.own.frame import Frame, rectify, without_pattern
from pipeline.world.bezier import P_F, P_INIT
from tests.factories import RED, WHITE, draw_table

CORNERS = np.array([[148, 62], [498, 71], [612, 441], [37, 428]], float)


def centre_of_red(image: np.ndarray) -> np.ndarray:
    """The centre [m] of the red pixels."""
    red = (image[..., 0] > 150) & (image[..., 1] < 120)
    rows, columns = np.nonzero(red)
    return np.array([columns.mean() + 0.5, len(image) - rows.mean() - 0.5]) / len(image)


def photograph(table: np.ndarray) -> np.ndarray:
    square = np.array([[0, 0], [100, 0], [100, 100], [0, 100]], np.float32)
    matrix = cv2.getPerspectiveTransform(square - 0.5, CORNERS.astype(np.float32) - 0.5)
    return cv2.warpPerspective(table, matrix, (640, 480), flags=cv2.INTER_LINEAR)


def test_an_oblique_photograph_becomes_the_table_again():
    table = draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE))
    whole = Frame.between(1.0, P_INIT, P_F)
    image = whole.image(rectify(photograph(table), CORNERS))
    assert whole.is_whole_table and image.shape == (100, 100, 3)
    np.testing.assert_allclose(centre_of_red(image), (0.7, 0.3), atol=0.004)
    assert np.abs(image.astype(int) - table)[5:-5, 5:-5].mean() < 4


@pytest.mark.parametrize(
    ("side", "start", "goal"),
    [(1.0, (0.1, 0.5), (0.9, 0.5)), (2.0, (0.2, 1.8), (1.8, 0.2)), (0.8, (0.06, 0.06), (0.7, 0.7))],
)
def test_any_start_and_goal_become_the_models(side: float, start: tuple, goal: tuple):
    frame = Frame.between(side, np.array(start), np.array(goal))
    np.testing.assert_allclose(frame.to_model(np.array([start, goal])), [P_INIT, P_F], atol=1e-12)
    points = np.random.default_rng(0).uniform(0, side, (5, 2))
    np.testing.assert_allclose(frame.to_table(frame.to_model(points)), points)
    distances = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (points, frame.to_model(points))]
    np.testing.assert_allclose(distances[1], frame.scale * distances[0])


def test_beyond_the_tables_edge_the_rim_goes_on_without_its_objects():
    frame = Frame.between(
        1.0, np.array([0.1, 0.05]), np.array([0.9, 0.05])
    )  # half of the model's view lies off the table
    image = frame.image(rectify(draw_table((0.5, 0.05, 0.04, RED)), None)).astype(int)
    red = (image[..., 0] - image[..., 1] > 60).mean()
    assert red == pytest.approx(np.pi * 0.04**2 * frame.scale**2, rel=0.3)


def test_the_pattern_of_the_empty_table_is_divided_out():
    stripes = np.where(np.arange(100) % 10 < 5, 90, 180)[None, :, None] * np.ones((100, 1, 3))
    scene = stripes.copy()
    scene[40:60, 40:60] = 30
    plain = without_pattern(np.rint(scene)[None].astype(np.uint8), np.rint(stripes).astype(np.uint8))[0]
    assert np.ptp(plain[:30].astype(int)) <= 1 and plain[50, 50].max() < 60
