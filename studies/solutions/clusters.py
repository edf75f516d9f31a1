"""Clusters of valid paths in z_theta by user, and the accuracy that a perfect clusterer could reach."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.spatial.distance import cdist

MEASURES = "nearest neighbours", "nearest centroid", "silhouette"  # of users
SAME_TABLE = "nearest label"  # of valid and invalid paths


@dataclass(frozen=True)
class Paths:
    """Valid demonstrations of one seed, sorted by scene: control points [m], scenes, and users as numbers from 0."""

    z_theta: Float[Array, "path 2"]
    scene: Int[Array, " path"]
    user: Int[Array, " path"]


def measures(
    paths: Paths, neighbours: int, rng: np.random.Generator, permutations: int
) -> Float[Array, "draw measure"]:
    """Return MEASURES of the paths (draw 0), and after permutations of the users within each scene."""
    distances, scene = cdist(paths.z_theta, paths.z_theta), paths.scene
    other = np.where(scene[:, None] == scene, np.inf, distances)
    near = np.argsort(other, axis=1, kind="stable")[:, :neighbours]
    orders = [np.arange(len(scene)), *(np.lexsort((rng.random(len(scene)), scene)) for _ in range(permutations))]
    rows = []
    for user in (paths.user[order] for order in orders):
        member = np.eye(paths.user.max() + 1)[user]  # (path, user)
        count = member.sum(0)
        voted = (member[near].sum(1) / count).argmax(1)  # each user weighs the same, whatever its number of paths
        rows.append(
            (_recall(voted, user), _recall(_nearest_centroid(paths, member), user), _silhouette(distances, user))
        )
    return np.array(rows)


def nearest_label(
    z_theta: Float[Array, "scene path 2"], valid: Bool[Array, "scene path"], rng: np.random.Generator, permutations: int
) -> Float[Array, " draw"]:
    """Return the share of paths with the label of the nearest other one in their scene, then after permutations."""
    distances = np.linalg.norm(z_theta[:, :, None] - z_theta[:, None], axis=-1)
    near = (distances + np.diag(np.full(valid.shape[1], np.inf))).argmin(-1)
    draws = [valid, *(rng.permuted(valid, axis=1) for _ in range(permutations))]
    return np.array([(np.take_along_axis(labels, near, 1) == labels).mean() for labels in draws])


def best_accuracy(share: Float[Array, "user *scene cell"]) -> float:
    """Return the mean recall of the best guess of the user from a path drawn from its valid set.

    share: validity of each cell to each user, true (0 or 1) or its mean over scenes. Scenes without a valid path to
    some user are left out.
    """
    total = share.sum(-1, keepdims=True)
    use = (total > 0).all(0)[..., 0]
    density = (share / np.where(total > 0, total, 1))[:, use] if use.ndim else share / total
    return float((density.max(0) / len(share)).sum(-1).mean())


def _nearest_centroid(paths: Paths, member: Float[Array, "path user"]) -> Int[Array, " path"]:
    """Return the user with the nearest mean path, over all other scenes."""
    here = (paths.scene[:, None] == np.arange(paths.scene.max() + 1)).astype(float)  # (path, scene)
    sums = np.einsum("ps,pu,pc->suc", here, member, paths.z_theta)
    counts = (here.T @ member)[..., None]
    centroids = (sums.sum(0) - sums) / np.maximum(counts.sum(0) - counts, 1)  # (scene, user, 2)
    return np.linalg.norm(paths.z_theta[:, None] - centroids[paths.scene], axis=-1).argmin(1)


def _recall(guess: Int[Array, " path"], user: Int[Array, " path"]) -> float:
    """Return the share of right guesses, the mean over users."""
    return float(np.mean([(guess[user == u] == u).mean() for u in np.unique(user)]))


def _silhouette(distances: Float[Array, "path path"], user: Int[Array, " path"]) -> float:
    """Return the mean silhouette (Rousseeuw, 1987): above 0, paths are nearer to their own user's than to another's."""
    member = np.eye(user.max() + 1)[user]
    count, sums, own = member.sum(0), distances @ member, np.arange(len(user))
    within = sums[own, user] / np.maximum(count[user] - 1, 1)
    between = np.where(member > 0, np.inf, sums / count).min(1)
    return float(((between - within) / np.maximum(between, within)).mean())


def routes(sides: Bool[Array, "scene path slot"], chosen: Bool[Array, "*seed scene path"]) -> Int[Array, "*seed scene"]:
    """Return the number of distinct routes among the chosen paths: sides on which a path passes the items."""
    code = (sides * 2 ** np.arange(sides.shape[-1])).sum(-1)  # (scene, path)
    return np.stack([(chosen & (code == value)).any(-1) for value in np.unique(code)]).sum(0)
