"""What the results say, in sentences whose words follow the numbers: none can outlive what it was true of."""

import numpy as np

from pipeline.report import paper
from pipeline.report.claims import (
    FAILED,
    HELD,
    NEW,
    PARTLY,
    SEEN,
    UNSEEN,
    VACUOUS,
    claims,
    free_right,
    reaches,
    tested,
    wins,
)
from pipeline.report.results import Results
from pipeline.report.wording import (
    counted,
    listed,
    p_value,
    percent,
    percent_spread,
    points,
    split_phrase,
    variant_phrase,
)
from pipeline.table.layout import SYMBOLS

VERDICTS = (HELD, PARTLY, FAILED, VACUOUS)
CLEAR = 0.10  # a gap in accuracy that a sentence calls large
SLIGHT = 0.05  # one that it calls small


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
    return [
        f"{within} of the {len(cells)} cells of the paper's Table 2 are met within 0.03; the largest difference is "
        f"{max(gaps):.3f}. So the world poses the paper's problem, and, unlike a real table, tells the truth about "
        f"every path.",
        f"A quadratic Bezier curve fits the {len(demos):,} recorded demonstrations with a residual of "
        f"{1000 * demos['residual_m'].mean():.1f} mm on average; {counted(int(demos['poor_fit'].sum()), 'fit')} "
        "flagged as poor. Valid among them: " + listed([f"{percent(s, 0)} ({u})" for u, s in shares.items()]) + ".",
    ]


def accuracy(results: Results) -> list[str]:
    """What the paper's model knows, against the paper, the nulls and its rivals."""
    return [*_against_paper(results), *_against_nulls(results), *_against_rivals(results)]


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
    out = [_versus(results, null, split) for null, split in (("null_nearest", SEEN), ("null_position", UNSEEN))]
    key = f"n{results.study_n}"
    ours, null = (results.evaluation["accuracy"][v] for v in (results.main, "null_position"))
    drop = ours[SEEN][key]["mean"] - ours[NEW][key]["mean"]
    above = ours[NEW][key]["mean"] - null[NEW][key]["mean"]
    if drop > CLEAR and above < SLIGHT:
        out.append(
            f"From its training scenes to new ones with the very same items it loses {points(drop)}, and what is left "
            f"is "
            f"within {points(SLIGHT)} of the null or below it: the architecture mostly remembers its training scenes. "
            "Nothing ties a place in the picture to a place on the path, so each scene is learned by heart."
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
    out = []
    leads = {
        "ae": "The paper's ablation says that the whole of its loss helps.",
        "classifier": "It says above all that an autoencoder helps, most with few demonstrations.",
        **{v: "" for v in results.variants if v.startswith("irl")},
    }
    for against, lead in leads.items():
        tests = tested(results, [against])
        if tests.empty:
            continue
        won = wins(tests)
        lost = tests[tests["significant"] & (tests["difference"] < 0)]
        same = len(tests) - len(won) - len(lost)
        parts = []
        for rows, word in ((won, "better"), (lost, "worse")):
            if len(rows):
                where = [f"{points(r.difference)} on {split_phrase(r.split)} at n = {r.n}" for r in rows.itertuples()]
                parts.append(f"{word} in {len(rows)} ({listed(where)})")
        if same:
            parts.append(f"not told apart in {same}")
        text = f"Against {variant_phrase(against)}, in {counted(len(tests), 'test')} the full model is {listed(parts)}."
        out.append(f"{lead} {text}".strip())
    return out


def repair(results: Results) -> list[str]:
    """What gradient repair achieves, and what it would take no image to achieve."""
    out = []
    for user in results.users:
        c, quoted = results.repair[results.main][user], paper.REPAIR.get(user)
        if c["success"] is None:
            out.append(
                f"Every path is valid to the {user} user, so no start is invalid and there is nothing to repair"
                + (f": the paper's {percent(quoted, 0)} is met by doing nothing." if quoted == 1 else ".")
            )
            continue
        out.append(_user_repair(results, user))
    return out


def _user_repair(results: Results, user: str) -> str:
    c, quoted = results.repair[results.main][user], paper.REPAIR.get(user)
    success = percent_spread(c, "success", "success_q1", "success_q3")
    text = (
        f"{user.capitalize()}: the paper's model ends {success} of {c['starts']:,} invalid starts in a truly valid path"
        + (f" (paper: {percent(quoted, 0)})" if quoted is not None else "")
        + f". One detour that is the same in every scene reaches {percent(c['null_constant'])}, a random path "
        f"{percent(c['null_random'])}; the model is above the detour in {_seeds_above(results, user)} of "
        f"{counted(len(results.seeds), 'seed')}."
    )
    if quoted is not None and quoted <= c["null_constant"] + SLIGHT:
        text += (
            f" The paper's rate is not {points(SLIGHT)} above the detour's, so a success rate alone does not show "
            "that the image was used."
        )
    text += (
        f" Its repairs move the control point {c['displacement_ratio']:.1f} times as far as the nearest valid "
        "path would ask."
    )
    best = max(results.variants, key=lambda v: results.repair[v][user]["success"])
    if best != results.main:
        b = results.repair[best][user]
        text += (
            f" The highest success is that of {variant_phrase(best)}: "
            f"{percent_spread(b, 'success', 'success_q1', 'success_q3')} at {b['displacement_ratio']:.1f} times the "
            f"least distance."
        )
    return text


def _seeds_above(results: Results, user: str) -> int:
    """Seeds in which the paper's model repairs more starts than the constant detour of the same seed."""
    rows = results.repairs[results.repairs["user"] == user]
    by = rows.groupby(["method", "seed"])["valid_end"].mean()
    return int((by[results.main].loc[results.seeds] > by["null_constant"].loc[results.seeds]).sum())


def interventions(results: Results) -> list[str]:
    """What asking 'what if one more item stood there?' reveals about each model, and how much of it is true."""
    cells = results.intervention["interventions"]
    true = [(u, s) for u in results.users for s in SYMBOLS if cells[results.main][u][s]["truth_verdict"] == "effect"]
    printed = {(u, s) for u, s in paper.BOLD if u in results.users}
    total = len(results.users) * len(SYMBOLS)
    agree = (
        "They are the very cells that the paper prints in bold."
        if set(true) == printed
        else (f"The paper prints {len(printed)} in bold, {len(printed & set(true))} of them among these.")
    )
    out = [
        f"In truth an added item changes the mean validity by more than 0.05 in {len(true)} of {total} cells: "
        f"{listed([f'{u} and {s}' for u, s in true])}. {agree} A model that ignores the image shows no effect anywhere "
        f"and so gets {free_right(results)} of {total} verdicts right; that is the null here."
    ]  # fmt: skip
    out += [_tally(results, variant, true) for variant in results.variants]
    free = [u for u in results.users if results.demos.loc[results.demos["user"] == u, "valid"].all()]
    if free:
        out.append(
            f"Every demonstration of the {listed(free)} user is valid. A model fitted to a single answer can only "
            f"repeat it, so "
            f"its {counted(len(free) * len(SYMBOLS), 'verdict')} cannot go wrong and show nothing."
        )
    return out


def _tally(results: Results, variant: str, true: list[tuple[str, str]]) -> str:
    cells, t = results.intervention["interventions"][variant], results.intervention["verdicts"][variant]
    found = [(u, s) for u, s in true if cells[u][s]["verdict"] == "effect" and cells[u][s]["right"]]
    error = np.mean([abs(cells[u][s]["effect"] - cells[u][s]["truth"]) for u in cells for s in SYMBOLS])
    text = (
        f"{_start(variant_phrase(variant))}: {t['right']} of {t['cells']} verdicts right; it finds {len(found)} of the "
        f"{counted(len(true), 'true effect')}"
    )
    if t["false_causes"]:
        text += f", names {counted(t['false_causes'], 'false cause')}"
    if t["missed_causes"]:
        text += f", denies {counted(t['missed_causes'], 'real one')}"
    if t["inconclusive"]:
        text += f" and leaves {t['inconclusive']} open"
    return (
        text + f" (mean distance of its effects from the true ones {error:.3f}; {counted(len(results.seeds), 'seed')})."
    )


def _start(text: str) -> str:
    return text[0].upper() + text[1:]


def specifications(results: Results) -> str:
    """do(S := s): whether the users' models differ as the users do."""
    parts = []
    for variant, by_user in results.intervention["specifications"].items():
        cells = [c for by_other in by_user.values() for c in by_other.values()]
        parts.append(f"{sum(c['right'] for c in cells)} of {len(cells)} for {variant_phrase(variant)}")
    return (
        "Exchanging the user, do(S := s), asks whether another user's model judges the same paths differently. "
        "Verdicts that "
        f"agree with the truth: {listed(parts)}. How many paths are valid to whom can be learned without looking at "
        f"the image, "
        "so this is the easier question."
    )


def calibration(results: Results) -> str:
    """Whether a probability of .9 means nine in ten."""
    errors = results.evaluation["calibration"]
    parts = [f"{variant_phrase(v)} {errors[v][UNSEEN]['ece']:.3f}" for v in results.variants]
    return (
        f"A probability is worth something if paths given 0.9 are valid nine times in ten. With unseen items, at n = "
        f"{results.study_n}, "
        f"the mean gap between the two (expected calibration error, 0 is ideal) is: {listed(parts)}; for "
        f"{variant_phrase('null_position')} {errors['null_position'][UNSEEN]['ece']:.3f}."
    )
