"""Build meshes of kitchenware as arrays: profiles turned about an axis, and cross-sections swept along a line.

Lengths are in metres. A mesh stands on z = 0, its footprint's centre at the origin and the long axis along x.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

AROUND = 96  # vertices of a turned ring; an even number
ACROSS = 14  # vertices of a swept cross-section


class Mesh(NamedTuple):
    """Hold vertices [m], faces of four vertices, and each vertex's place on the surface for decoration."""

    vertices: Float[Array, "vertex 3"]
    faces: Int[Array, "face 4"]
    gauge: Float[Array, " vertex"]  # distance from the centre or axis as a share of the radius; -1 outside and below


def rounded(points: Float[Array, "point 2"], times: int = 3) -> Float[Array, "finer 2"]:
    """Return a polyline with its corners cut `times` times (Chaikin, 1974); both ends stay."""
    for _ in range(times):
        before, after = points[:-1], points[1:]
        inner = np.stack([0.75 * before + 0.25 * after, 0.25 * before + 0.75 * after], axis=1).reshape(-1, 2)
        points = np.concatenate([points[:1], inner[1:-1], points[-1:]])
    return points


def turned(profile: Float[Array, "point 2"], radius: float, half_length: float = 0.0) -> Mesh:
    """Return the solid whose wall follows `profile`, (distance, height) [m], scaled to the footprint's radius.

    The distance is that from a segment of `half_length` on the x axis: 0 gives a solid of revolution. The profile runs
    from the axis below, outwards and up to the rim, and back to the axis inside.
    """
    profile = profile * [radius / profile[:, 0].max(), 1.0]
    phi = 2 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    along = np.sign(np.cos(phi)) * half_length
    distance, height = profile[:, :1], profile[:, 1:]
    z = np.broadcast_to(height, (len(profile), AROUND))
    vertices = np.stack([distance * np.cos(phi) + along, distance * np.sin(phi), z], -1)
    rings = np.arange(len(profile) * AROUND).reshape(len(profile), AROUND)
    outside = np.arange(len(profile)) < profile[:, 0].argmax()
    gauge = np.where(outside, -1.0, profile[:, 0] / radius)
    return Mesh(vertices.reshape(-1, 3), _quads(rings), np.repeat(gauge, AROUND))


def swept(
    centre: Float[Array, "station 3"],
    half_width: Float[Array, " station"],
    half_thickness: Float[Array, " station"],
    cup: Float[Array, " station"] | float = 0.0,
) -> Mesh:
    """Return a rod along x with elliptic cross-sections, whose sides rise by `cup` [m] above its middle."""
    theta = 2 * np.pi * np.arange(ACROSS) / ACROSS
    side, up = np.cos(theta), np.sin(theta)
    cups = np.broadcast_to(cup, half_width.shape)[:, None]
    x = np.broadcast_to(centre[:, :1], (len(centre), ACROSS))
    y = centre[:, 1:2] + half_width[:, None] * side
    z = centre[:, 2:] + cups * side**2 + half_thickness[:, None] * up
    rings = np.arange(len(centre) * ACROSS).reshape(len(centre), ACROSS)
    return Mesh(np.stack([x, y, z], -1).reshape(-1, 3), _quads(rings), np.zeros(rings.size))


def _quads(rings: Int[Array, "ring place"]) -> Int[Array, "face 4"]:
    """Return the faces between neighbouring rings, normals outwards for rings that run upwards."""
    nxt = np.roll(rings, -1, axis=1)
    return np.stack([rings[:-1], nxt[:-1], nxt[1:], rings[1:]], -1).reshape(-1, 4)


def into_capsule(mesh: Mesh, radius: float, half_length: float) -> Mesh:
    """Return the mesh with every vertex beyond the capsule moved onto its edge."""
    x = mesh.vertices[:, 0]
    offset = mesh.vertices[:, :2] - np.stack([np.clip(x, -half_length, half_length), np.zeros_like(x)], -1)
    distance = np.linalg.norm(offset, axis=1, keepdims=True)
    moved = mesh.vertices.copy()
    moved[:, :2] -= offset * np.maximum(1 - radius / np.maximum(distance, 1e-12), 0)
    return mesh._replace(vertices=moved)


def outline_gap(meshes: list[Mesh], radius: float, half_length: float, filled: bool) -> float:
    """Return the largest distance [m] between the outline from above and the capsule.

    A thin item (not `filled`) need not fill the capsule: its gaps are those at the capsule's ends and sides.
    """
    points = np.concatenate([mesh.vertices[:, :2] for mesh in meshes])
    x = np.clip(points[:, 0], -half_length, half_length)
    distance = np.hypot(points[:, 0] - x, points[:, 1])
    gaps = [distance.max() - radius]
    if filled:
        bearing = np.linspace(-np.pi, np.pi, 48)
        rays = np.stack([np.cos(bearing), np.sin(bearing)])
        gaps += list((points @ rays).max(0) - (radius + half_length * np.abs(rays[0])))
    else:
        reach = np.array([half_length + radius, radius])
        gaps += [*(points.max(0) - reach), *(-points.min(0) - reach)]
    return float(np.abs(gaps).max())
