"""What the paper's model knows, against the paper, the nulls and its rivals."""

from pipeline.report import paper
from pipeline.report.claims import (
    NEW,
    SEEN,
    UNSEEN,
    reaches,
    tested,
    wins,
)
from pipeline.report.results import NEAREST, POSITION, Results
from pipeline.report.wording import (
    counted,
    listed,
    p_value,
    percent,
    percent_spread,
    points,
    signed,
    split_phrase,
    variant_phrase,
)

CLEAR = 0.10  # a gap in accuracy that a sentence calls large
SLIGHT = 0.05  # one that it calls small


def accuracy(results: Results) -> list[str]:
    """What the paper's model knows, against the paper, the nulls and its rivals."""
    return [*_against_paper(results), *_against_nulls(results), *_against_rivals(results), *_beyond(results)]


def _against_paper(results: Results) -> list[str]:
    ours, out = results.evaluation["accuracy"][results.main], []
    for n in sorted(set(results.ns) & set(paper.ACCURACY), reverse=True):
        key = f"n{n}"
        parts = [f"{percent_spread(ours[s][key])} on {split_phrase(s)}" for s in results.splits]
        gap = paper.ACCURACY[n].mean - ours[SEEN][key]["mean"]
        if reaches(results, SEEN, n):
            close = "In the training scenes that meets the paper's figure"
            close += "." if reaches(results, UNSEEN, n) else "; with unseen items it does not."
        else:
            close = f"Even in the training scenes that is {points(gap)} short of the paper."
        quoted = percent_spread(paper.ACCURACY[n]._asdict())
        out.append(
            f"With {counted(n, 'demonstration')} a scene the paper reports {quoted}. The same architecture, fitted to "
            f"{counted(len(results.seeds), 'training set')}, reaches {listed(parts)} (mean [quartiles over seeds], "
            f"{listed(results.judged_users)} users). {close}"
        )
    return out


def _against_nulls(results: Results) -> list[str]:
    out = [_versus(results, null, split) for null, split in ((NEAREST, SEEN), (POSITION, UNSEEN))]
    key = f"n{results.study_n}"
    ours, null = (results.evaluation["accuracy"][v] for v in (results.main, POSITION))
    drop = ours[SEEN][key]["mean"] - ours[NEW][key]["mean"]
    above = ours[NEW][key]["mean"] - null[NEW][key]["mean"]
    if drop > CLEAR and above < SLIGHT:
        out.append(
            f"From its training scenes to new ones with the very same items it loses {points(drop)}, and what is left "
            f"is within {points(SLIGHT)} of the null or below it: what it learned is of its training scenes. "
            "A likely reason: nothing in it ties a place in the picture to a place on the path."
        )
    elif above > CLEAR:
        out.append(
            f"In new scenes it stays {points(above)} above the position-only null: it sees something of the scene."
        )
    return [x for x in out if x]


def _versus(results: Results, against: str, split: str) -> str:
    """One test fixed in advance, as a sentence; empty if it was not among them."""
    rows = tested(results, [against], results.study_n)
    rows = rows[rows["split"] == split]
    if rows.empty:
        return ""
    r = rows.iloc[0]
    lead = (
        f"On {split_phrase(split)}, {variant_phrase(against)} is right about {percent(r['mean_against'])} of the paths "
        f"without seeing the image, the paper's model about {percent(r['mean'])}: "
    )
    if not r["significant"]:
        return lead + f"not told apart by {counted(int(r['seeds']), 'seed')} ({p_value(r['p_holm'])} after Holm)."
    side = "better" if r["difference"] > 0 else "worse"
    return (
        lead
        + f"{points(r['difference'])} {side} ({p_value(r['p_holm'])} after Holm, {counted(int(r['seeds']), 'seed')})."
    )


def _against_rivals(results: Results) -> list[str]:
    leads = {
        "ae": "The paper's ablation says that the whole of its loss helps.",
        "classifier": "It says above all that an autoencoder helps, most with few demonstrations.",
        **{v: "" for v in results.variants if v.startswith("irl")},
    }
    texts = [(lead, _tests(results, results.main, against)) for against, lead in leads.items()]
    return [f"{lead} {text}".strip() for lead, text in texts if text]


def _beyond(results: Results) -> list[str]:
    """Tests of variants that the paper does not have, and what new scenes and unseen items cost them."""
    out, key = [], f"n{results.study_n}"
    for variant in [v for v in results.variants if v != results.main]:
        texts = [_tests(results, variant, against) for against in results.variants if against != variant]
        texts = [text for text in texts if text]
        if texts:
            cells = results.evaluation["accuracy"][variant]
            drops = [f"{signed(100 * (cells[s][key]['mean'] - cells[SEEN][key]['mean']), 1)} on {split_phrase(s)}"
                     for s in results.splits if s != SEEN]  # fmt: skip
            texts.append(
                f"From its {percent(cells[SEEN][key]['mean'])} on {split_phrase(SEEN)} its accuracy changes, in "
                f"percentage points, by {listed(drops)}."
            )
            out.append(" ".join(texts))
    return out


def _tests(results: Results, variant: str, against: str) -> str:
    """The tests of one variant against another, as a sentence; empty if none was fixed."""
    tests = tested(results, [against], variant=variant)
    if tests.empty:
        return ""
    won = wins(tests)
    lost = tests[tests["significant"] & (tests["difference"] < 0)]
    if not len(won) + len(lost):
        return (
            f"Against {variant_phrase(against)} {variant_phrase(variant)} is not told apart in any of "
            f"{counted(len(tests), 'test')}."
        )
    same = len(tests) - len(won) - len(lost)
    parts = []
    for rows, word in ((won, "better"), (lost, "worse")):
        if len(rows):
            where = [f"{points(r.difference)} on {split_phrase(r.split)} at n = {r.n}" for r in rows.itertuples()]
            parts.append(f"{word} in {len(rows)} ({listed(where)})")
    if same:
        parts.append(f"not told apart in {same}")
    return (
        f"Against {variant_phrase(against)}, in {counted(len(tests), 'test')} {variant_phrase(variant)} is "
        f"{listed(parts)}."
    )


def calibration(results: Results) -> str:
    """Whether a probability of .9 means nine in ten."""
    errors = results.evaluation["calibration"]
    parts = [f"{variant_phrase(v)} {errors[v][UNSEEN]['ece']:.3f}" for v in results.variants]
    return (
        f"A probability is worth something if paths given 0.9 are valid nine times in ten. With unseen items, at n = "
        f"{results.study_n}, "
        f"the mean gap between the two (expected calibration error, 0 is ideal) is: {listed(parts)}; for "
        f"{variant_phrase(POSITION)} {errors[POSITION][UNSEEN]['ece']:.3f}. "
        f"{_sure(results)}"
    )


def _sure(results: Results) -> str:
    """Whether a model promises more valid paths than there are, or fewer."""
    errors = {v: results.evaluation["calibration"][v][UNSEEN]["bias"] for v in results.variants}
    parts = [f"{variant_phrase(v)} {signed(100 * bias, 1)}" for v, bias in errors.items()]
    return f"Its direction, mean probability less the share that is valid, in percentage points: {listed(parts)}."
