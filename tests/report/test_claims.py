"""The rules behind the verdicts on the paper's claims."""

import re
from typing import Any

import pandas as pd
import pytest

from pipeline.report.claims import claims_table, verdicts
from pipeline.report.render import render
from tests.report import factory


def judged(table: str, where: dict, values: dict[str, Any], **changes: pd.DataFrame) -> dict[str, str]:
    """Return the verdicts after one change of the factory's numbers, and other tables in place of the factory's."""
    frame = changes.pop(table, factory.tables()[table])
    chosen = (frame[list(where)] == list(where.values())).all(axis=1)
    assert chosen.any()
    frame.loc[chosen, list(values)] = list(values.values())
    return verdicts(claims_table(factory.results(**{table: frame}, **changes)))


def no_reading() -> pd.DataFrame:
    """A curve of which no reading is as in the paper."""
    return factory.tables()["curve"].assign(mean=0.7)


def repaired(rate: float) -> dict[str, float]:
    return {"success": rate, "success_ci_low": rate - 0.05, "success_ci_high": rate + 0.05}


@pytest.mark.parametrize(("rate", "verdict"), [(0.9, "holds"), (0.65, "open"), (0.3, "fails")])
def test_repair_fails_only_below_the_interval_of_the_papers_few_scenes(rate: float, verdict: str):
    frame = factory.tables()["repair"]
    normal = (frame["variant"] == "full") & (frame["user"] == "normal")
    frame.loc[normal, list(repaired(0.97))] = list(repaired(0.97).values())
    where = {"variant": "full", "method": "gradient", "user": "careful"}
    assert judged("repair", where, repaired(rate), repair=frame)["repair"] == verdict


def test_repair_is_open_if_a_constant_detour_does_as_well():
    frame = factory.tables()["repair"]
    frame.loc[frame["method"] == "constant_detour", "success"] = 0.99
    assert judged("repair", {"variant": "full"}, repaired(0.97), repair=frame)["repair"] == "open"


@pytest.mark.parametrize(
    ("variant", "values", "verdict"),
    [
        ("full", {"mean": 0.98, "q3": 0.98}, "open"),  # many training sets miss it
        ("clearance", {"mean": 0.99}, "fails"),
        ("clearance", {"mean": 0.90}, "open"),  # no model reaches it
    ],
)
def test_accuracy_fails_only_if_our_interval_lies_below_and_some_model_reaches_the_bar(variant, values, verdict):
    where = {"variant": variant, "split": "seen_scenes", "n_demos": 9}
    assert judged("accuracy", where, values, curve=no_reading())["accuracy"] == verdict


@pytest.mark.parametrize(("n", "mean", "verdict"), [(9, 0.985, "in a reading"), (9, 0.97, "fails"), (1, 0.8, "fails")])
def test_accuracy_comes_out_in_a_reading_with_both_ends_of_its_curve_within_the_paper_s_quartiles(n, mean, verdict):
    curve = no_reading()
    few = curve["reading"] == "few_routes_8cm"
    for demos, value in {1: 0.72, 9: 0.99, n: mean}.items():
        curve.loc[few & (curve["n_demos"] == demos), "mean"] = value
    assert verdicts(claims_table(factory.results(curve=curve)))["accuracy"] == verdict


def test_the_autoencoder_claim_is_not_tested_until_it_autoencodes():
    assert verdicts(claims_table(factory.results()))["autoencoder"] == "not tested"
    better = judged("convergence", {"variant": "full"}, {"passed": 1.0})
    assert better["autoencoder"] == "open"  # no difference found is no proof of none
    tables = factory.tables()
    frames = {"convergence": tables["convergence"].assign(passed=1.0)}
    frames["comparisons"] = tables["comparisons"].assign(ci90_high=0.019)
    assert verdicts(claims_table(factory.results(**frames)))["autoencoder"] == "fails"  # an interval below 2 points is


@pytest.mark.parametrize(("claim", "n"), [("irl", 9), ("irl_needs_more", 1)])
def test_irl_holds_if_every_test_is_won_and_fails_if_every_one_is_lost(claim: str, n: int):
    assert judged("comparisons", {"n_demos": n}, {"difference": 0.2})[claim] == "holds"
    assert judged("comparisons", {"n_demos": 10 - n}, {"difference": 0.2})[claim] == "fails"
    assert judged("comparisons", {"split": "new_items"}, {"significant": False})[claim] == "open"


def test_users_differ_if_every_verdict_is_right_though_counting_shows_it_too():
    assert judged("interventions", {"variant": "full", "kind": "user"}, {"right": True})["users_differ"] == "holds"


def test_causes_fail_if_never_looking_does_as_well_and_hold_if_all_are_right():
    assert verdicts(claims_table(factory.results()))["causes"] == "fails"
    assert judged("interventions", {"variant": "full"}, {"right": True})["causes"] == "holds"
    mostly = judged("interventions", {"variant": "full", "user": "careful"}, {"right": True})
    assert mostly["causes"] == "open"


def test_what_no_model_reaches_does_not_fail():
    repair = factory.tables()["repair"]
    repair.loc[repair["method"] == "gradient", list(repaired(0.3))] = list(repaired(0.3).values())
    changed = judged("interventions", {"truth_verdict": "effect"}, {"right": False}, repair=repair)
    assert changed["repair"] == changed["causes"] == "open"


def test_without_the_papers_model_its_claims_are_not_judged():
    assert set(verdicts(claims_table(factory.results(("clearance",))))) == {"robot"}


def test_the_page_has_a_row_for_each_claim_counts_lost_tests_and_names_the_study_that_judges_the_others():
    comparisons = factory.tables()["comparisons"]
    comparisons.loc[comparisons["split"] == "new_items", "significant"] = False
    results = factory.results(comparisons=comparisons)
    page = render(results, ["claims"]).pages["claims"]
    badges = re.findall(r'<span class="badge ([a-z-]+)">', page)
    assert len(badges) - 1 == len(verdicts(claims_table(results))) == 8  # one row is study users'
    against_irl = comparisons[comparisons["against"].str.startswith("irl") & (comparisons["n_demos"] == 9)]
    lost = against_irl["significant"].sum()
    assert 0 < lost < len(against_irl)
    assert f"0 of {len(against_irl)} tests won, {lost} lost" in re.sub("<[^>]*>", "", page)
    assert "four claims, judged in the" not in page
    results.facts["studies"]["users"] = "Do users’ solutions cluster?"
    assert "../studies/users/index.html" in render(results, ["claims"]).pages["claims"]
