"""The report in a few sentences, and how well the world meets the paper's."""

from pipeline.report.claims import (
    FAILED,
    HELD,
    PARTLY,
    SEEN,
    UNSEEN,
    VACUOUS,
    claims,
    free_right,
)
from pipeline.report.results import Results
from pipeline.report.wording import (
    counted,
    listed,
    percent,
    percent_spread,
    variant_phrase,
)

CLOSE = 0.05  # largest difference from the paper at which the worlds are called alike
VERDICTS = (HELD, PARTLY, FAILED, VACUOUS)


def summary(results: Results) -> list[str]:
    """The report in a few sentences."""
    verdicts = [row[-1].text for row in claims(results).rows]
    counts = [f"{verdicts.count(v)} {'is' if verdicts.count(v) == 1 else 'are'} {v}" for v in VERDICTS if v in verdicts]
    key = f"n{results.study_n}"
    scores = {v: results.evaluation["accuracy"][v] for v in (*results.variants, "null_position")}
    ours, best = scores[results.main], max(results.variants, key=lambda v: scores[v][UNSEEN][key]["mean"])
    tally = results.intervention["verdicts"][results.main]
    top = max(results.variants, key=lambda v: results.intervention["verdicts"][v]["right"])
    out = [
        f"Of the paper's {len(verdicts)} claims below, {listed(counts)} in this simulated world.",
        f"The paper's model judges {percent_spread(ours[SEEN][key])} of new paths rightly in scenes it was trained "
        f"on, and "
        f"{percent_spread(ours[UNSEEN][key])} in scenes with unseen items, where a guess by position alone, without "
        f"the "
        f"image, reaches {percent(scores['null_position'][UNSEEN][key]['mean'])} (n = {results.study_n}, "
        f"{counted(len(results.seeds), 'seed')}).",
        f"Asked what an added item would change, it gives the true verdict in {tally['right']} of {tally['cells']} "
        f"cells; "
        f"ignoring the image altogether gives {free_right(results)}.",
    ]
    if best != results.main:
        right = results.intervention["verdicts"][top]["right"]
        out.append(
            f"The task itself can be learned from the same demonstrations as far as this: {variant_phrase(best)} "
            f"reaches "
            f"{percent_spread(scores[best][UNSEEN][key])} with unseen items, and {variant_phrase(top)} the most true "
            f"verdicts, {right} of {tally['cells']}."
        )
    return out


def world(results: Results) -> list[str]:
    """How well the simulated world meets the paper's, and how well paths were fitted."""
    cells = [c for by in results.world["p_valid"].values() for c in by.values() if c.get("paper") is not None]
    gaps = [abs(c["truth"] - c["paper"]) for c in cells]
    within = sum(round(g, 4) <= 0.03 for g in gaps)
    demos = results.demos[results.demos["seed"].isin(results.seeds)]
    shares = {u: demos.loc[demos["user"] == u, "valid"].mean() for u in results.users}
    met = (
        f"{within} of the {len(cells)} cells of the paper's Table 2 are met within 0.03; the largest difference is "
        f"{max(gaps):.3f}."
    )
    if max(gaps) <= CLOSE:
        met += " So the world poses the paper's problem, and, unlike a real table, tells the truth about every path."
    return [
        met,
        f"A quadratic Bezier curve fits the {len(demos):,} recorded demonstrations with a residual of "
        f"{1000 * demos['residual_m'].mean():.1f} mm on average; {counted(int(demos['poor_fit'].sum()), 'fit')} "
        "flagged as poor. Valid among them: " + listed([f"{percent(s, 0)} ({u})" for u, s in shares.items()]) + ".",
    ]
