"""Verdicts on the paper's claims: its number, ours, that of an image-blind baseline, and fixed rules.

A claim holds if our number reaches the paper's and an image-blind baseline's does not. It fails only if our interval
lies below the paper's (including the paper's sampling error), or if our tests find the opposite. A claim that our world
cannot test is untestable; all others are open.
"""

import pandas as pd
from statsmodels.stats.proportion import proportion_confint

from pipeline.report.results import PAPER_ACCURACY, PAPER_SCENES, PAPER_TABLE_1, Results

HOLDS, FAILS, OPEN, UNTESTABLE = "holds", "fails", "open", "untestable"
SEEN = "seen_scenes"
PAPER = "full"  # the variant that is the paper's model
COLUMNS = [
    "claim", "measure", "paper", "paper_low", "paper_high", "ours", "q1", "q3", "ci_low", "ci_high", "baseline",
    "verdict",
]  # fmt: skip


def claims_table(results: Results) -> pd.DataFrame:
    """Return one row per claim and measure with the columns COLUMNS; rates in 0..1, counts for verdicts and tests."""
    rules = (_accuracy, _autoencoder, _irl, _repair, _causes, _users_differ) if PAPER in results.variants else ()
    rows = [row for rule in rules for row in rule(results)]
    rows.append({"claim": "clusters", "measure": "not tested", "verdict": OPEN})
    rows.append({"claim": "robot", "measure": "no robot", "verdict": UNTESTABLE})
    return pd.DataFrame(rows, columns=COLUMNS)


def verdicts(claims: pd.DataFrame) -> dict[str, str]:
    """Return claim -> verdict: the worst verdict of its measures."""
    worst = {FAILS: 0, OPEN: 1, UNTESTABLE: 2, HOLDS: 3}
    return {
        str(name): min(part["verdict"], key=worst.__getitem__) for name, part in claims.groupby("claim", sort=False)
    }


def _accuracy(results: Results) -> list[dict]:
    """Judge whether accuracy on unseen paths of the training scenes reaches the paper's lower quartile.

    If none of our models reaches it, it may be unreachable in this world, and the claim is open.
    """
    n = results.main_n_demos
    if n not in PAPER_ACCURACY:
        return []
    mean, low, high = PAPER_ACCURACY[n]
    ours = results.accuracy(PAPER, SEEN)
    quartile_low, quartile_high = results.accuracy(PAPER, SEEN, "q1"), results.accuracy(PAPER, SEEN, "q3")
    baseline = results.accuracy("nearest_demonstration", SEEN)
    reached = max(results.accuracy(variant, SEEN) for variant in results.variants) >= low
    verdict = _compare(ours >= low, quartile_high < low and reached, baseline >= low)
    numbers = {"paper": mean, "paper_low": low, "paper_high": high, "ours": ours, "baseline": baseline}
    return [
        {"claim": "accuracy", "measure": SEEN, "q1": quartile_low, "q3": quartile_high, "verdict": verdict} | numbers
    ]


def _autoencoder(results: Results) -> list[dict]:
    """Judge whether the full model beats the classifier in every test; untestable unless its decoder reconstructs."""
    tests = _tests(results, ["classifier"])
    if tests.empty:
        return []
    error = results.value("convergence", "reconstruction_over_flat", variant=PAPER)
    verdict = UNTESTABLE if error >= 1 else _won(tests)
    return [{"claim": "autoencoder", "measure": "tests won", "ours": _wins(tests), "verdict": verdict}]


def _irl(results: Results) -> list[dict]:
    """Judge whether the full model beats both forms of IRL in every test."""
    tests = _tests(results, ["irl_maxent", "irl_ranked"])
    if tests.empty:
        return []
    return [{"claim": "irl", "measure": "tests won", "ours": _wins(tests), "verdict": _won(tests)}]


def _repair(results: Results) -> list[dict]:
    """Judge whether each user's success reaches the paper's rate; it fails below the Wilson interval of 20 repairs."""
    rows = []
    for user in results.repaired_users:
        if user not in PAPER_TABLE_1:
            continue
        paper = PAPER_TABLE_1[user]
        low, high = proportion_confint(round(paper * PAPER_SCENES), PAPER_SCENES, method="wilson")
        names = {"ours": "success", "q1": "success_q1", "q3": "success_q3"}
        names |= {"ci_low": "success_ci_low", "ci_high": "success_ci_high"}
        numbers = {name: results.repair("gradient", PAPER, user, column) for name, column in names.items()}
        baseline = results.repair("constant_detour", "", user)
        verdict = _compare(numbers["ours"] >= paper, numbers["ci_high"] < low, baseline >= numbers["ours"])
        beside = {"paper": paper, "paper_low": low, "paper_high": high, "baseline": baseline, "verdict": verdict}
        rows.append({"claim": "repair", "measure": user} | numbers | beside)
    return rows


def _causes(results: Results) -> list[dict]:
    """Judge whether every verdict on an added item is right; it fails if an image-blind model is equally good."""
    right, asked = results.verdicts_right(PAPER), results.questions()
    if asked == 0:
        return []
    blind = results.image_blind_right()
    verdict = _compare(right == asked, right <= blind, blind == asked)
    return [_counted("causes", right, asked, blind, verdict)]


def _users_differ(results: Results) -> list[dict]:
    """Judge whether every verdict on a change of user is right; shares of valid paths show this without images."""
    asked = results.questions("user")
    if asked == 0:
        return []
    right, blind = results.verdicts_right(PAPER, "user"), results.image_blind_right("user")
    return [_counted("users_differ", right, asked, blind, _compare(right == asked, right == 0, blind == asked))]


def _counted(claim: str, right: int, asked: int, blind: int, verdict: str) -> dict:
    numbers = {"paper": asked, "ours": right, "baseline": blind, "verdict": verdict}
    return {"claim": claim, "measure": "verdicts right"} | numbers


def _compare(met: bool, missed: bool, baseline_meets: bool) -> str:
    if missed:
        return FAILS
    return HOLDS if met and not baseline_meets else OPEN


def _tests(results: Results, against: list[str]) -> pd.DataFrame:
    """Return the tests of the paper's model against others, fixed in conf/evaluate."""
    rows = results.tables["comparisons"]
    return rows[(rows["variant"] == PAPER) & rows["against"].isin(against)]


def _wins(tests: pd.DataFrame) -> int:
    return int((tests["significant"].astype(bool) & (tests["difference"] > 0)).sum())


def _won(tests: pd.DataFrame) -> str:
    """Return holds if every test is won, fails if every test is lost, else open: no significance is no proof."""
    lost = int((tests["significant"].astype(bool) & (tests["difference"] < 0)).sum())
    return HOLDS if _wins(tests) == len(tests) else FAILS if lost == len(tests) else OPEN
