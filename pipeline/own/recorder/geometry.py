"""Pixels of a picture to metres on the table and back, by the homography of the table's four corners (OpenCV)."""

import cv2
import numpy as np
from jaxtyping import Float

from pipeline.runtime.errors import InputError

CORNERS = ("far left", "far right", "near right", "near left")  # in the order in which they are stored
MIN_EDGE_PX = 20  # a shorter edge of the table resolves no centimetres


def to_metres(corners: Float[np.ndarray, "4 2"], side_m: float) -> Float[np.ndarray, "3 3"]:
    """Return the homography from pixels to metres; the near left corner is (0, 0), the far right (side, side).

    Raise InputError if the corners are not a convex quadrilateral in the order of `CORNERS`.
    """
    check_corners(corners)
    table = np.array([[0, side_m], [side_m, side_m], [side_m, 0], [0, 0]])
    homography = cv2.getPerspectiveTransform(corners.astype(np.float32), table.astype(np.float32))
    depth = corners.mean(axis=0) @ homography[2, :2] + homography[2, 2]
    return homography * np.sign(depth)  # so that depths are positive on this side of the horizon


def check_corners(corners: Float[np.ndarray, "4 2"]) -> None:
    """Raise InputError unless the corners [px] turn clockwise as seen in the picture, without crossing."""
    edges = np.roll(corners, -1, axis=0) - corners
    after = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]  # positive: clockwise, since rows run downwards
    if np.linalg.norm(edges, axis=1).min() < MIN_EDGE_PX:
        raise InputError(f"two corners of the table are less than {MIN_EDGE_PX} pixels apart: mark all four again")
    if not (turns > 0).all():
        raise InputError(f"the corners do not go around the table: mark {', '.join(CORNERS)}, in this order")


def transform(homography: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Return the points mapped by a homography; raise InputError for points at or beyond the table's horizon."""
    depths = points @ homography[2, :2] + homography[2, 2]
    if (depths <= 1e-9).any():
        raise InputError("a point lies above the horizon of the table: draw on the table")
    return cv2.perspectiveTransform(points[:, None].astype(np.float64), homography)[:, 0]


def circle(centre: Float[np.ndarray, "2"], radius: float) -> Float[np.ndarray, "n 2"]:
    """Return the outline of a circle."""
    return capsule(centre, 0.0, radius, 0.0)


def capsule(
    centre: Float[np.ndarray, "2"], angle_deg: float, radius: float, half_length: float
) -> Float[np.ndarray, "n 2"]:
    """Return the outline of a capsule: all points within `radius` of a segment of twice `half_length`."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 17)
    arc = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1) + [half_length, 0]
    outline = np.concatenate([arc, -arc])
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return centre + outline @ np.array([[c, s], [-s, c]])
