"""Verdicts on the paper's claims: its number, ours, that of an image-blind baseline, and fixed rules.

A claim holds if our number reaches the paper's, an image-blind baseline's does not (for repairs: is below ours), and
another draw of training sets would not undo it. It fails only if our interval lies below the paper's (including the
paper's sampling error), if our tests find the opposite, or if the paper's model names no more causes than an
image-blind one, and if some model of ours does reach it. Accuracy comes out "in a reading" if the paper's model lies
within the paper's quartiles at both ends of its curve in one of the declared readings of what was shown. What this
world cannot show is untestable, what we did not test is not tested, all else is open. Claims about clusters, overlap
and samples are judged by study solutions, since the paper's pages do not depend on studies.
"""

import pandas as pd
from scipy.stats import binomtest

from pipeline.report.results import PAPER_ACCURACY, PAPER_SCENES, PAPER_TABLE_1, Results
from pipeline.report.style import label

HOLDS, FAILS, OPEN, UNTESTABLE, NOT_TESTED = "holds", "fails", "open", "untestable", "not tested"
IN_A_READING = "in a reading"
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
    rows.append({"claim": "robot", "measure": "no robot", "verdict": UNTESTABLE})
    return pd.DataFrame(rows, columns=COLUMNS)


def verdicts(claims: pd.DataFrame) -> dict[str, str]:
    """Return claim -> verdict: the worst verdict of its measures."""
    worst = {FAILS: 0, OPEN: 1, IN_A_READING: 2, NOT_TESTED: 3, UNTESTABLE: 4, HOLDS: 5}
    return {
        str(name): min(part["verdict"], key=worst.__getitem__) for name, part in claims.groupby("claim", sort=False)
    }


def rates(results: Results) -> pd.DataFrame:
    """Return accuracy in the training scenes and success of gradient repair: paper, ours, image-blind."""
    claims = claims_table(results).dropna(subset=["paper", "q1"])
    rates = [f"accuracy, {label(m)}" if m == "seen_scenes" else f"repair, {m}" for m in claims["measure"]]
    columns = {
        "paper": ["paper", "paper_low", "paper_high"],
        PAPER: ["ours", "q1", "q3"],
        "blind": ["baseline", "baseline", "baseline"],
    }
    parts = [
        pd.DataFrame(claims[names].to_numpy(float), columns=["value", "low", "high"]).assign(rate=rates, source=source)
        for source, names in columns.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _accuracy(results: Results) -> list[dict]:
    """Judge whether accuracy on unseen paths of the training scenes reaches the paper's lower quartile.

    It holds if our lower quartile over training sets does in the main run. If not, it comes out in a reading if some
    declared reading is as in the paper, and else fails if our upper quartile does not reach it.
    """
    n = results.main_n_demos
    if n not in PAPER_ACCURACY:
        return []
    mean, low, high = PAPER_ACCURACY[n]
    ours = results.accuracy(PAPER, SEEN)
    quartile_low, quartile_high = results.accuracy(PAPER, SEEN, "q1"), results.accuracy(PAPER, SEEN, "q3")
    baseline = results.accuracy("nearest_demonstration", SEEN)
    reached = max(results.accuracy(variant, SEEN) for variant in results.variants) >= low
    verdict = _compare(quartile_low >= low, quartile_high < low and reached, baseline >= low)
    if verdict != HOLDS and results.reading_as_in_the_paper(PAPER) is not None:
        verdict = IN_A_READING
    numbers = {"paper": mean, "paper_low": low, "paper_high": high, "ours": ours, "baseline": baseline}
    return [
        {"claim": "accuracy", "measure": SEEN, "q1": quartile_low, "q3": quartile_high, "verdict": verdict} | numbers
    ]


def _autoencoder(results: Results) -> list[dict]:
    """Judge whether the full model beats the classifier in every test; not tested unless all fits passed the gate.

    The gate: it reconstructs its training images better than a flat colour, and judges its demonstrations rightly.
    """
    trained = results.value("convergence", "passed", variant=PAPER) == 1
    return _tested(results, "autoencoder", ["classifier"], results.n_demos, trained)


def _irl(results: Results) -> list[dict]:
    """Judge whether the full model beats both of our forms of IRL in every test, and does so with one demonstration.

    The second is the claim that IRL needs much more information.
    """
    forms = ["irl_maxent", "irl_ranked"]
    rows = _tested(results, "irl", forms, [results.main_n_demos])
    return rows + (_tested(results, "irl_needs_more", forms, [1]) if results.main_n_demos > 1 else [])


def _tested(results: Results, claim: str, against: list[str], n_demos: list[int], trained: bool = True) -> list[dict]:
    """Return the tests won and lost, of those asked, and the range of the differences in accuracy.

    Holds if every test is won, fails if every one is lost, else open: no significance is no proof of equality.
    """
    tests = results.table("comparisons")
    tests = tests[(tests["variant"] == PAPER) & tests["against"].isin(against) & tests["n_demos"].isin(n_demos)]
    if tests.empty:
        return []
    difference = tests["difference"]
    won, lost = ((tests["significant"].astype(bool) & (sign * difference > 0)).sum() for sign in (1, -1))
    verdict = HOLDS if won == len(tests) else FAILS if lost == len(tests) else OPEN
    row = {"claim": claim, "verdict": verdict if trained else NOT_TESTED}
    return [
        row | {"measure": "tests won", "paper": len(tests), "ours": int(won)},
        row | {"measure": "tests lost", "paper": 0, "ours": int(lost)},
        row | {"measure": "difference", "ours": difference.mean(), "q1": difference.min(), "q3": difference.max()},
    ]


def _repair(results: Results) -> list[dict]:
    """Judge whether success reaches the paper's rate for each user; it fails below the Wilson interval of 20 repairs.

    Our interval, over seeds and scenes, must lie above that interval's lower end, so that new training sets change
    nothing.
    """
    rows = []
    for user in results.repaired_users:
        if user not in PAPER_TABLE_1:
            continue
        paper = PAPER_TABLE_1[user]
        low, high = binomtest(round(paper * PAPER_SCENES), PAPER_SCENES).proportion_ci(method="wilson")
        names = {"ours": "success", "q1": "success_q1", "q3": "success_q3"}
        names |= {"ci_low": "success_ci_low", "ci_high": "success_ci_high"}
        numbers = {name: results.repair("gradient", PAPER, user, column) for name, column in names.items()}
        baseline = results.repair("constant_detour", "", user)
        met = numbers["ours"] >= paper and numbers["ci_low"] >= low
        reached = max(results.repair("gradient", variant, user) for variant in results.variants) >= low
        verdict = _compare(met, numbers["ci_high"] < low and reached, baseline >= numbers["ours"])
        beside = {"paper": paper, "paper_low": low, "paper_high": high, "baseline": baseline, "verdict": verdict}
        rows.append({"claim": "repair", "measure": user} | numbers | beside)
    return rows


def _causes(results: Results) -> list[dict]:
    """Judge whether every verdict on an added item is right; it fails if an image-blind model is as good as ours."""
    right, asked = results.verdicts_right(PAPER), results.questions()
    if asked == 0:
        return []
    blind, best = results.image_blind_right(), max(map(results.verdicts_right, results.variants))
    verdict = _compare(right == asked, right <= blind < best, blind == asked)
    return [_counted("causes", right, asked, blind, verdict)]


def _users_differ(results: Results) -> list[dict]:
    """Judge whether every verdict on a change of user is right; it fails if none is.

    Shares of valid paths show this without images.
    """
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
