"""Effects of added items are differences of mean validity, in the order of the questions."""

import numpy as np

from pipeline.causal.added_items import added_item_effects, expected_by_version, questions
from pipeline.world.layout import SYMBOLS

USERS = ["careful", "normal"]
RNG = np.random.default_rng(11)
P = RNG.random((2, 3, 1 + len(SYMBOLS), 5, 6))  # user, seed, version, scene, path


def test_a_question_compares_the_scene_as_it_is_with_its_symbol_s_version():
    before, after = expected_by_version(P)
    for i, (user, symbol) in questions(USERS).iterrows():
        row = P[USERS.index(user)]
        np.testing.assert_allclose(before[i], row[:, 0].mean(-1))
        np.testing.assert_allclose(after[i], row[:, 1 + SYMBOLS.index(symbol)].mean(-1))
    np.testing.assert_allclose(added_item_effects(P), after - before)
