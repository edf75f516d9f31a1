"""The paper's claims, one by one: its number, ours, what it takes without looking, and whether it holds here."""

import pandas as pd

from pipeline.report import paper
from pipeline.report.results import NULLS, POSITION, Results
from pipeline.report.table import Table, table
from pipeline.report.wording import NONE, counted, listed, percent, percent_spread, variant_label
from pipeline.table.layout import SYMBOLS

SEEN, NEW, UNSEEN = "seen_scenes", "new_scenes", "new_items"
HELD, PARTLY, FAILED, VACUOUS = "reproduced", "in part", "not reproduced", "vacuous"


def claims(results: Results) -> Table:
    """What the abstract and its tables say, and what became of it."""
    rows = [
        *_accuracy(results), *_rises(results), *_identified(results), *_rivals(results), *_repairs(results),
        *_differ(results), _causes(results),
    ]  # fmt: skip
    caption = (
        f"The paper's claims and what became of them: {counted(len(results.seeds), 'seed')}, model as in the paper. "
        f"An accuracy or "
        "success rate is reproduced if our mean reaches the paper's (its lower quartile where it gives one); an "
        "advantage, if every test fixed in advance finds it; a rise, if it is one in every seed; the causes, and how "
        "users differ, if every verdict is the true one. In part: in the training scenes only, or in some of the "
        "tests or verdicts. Null: a method that never looks at the image. "
        "The paper calls its accuracy that of identifying users; here it is a user named from labelled paths. Pairs "
        "of users count in both directions."
    )
    header = ["Claim", "Paper", "Here", "Null", "Verdict"]
    return table("claims", caption, header, [list(row) for row in rows])


def tested(results: Results, against: list[str], n: int | None = None, variant: str | None = None) -> pd.DataFrame:
    """The tests of a variant (None: the paper's model) against others, all of them or those at one n."""
    rows = results.comparisons[results.comparisons["variant"] == (variant or results.main)]
    rows = rows[rows["against"].isin(against)]
    return rows if n is None else rows[rows["n"] == n]


def wins(rows: pd.DataFrame) -> pd.DataFrame:
    """The tests won by the variant they are about."""
    return rows[rows["significant"] & (rows["difference"] > 0)]


def reaches(results: Results, split: str, n: int) -> bool:
    """Whether our mean accuracy is at least the paper's lower quartile."""
    return results.evaluation["accuracy"][results.main][split][f"n{n}"]["mean"] >= paper.ACCURACY[n].q1


def _accuracy(results: Results) -> list[tuple[str, ...]]:
    rows = []
    ours = results.evaluation["accuracy"][results.main]
    nulls = {v: results.evaluation["accuracy"][v] for v in NULLS}
    for n in sorted(set(results.ns) & set(paper.ACCURACY), reverse=True):
        held = [reaches(results, split, n) for split in (SEEN, NEW, UNSEEN) if split in ours]
        here = (
            f"{percent_spread(ours[SEEN][f'n{n}'])} in training scenes, {percent_spread(ours[UNSEEN][f'n{n}'])} "
            "with unseen items"
        )
        verdict = HELD if all(held) else PARTLY if any(held) else FAILED
        name = f"Valid paths are told from invalid ones, {counted(n, 'demonstration')} a scene"
        rows.append(
            (
                name,
                percent_spread(paper.ACCURACY[n]._asdict()),
                here,
                "; ".join(_best_null(nulls, split, n) for split in (SEEN, UNSEEN)),
                verdict,
            )
        )
    return rows


def _rises(results: Results) -> list[tuple[str, ...]]:
    """More demonstrations a scene, more right: in every seed, in training scenes and with unseen items."""
    few, most = min(results.ns), max(results.ns)
    if few == most:
        return []
    rows = results.accuracy[results.accuracy["user"].isin(results.judged_users)]
    by_seed = rows[rows["variant"] == results.main].groupby(["split", "n", "seed"])["accuracy"].mean()
    said, held = [], []
    for split, where in ((SEEN, "in training scenes"), (UNSEEN, "with unseen items")):
        before, after = by_seed[split, few], by_seed[split, most]
        rises = int((after > before).sum())
        held.append(rises == len(results.seeds))
        said.append(f"{percent(before.mean())} to {percent(after.mean())} {where} ({rises} of {len(results.seeds)})")
    verdict = HELD if all(held) else PARTLY if any(held) else FAILED
    name = f"Accuracy rises with the demonstrations a scene, {few} to {most} (seeds in which it does)"
    quoted = f"{percent(paper.ACCURACY[1].mean, 0)} to {percent(paper.ACCURACY[9].mean, 0)}"
    return [(name, quoted, "; ".join(said), NONE, verdict)]


def _identified(results: Results) -> list[tuple[str, ...]]:
    """The abstract calls its accuracy at 9 demonstrations that of identifying users; here paths tell them apart."""
    cells, quoted = results.identification["identification"][results.main], paper.ACCURACY[9]
    many = max(cells, key=lambda key: int(key[1:]))
    cell = cells[many]
    here = f"{percent(cell['mean'])} after {many[1:]} labelled paths (told the rules: {percent(cell['ideal'])})"
    null = f"{percent(results.identification['identification'][POSITION][many]['mean'])} (position only)"
    verdict = HELD if cell["mean"] >= quoted.q1 else FAILED
    return [("The user's type is identified", percent_spread(quoted._asdict()), here, null, verdict)]


def _differ(results: Results) -> list[tuple[str, ...]]:
    """The paper's first inequality: the models of different users differ as the users do.

    Who answers to every path each user's own share of valid ones, never looking at it, differs as they do.
    """
    by_user = results.intervention["specifications"][results.main]
    cells = [c for others in by_user.values() for c in others.values()]
    if not cells:
        return []
    right = sum(c["right"] for c in cells)
    verdict = HELD if right == len(cells) else PARTLY if right else FAILED
    here = f"{right} of {len(cells)} pairs differ as they truly do"
    null = f"{len(cells)} of {len(cells)} (each user's share of valid paths)"
    return [("Users' models judge the same paths differently", "yes", here, null, verdict)]


def _best_null(nulls: dict[str, dict], split: str, n: int) -> str:
    """The null that judges a split best, and how well."""
    means = {v: of[split][f"n{n}"]["mean"] for v, of in nulls.items() if split in of}
    best = max(means, key=lambda v: means[v])
    where = {SEEN: "training scenes", UNSEEN: "unseen items"}[split]
    return f"{percent(means[best])} ({variant_label(best).removeprefix('Null: ')}, {where})"


def _rivals(results: Results) -> list[tuple[str, ...]]:
    """Claims of one model over another; only tests that were fixed in advance count."""
    rows = []
    rivals = {
        "An autoencoder helps (full over classifier only)": ["classifier"],
        "It outperforms inverse reinforcement learning": [v for v in results.variants if v.startswith("irl")],
    }
    for name, against in rivals.items():
        tests = tested(results, against)
        if tests.empty:
            continue
        won, lost = len(wins(tests)), int((tests["significant"] & (tests["difference"] < 0)).sum())
        verdict = HELD if won == len(tests) else PARTLY if won else FAILED
        rows.append((name, "yes", f"better in {won}, worse in {lost} of {counted(len(tests), 'test')}", NONE, verdict))
    return rows


def _repairs(results: Results) -> list[tuple[str, ...]]:
    rows = []
    for user in results.users:
        c, quoted = results.repair[results.main][user], paper.REPAIR.get(user)
        if quoted is None:
            continue
        name = f"Gradient steps repair invalid paths, {user} user"
        if c["success"] is None:
            rows.append((name, percent(quoted, 0), "no path is invalid", NONE, VACUOUS))
            continue
        here = percent_spread(c, "success", "success_q1", "success_q3")
        verdict = HELD if c["success"] >= quoted else FAILED
        rows.append((name, percent(quoted, 0), here, f"{percent(c['null_constant'])} (constant detour)", verdict))
    return rows


def free_right(results: Results) -> int:
    """Verdicts a model gets right that ignores the image: every cell whose true effect is none."""
    cells = results.intervention["interventions"][results.main]
    return sum(c["truth_verdict"] == "no effect" for by_symbol in cells.values() for c in by_symbol.values())


def _causes(results: Results) -> tuple[str, ...]:
    tally = results.intervention["verdicts"][results.main]
    bold = [f"{u} {s}" for u in results.users for s in SYMBOLS if (u, s) in paper.BOLD]
    by_user = {u: [s for s in SYMBOLS if (u, s) in paper.BOLD] for u in results.users}
    quoted = f"{counted(len(bold), 'effect')}: " + listed(
        [f"{u} ({'all four' if len(s) == len(SYMBOLS) else listed(s)})" for u, s in by_user.items() if s]
    )
    here = f"{tally['right']} of {tally['cells']} verdicts right"
    verdict = HELD if tally["right"] == tally["cells"] else PARTLY if tally["right"] > free_right(results) else FAILED
    null = f"{free_right(results)} of {tally['cells']}"
    return ("Interventions reveal which symbols matter to whom", quoted, here, null, verdict)
