"""Worked examples follow rules that were fixed before any was seen."""

import numpy as np

from pipeline.causal.counterfactual import NO_SINGLE_CAUSE
from studies.counterfactuals.examples import disagreements, first_path


def test_the_first_path_of_the_first_free_scene_is_chosen():
    fitting = np.zeros((3, 4), bool)
    fitting[1, 2] = fitting[1, 3] = fitting[2, 0] = True
    assert (first_path(fitting, []), first_path(fitting, [1]), first_path(fitting, [1, 2])) == ((1, 2), (2, 0), None)


def test_users_disagree_if_their_causes_differ_or_one_accepts():
    rejected = np.array([[[True, True, True, True]], [[True, True, False, False]]])
    cause = np.array([[[0, NO_SINGLE_CAUSE, 1, NO_SINGLE_CAUSE]], [[0, 1, NO_SINGLE_CAUSE, NO_SINGLE_CAUSE]]])
    disagree, one_accepts = disagreements(rejected, cause)
    np.testing.assert_array_equal(disagree, [[False, True, False, False]])
    np.testing.assert_array_equal(one_accepts, [[False, False, True, False]])
