"""The causal graph is acyclic, interventions cut the arrows they should, and noises are held."""

from graphlib import CycleError, TopologicalSorter

import numpy as np
import pytest

from pipeline.causal.scm import PARENTS, SCM, Values, chance_of_change, specification_scm

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
    )


def noises(units: int = UNITS) -> Values:
    rng = np.random.default_rng(0)
    return {
        "S": rng.integers(len(USERS), size=units), "O": rng.integers(0, 3, units), "T": rng.uniform(0, 0.5, units),
        "Z_theta": rng.random((units, 2)), "I": rng.uniform(0, 0.2, units), "Z_I": np.zeros(units),
        "V": rng.random(units),
    }  # fmt: skip


def test_the_graph_is_acyclic_and_the_papers_printed_parent_sets_are_a_cycle(scm: SCM):
    assert {name: node.parents for name, node in scm.nodes.items()} == PARENTS
    assert set(TopologicalSorter(PARENTS).static_order()) == set(PARENTS)
    printed = {"Z_theta", "Z_I", "S", "V"}
    with pytest.raises(CycleError):
        TopologicalSorter({name: printed - {name} for name in printed}).prepare()


def test_do_cuts_the_arrows_into_a_node_and_reaches_its_descendants_alone(scm: SCM):
    noise = noises()
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
    for node, value in before.items():  # a node set to the value that it has changes nothing
        again = scm.do(**{node: value}).entail(noise)
        assert all((again[name] == before[name]).all() for name in PARENTS)


def test_sampled_interventions_average_to_the_estimand(scm: SCM):
    """E[V | do(Z_I := 2), S = careful] by hand: 1 - .6 + .2 (E[x] - .5) = .4, as E[x] = .5."""
    noise, set_to = noises(20_000), scm.do(S="careful", Z_I=2)
    assert set_to.entail(noise)["V"].mean() == pytest.approx(0.4, abs=0.015)
    assert set_to.expectation("V", noise).mean() == pytest.approx(0.4, abs=0.003)  # without the noise of V


@pytest.mark.slow
@pytest.mark.parametrize("v", [False, True])
def test_the_chance_of_change_is_what_brute_force_finds(scm: SCM, v: bool):
    """Keep the draws of N_V under which each unit shows v (abduction), act, and see what V becomes (prediction)."""
    noise, rng = noises(200), np.random.default_rng(1)
    factual = scm.do(S="careful")
    acted = factual.do(O=(noise["O"] + 1) % 3)
    exact = chance_of_change(v, factual.expectation("V", noise), acted.expectation("V", noise))
    draws = [noise | {"V": rng.random(200)} for _ in range(3000)]
    before, after = (np.array([model.entail(n, "V")["V"] for n in draws]) for model in (factual, acted))
    kept = before == v
    often = kept.sum(0) > 300
    assert often.mean() > 0.3 and (exact[often] > 0).any()
    np.testing.assert_allclose(exact[often], ((after != v) & kept).sum(0)[often] / kept.sum(0)[often], atol=0.1)
    np.testing.assert_array_equal(np.isnan(exact), factual.expectation("V", noise) == (0 if v else 1))
