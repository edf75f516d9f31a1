"""Meshes fill their footprints, and a mesh that does not is refused."""

import numpy as np
import pytest

from rendered.meshes import check_outline, into_capsule, rounded, swept, turned

PROFILE = np.array([[0.0, 0.0], [0.03, 0.0], [0.06, 0.04], [0.055, 0.04], [0.0, 0.005]])


@pytest.mark.parametrize("half_length", [0.0, 0.03])
def test_a_turned_profile_fills_its_footprint(half_length):
    mesh = turned(PROFILE, 0.07, half_length)
    check_outline([mesh], 0.07, half_length, filled=True)
    with pytest.raises(ValueError, match=r"differ by 1\.\d\d mm: expected at most 0\.5"):
        check_outline([mesh], 0.0714, half_length, filled=True)


def test_faces_of_a_turned_solid_point_outwards():
    mesh = turned(PROFILE, 0.06)
    a, b, _, d = (mesh.vertices[mesh.faces[:, i]] for i in range(4))
    normals, middle = np.cross(b - a, d - a), mesh.vertices[mesh.faces].mean(1)
    outer = (np.hypot(*middle[:, :2].T) > 0.04) & (normals[:, 2] < 0)  # the outer wall leans outwards
    assert (np.einsum("fi,fi->f", normals[outer][:, :2], middle[outer][:, :2]) > 0).all()


def test_a_rod_moved_into_its_capsule_touches_ends_and_sides():
    x = np.linspace(-0.1, 0.1, 41)
    mesh = swept(np.stack([x, 0 * x, 0 * x], -1), np.full_like(x, 0.012), np.full_like(x, 0.001))
    check_outline([into_capsule(mesh, 0.012, 0.088)], 0.012, 0.088, filled=False)
    with pytest.raises(ValueError, match="outline and footprint differ"):
        check_outline([mesh], 0.012, 0.088, filled=False)


def test_cutting_corners_keeps_both_ends():
    np.testing.assert_array_equal(rounded(PROFILE)[[0, -1]], PROFILE[[0, -1]])
