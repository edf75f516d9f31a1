"""The causal graph is acyclic, interventions cut the arrows they should, and noises are held."""

import numpy as np
import pytest

from pipeline.causal.interventions import expected_validity
from pipeline.causal.scm import PARENTS, SCM, Node, no_noise, specification_scm

USERS = ("careful", "aggressive")
UNITS = 4000


def classify(s: np.ndarray, z_image: np.ndarray, z_theta: np.ndarray) -> np.ndarray:
    """The aggressive user accepts everything; the careful one less, the more items there are and the further left."""
    return np.where(s == "aggressive", 1.0, np.clip(1 - 0.3 * z_image + 0.2 * (z_theta[:, 0] - 0.5), 0, 1))


@pytest.fixture
def scm() -> SCM:
    """A table of 0-2 items; the image shows how many there are, twice as bright and with some noise."""
    return specification_scm(
        USERS,
        draw_items=lambda rng, units: rng.integers(0, 3, units),
        draw_look=lambda rng, units: rng.uniform(0, 0.2, units),
        render=lambda look, items: 2 * items + look,
        encode=lambda image: np.floor(image / 2),
        classify=classify,
    )


def test_the_graph_evaluates_every_node_after_its_parents(scm: SCM):
    order = scm.order
    assert sorted(order) == sorted(PARENTS)
    assert all(order.index(parent) < order.index(node) for node in PARENTS for parent in PARENTS[node])


def test_the_papers_printed_parent_sets_are_a_cycle():
    names = {"Z_theta", "Z_I", "S", "V"}
    printed = {n: Node(tuple(sorted(names - {n})), lambda noise, *parents: noise, no_noise) for n in names}
    with pytest.raises(ValueError, match="cycle"):
        SCM(printed)


def test_an_arrow_from_nowhere_is_refused():
    with pytest.raises(ValueError, match=r"parents \['O'\] of I are no nodes"):
        SCM({"I": Node(("O",), lambda noise, items: items, no_noise)})


def test_do_s_changes_v_alone(scm: SCM):
    noise = scm.noise(np.random.default_rng(0), UNITS)
    before, after = scm.entail(noise), scm.do(S="careful").entail(noise)
    for node in set(PARENTS) - {"S", "V"}:
        np.testing.assert_array_equal(before[node], after[node])
    assert set(after["S"]) == {"careful"}
    assert (before["V"] != after["V"]).any()
    same = before["S"] == "careful"
    np.testing.assert_array_equal(before["V"][same], after["V"][same])  # who was asked anyway answers alike


def test_do_z_image_leaves_the_table_and_its_picture_as_they_are(scm: SCM):
    noise = scm.noise(np.random.default_rng(0), UNITS)
    before = scm.entail(noise)
    after = scm.do(Z_I=before["Z_I"] + 1).entail(noise)
    for node in ("S", "O", "I", "Z_theta"):
        np.testing.assert_array_equal(before[node], after[node])
    assert not (after["V"] & ~before["V"]).any()  # one item more makes no path valid: the same draw decides


def test_do_on_the_items_flows_down_to_v(scm: SCM):
    after = scm.do(O=np.zeros(UNITS, int)).sample(np.random.default_rng(0), UNITS)
    assert (after["Z_I"] == 0).all()
    assert after["V"][after["S"] == "careful"].mean() > 0.9


def test_do_on_one_node_leaves_the_others_draws_alone(scm: SCM):
    plain = scm.sample(np.random.default_rng(3), 50)
    swapped = scm.do(O=np.ones(50, int)).sample(np.random.default_rng(3), 50)
    np.testing.assert_array_equal(plain["Z_theta"], swapped["Z_theta"])


def test_do_on_an_unknown_node_is_refused(scm: SCM):
    with pytest.raises(ValueError, match=r"do\(\) on \['Z'\]"):
        scm.do(Z=1)


def test_sampled_interventions_average_to_the_estimand(scm: SCM):
    """E[V | do(Z_I := 2), S = careful] of the toy by hand: 1 - .6 + .2 (E[x] - .5) = .4, as E[x] = .5."""
    noise = scm.noise(np.random.default_rng(0), 20_000)
    values = scm.do(S="careful", Z_I=2).entail(noise)
    assert values["V"].mean() == pytest.approx(0.4, abs=0.015)
    p = classify(values["S"], values["Z_I"], values["Z_theta"])
    assert expected_validity(p) == pytest.approx(0.4, abs=0.003)  # and without the noise of V
