"""The rules behind the verdicts on the paper's claims."""

import re

import pandas as pd
import pytest

from pipeline.report.claims import claims_table, verdicts
from pipeline.report.render import render
from tests.report import factory


def judged(table: str, column: str, where: dict, value: object, **changes: pd.DataFrame) -> dict[str, str]:
    """Return the verdicts after one change of the factory's numbers, and other tables in place of the factory's."""
    frame = factory.tables()[table]
    chosen = pd.Series(True, frame.index)
    for name, wanted in where.items():
        chosen &= frame[name] == wanted
    assert chosen.any()
    frame.loc[chosen, column] = value
    return verdicts(claims_table(factory.results(**{table: frame}, **changes)))


@pytest.mark.parametrize(
    ("careful", "normal", "verdict"), [(0.9, 0.97, "holds"), (0.65, 0.97, "open"), (0.3, 0.97, "fails")]
)
def test_repair_fails_only_below_the_interval_of_the_papers_few_scenes(careful: float, normal: float, verdict: str):
    frame = factory.tables()["repair"]
    for user, rate in (("careful", careful), ("normal", normal)):
        mine = (frame["variant"] == "full") & (frame["method"] == "gradient") & (frame["user"] == user)
        frame.loc[mine, ["success", "success_ci_low", "success_ci_high"]] = rate, rate - 0.05, rate + 0.05
    assert verdicts(claims_table(factory.results(repair=frame)))["repair"] == verdict


def test_repair_is_open_if_a_constant_detour_does_as_well():
    frame = factory.tables()["repair"]
    frame.loc[frame["variant"] == "full", ["success", "success_ci_low", "success_ci_high"]] = 0.97, 0.9, 1.0
    frame.loc[frame["method"] == "constant_detour", "success"] = 0.99
    assert verdicts(claims_table(factory.results(repair=frame)))["repair"] == "open"


FULL_SEEN = {"variant": "full", "split": "seen_scenes", "n_demos": 9}


def no_reading() -> pd.DataFrame:
    """A curve of which no reading is as in the paper."""
    return factory.tables()["curve"].assign(mean=0.7)


def test_an_accuracy_that_many_training_sets_miss_is_open():
    columns = ["mean", "q3"]
    verdict = judged("accuracy", columns, FULL_SEEN, 0.98, curve=no_reading())["accuracy"]  # pyright: ignore
    assert verdict == "open"


def test_accuracy_fails_only_if_some_model_reaches_the_bar():
    for reached, verdict in ((0.99, "fails"), (0.90, "open")):
        where = {"variant": "clearance", "split": "seen_scenes"}
        assert judged("accuracy", "mean", where, reached, curve=no_reading())["accuracy"] == verdict


@pytest.mark.parametrize(("n", "mean", "verdict"), [(9, 0.985, "in a reading"), (9, 0.97, "fails"), (1, 0.8, "fails")])
def test_accuracy_comes_out_in_a_reading_with_both_ends_of_its_curve_within_the_paper_s_quartiles(n, mean, verdict):
    curve = no_reading()
    few = curve["reading"] == "few_routes_8cm"
    curve.loc[few & (curve["n_demos"] == 1), "mean"], curve.loc[few & (curve["n_demos"] == 9), "mean"] = 0.72, 0.99
    curve.loc[few & (curve["n_demos"] == n), "mean"] = mean
    assert verdicts(claims_table(factory.results(curve=curve)))["accuracy"] == verdict


def test_the_autoencoder_claim_is_not_tested_until_it_autoencodes():
    assert verdicts(claims_table(factory.results()))["autoencoder"] == "not tested"
    better = judged("convergence", "passed", {"variant": "full"}, 1.0)
    assert better["autoencoder"] == "open"  # no difference found is no proof of none


def test_claims_of_solutions_are_not_tested_without_their_study():
    results = factory.results()
    assert "four claims, judged in the" not in render(results, ["claims"]).pages["claims"]
    results.facts["studies"]["users"] = "Do users’ solutions cluster?"
    assert "../studies/users/index.html" in render(results, ["claims"]).pages["claims"]


def test_a_claim_has_one_row_in_the_pages():
    page = render(factory.results(), ["claims"]).pages["claims"]
    verdict = r'<span class="badge ([a-z-]+)">'
    without_study = 1  # the row of study solutions
    assert len(re.findall(verdict, page)) - without_study == len(verdicts(claims_table(factory.results()))) == 8


def test_irl_holds_if_every_test_is_won_and_fails_if_every_one_is_lost():
    assert verdicts(claims_table(factory.results()))["irl"] == "fails"
    assert judged("comparisons", "difference", {"variant": "full"}, 0.2)["irl"] == "holds"
    assert judged("comparisons", "significant", {"split": "new_items"}, False)["irl"] == "open"


def test_the_page_counts_lost_tests_beside_won_ones():
    comparisons = factory.tables()["comparisons"]
    comparisons.loc[comparisons["split"] == "new_items", "significant"] = False
    page = re.sub("<[^>]*>", "", render(factory.results(comparisons=comparisons), ["claims"]).pages["claims"])
    against_irl = comparisons[(comparisons["variant"] == "full") & comparisons["against"].str.startswith("irl")]
    lost = against_irl.query("n_demos == 9 and difference < 0")["significant"]
    assert 0 < lost.sum() < len(lost)
    assert f"0 of {len(lost)} tests won, {lost.sum()} lost" in page


def test_irl_needs_more_only_if_it_loses_with_one_demonstration():
    assert judged("comparisons", "difference", {"n_demos": 1}, 0.2)["irl_needs_more"] == "holds"
    assert judged("comparisons", "difference", {"n_demos": 9}, 0.2)["irl_needs_more"] == "fails"
    assert judged("comparisons", "significant", {"n_demos": 1}, False)["irl_needs_more"] == "open"


def test_causes_fail_if_never_looking_does_as_well_and_hold_if_all_are_right():
    assert verdicts(claims_table(factory.results()))["causes"] == "fails"
    assert judged("interventions", "right", {"variant": "full"}, True)["causes"] == "holds"
    mostly = judged("interventions", "right", {"variant": "full", "user": "careful"}, True)
    assert mostly["causes"] == "open"


def test_what_no_model_reaches_does_not_fail():
    repair, questions = factory.tables()["repair"], factory.tables()["interventions"]
    rates = ["success", "success_ci_low", "success_ci_high"]
    repair.loc[repair["method"] == "gradient", rates] = 0.3, 0.2, 0.4
    questions.loc[questions["truth_verdict"] == "effect", "right"] = False
    judged_so = verdicts(claims_table(factory.results(repair=repair, interventions=questions)))
    assert judged_so["repair"] == judged_so["causes"] == "open"


def test_without_the_papers_model_its_claims_are_not_judged():
    assert set(verdicts(claims_table(factory.results(("clearance",))))) == {"robot"}
