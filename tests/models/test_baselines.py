"""Image-blind baselines know positions and labels, nothing else."""

import numpy as np
from sklearn.neighbors import KNeighborsClassifier

from pipeline.models import baselines
from pipeline.world.bezier import lattice, random_z_theta


def test_the_nearest_label_is_scikit_learns_one_neighbour_scene_by_scene():
    rng = np.random.default_rng(1)
    demos, valid, paths = random_z_theta(rng, 4, 9), rng.random((4, 9)) < 0.5, random_z_theta(rng, 4, 50)
    p = baselines.nearest_demonstration(demos, valid, paths)
    for scene in range(4):
        neighbour = KNeighborsClassifier(1).fit(demos[scene], valid[scene])
        np.testing.assert_array_equal(p[scene], neighbour.predict(paths[scene]))


def test_a_position_reads_its_own_square_of_the_prior():
    prior = np.random.default_rng(3).random((7, 7))
    np.testing.assert_array_equal(baselines.position_only(prior, lattice(7)), prior.ravel())
    corners = np.array([[-0.2, -0.2], [1.2, -0.2], [-0.2, 1.2], [1.2, 1.2]])  # the square's edges belong to it
    np.testing.assert_array_equal(baselines.position_only(prior, corners), prior[[0, 0, -1, -1], [0, -1, 0, -1]])
