"""The causal graph is acyclic, interventions cut the arrows they should, and noises are held."""

import numpy as np
import pytest

from pipeline.causal.scm import (
    PARENTS,
    SCM,
    Node,
    Values,
    abduce_threshold,
    chance_of_change,
    no_noise,
    specification_scm,
)

USERS = ("careful", "aggressive")
UNITS = 4000


def classify(s: np.ndarray, z_image: np.ndarray, z_theta: np.ndarray) -> np.ndarray:
    """The aggressive user accepts everything; the careful one less, the more items there are and the further left."""
    return np.where(s == "aggressive", 1.0, np.clip(1 - 0.3 * z_image + 0.2 * (z_theta[:, 0] - 0.5), 0, 1))


@pytest.fixture
def scm() -> SCM:
    """Scenes of 0-2 items; the image shows how many there are, twice as bright, on a table top and with noise."""
    return specification_scm(
        USERS,
        render=lambda light, items, table_top: 2 * items + light + table_top,
        encode=lambda image: np.floor(image / 2),
        classify=classify,
        draw_items=lambda rng, units: rng.integers(0, 3, units),
        draw_table_top=lambda rng, units: rng.uniform(0, 0.5, units),
        draw_render_seed=lambda rng, units: rng.uniform(0, 0.2, units),
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


def test_an_arrow_from_nowhere_an_unknown_node_and_a_noise_without_a_draw_are_refused(scm: SCM):
    with pytest.raises(ValueError, match=r"parents \['O'\] of I are no nodes"):
        SCM({"I": Node(("O",), lambda noise, items: items, no_noise)})
    with pytest.raises(ValueError, match=r"do\(\) on \['Z'\]"):
        scm.do(Z=1)
    recorded = specification_scm(USERS, lambda n, items, table_top: items, lambda image: image, classify)
    with pytest.raises(ValueError, match="noise of I is on record only"):
        recorded.sample(np.random.default_rng(0), 3)


def test_do_cuts_the_arrows_into_a_node_and_reaches_its_descendants_alone(scm: SCM):
    noise = scm.noise(np.random.default_rng(0), UNITS)
    before = scm.entail(noise)
    actions = {"S": "careful", "Z_I": before["Z_I"] + 1, "O": np.zeros(UNITS, int)}
    reached = {"S": {"S", "V"}, "Z_I": {"Z_I", "V"}, "O": {"O", "I", "Z_I", "V"}}
    after = {node: scm.do(**{node: value}).entail(noise) for node, value in actions.items()}
    for node, values in after.items():
        assert {name for name in PARENTS if (before[name] != values[name]).any()} == reached[node]
    same = before["S"] == "careful"
    np.testing.assert_array_equal(before["V"][same], after["S"]["V"][same])  # who was asked anyway answers alike
    assert set(after["S"]["S"]) == {"careful"} and (after["O"]["Z_I"] == 0).all()
    assert not (after["Z_I"]["V"] & ~before["V"]).any()  # an added item makes no path valid: the same draw decides
    assert after["O"]["V"][same].mean() > 0.9


@pytest.fixture
def observed(scm: SCM) -> tuple[Values, Values, Values]:
    """Careful units: every noise but N_V's on record, what was seen of V, and all values."""
    careful = scm.do(S="careful")
    noise = careful.noise(np.random.default_rng(1), UNITS)
    values = careful.entail(noise)
    return {name: n for name, n in noise.items() if name != "V"}, {"V": values["V"]}, values


@pytest.mark.parametrize(
    ("v", "c", "c_after"), [(False, 0.3, 0.8), (False, 0.6, 0.2), (True, 0.7, 0.4), (True, 0.2, 0.9)]
)
def test_a_counterfactual_is_what_brute_force_finds(v: bool, c: float, c_after: float):
    """Rejection: of units drawn blindly, those that show v; in them the other answer, decided by the same draw."""
    n = np.random.default_rng(0).random(200_000)
    kept = n[(n < c) == v]
    changed = ((kept < c_after) != v).mean()
    abduced = abduce_threshold(np.random.default_rng(1), np.full(200_000, v), np.full(200_000, c))
    assert ((abduced < c) == v).all()
    assert chance_of_change(v, np.array(c), np.array(c_after)) == pytest.approx(changed, abs=0.005)
    assert ((abduced < c_after) != v).mean() == pytest.approx(changed, abs=0.005)


def test_setting_a_node_to_its_factual_or_counterfactual_value_changes_nothing(scm: SCM, observed):
    """Consistency and composition."""
    recorded, seen, values = observed
    careful, nothing = scm.do(S="careful"), np.zeros(UNITS, int)
    for action in ({}, {"O": values["O"]}, {"Z_I": values["Z_I"]}, {"S": "careful"}):
        again = careful.counterfactual(np.random.default_rng(3), recorded, seen, **action)
        for node in PARENTS:
            np.testing.assert_array_equal(again[node], values[node])
    once = careful.counterfactual(np.random.default_rng(4), recorded, seen, O=nothing)
    held = careful.counterfactual(np.random.default_rng(4), recorded, seen, O=nothing, Z_I=once["Z_I"])
    for node in PARENTS:
        np.testing.assert_array_equal(once[node], held[node])


def test_certain_answers_change_with_certainty_and_an_impossible_one_has_no_counterfactual():
    before = np.array([0.0, 0.0, 0.0, 0.4, 1.0])
    after = np.array([0.0, 0.3, 1.0, 1.0, 0.5])
    np.testing.assert_allclose(chance_of_change(False, before, after), [0, 0.3, 1, 1, np.nan])
    np.testing.assert_allclose(chance_of_change(True, 1 - before, 1 - after), [0, 0.3, 1, 1, np.nan])
    for v, c in ((False, 1.0), (True, 0.0)):
        with pytest.raises(ValueError, match="1 units show what has probability 0"):
            abduce_threshold(np.random.default_rng(0), np.array([v]), np.array([c]))


def test_a_noise_neither_on_record_nor_abducible_is_refused(scm: SCM, observed):
    recorded, seen, values = observed
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"noises of .* on record, \[\] observed"):
        scm.counterfactual(rng, recorded, {}, O=values["O"])
    without = {name: n for name, n in recorded.items() if name != "I"}
    with pytest.raises(ValueError, match="I was observed, but its noise is unknown"):
        scm.counterfactual(rng, without, seen | {"I": values["I"]}, O=values["O"])


def test_sampled_interventions_average_to_the_estimand(scm: SCM):
    """E[V | do(Z_I := 2), S = careful] by hand: 1 - .6 + .2 (E[x] - .5) = .4, as E[x] = .5."""
    noise = scm.noise(np.random.default_rng(0), 20_000)
    asked = scm.do(S="careful", Z_I=2)
    assert asked.entail(noise)["V"].mean() == pytest.approx(0.4, abs=0.015)
    assert asked.expectation("V", noise).mean() == pytest.approx(0.4, abs=0.003)  # without the noise of V


@pytest.mark.parametrize("v", [False, True])
def test_the_probability_of_change_is_that_of_sampled_counterfactuals(scm: SCM, v: bool):
    """Units that all show v, by abduction, action and prediction, many times over."""
    careful = scm.do(S="careful")
    noise = careful.noise(np.random.default_rng(1), 300)
    recorded = {name: n for name, n in noise.items() if name != "V"}
    action = {"O": (careful.entail(noise)["O"] + 1) % 3}
    exact = careful.probability_of_change(recorded, v, **action)
    possible = np.isfinite(exact)
    assert possible.mean() > 0.5 and (exact[possible] > 0).any()
    some = {name: n[possible] for name, n in recorded.items()}
    action = {name: value[possible] for name, value in action.items()}
    rng, seen = np.random.default_rng(2), {"V": np.full(possible.sum(), v)}
    sampled = np.mean([careful.counterfactual(rng, some, seen, **action)["V"] != v for _ in range(1500)], axis=0)
    np.testing.assert_allclose(exact[possible], sampled, atol=0.06)
    assert exact[possible].mean() == pytest.approx(sampled.mean(), abs=0.005)


def test_only_the_ancestors_of_the_nodes_asked_for_are_evaluated(scm: SCM):
    noise = {"Z_I": np.zeros(5), "I": np.zeros(5), "O": np.ones(5, int), "T": np.zeros(5)}
    assert set(scm.entail(noise, "Z_I")) == {"O", "T", "I", "Z_I"}  # neither S nor V, whose noises are unknown
