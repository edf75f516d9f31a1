"""Whether attempts to refute the effects succeeded."""

from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, refuter_label, signed, variant_phrase

MADE = {  # patch -> how it is made
    "placebo": "and its pixels shuffled",
    "mosaic": "and its pieces shuffled, a mosaic,",
}


def refutation(results: Results) -> list[str]:
    """Answers kept apart: is the machinery sound, and does the effect survive; then placebos, halves and items."""
    questions = dict.fromkeys(results.refuter(name)["asks"] for name in results.refuters)
    return [*(_answer(results, q) for q in questions), *_placebos(results), _halves(results), _items(results)]


def _answer(results: Results, question: str) -> str:
    parts, fails, undecided = [], set(), 0
    for name in (n for n in results.refuters if results.refuter(n)["asks"] == question):
        tallies = results.refutation["tallies"][name]
        effects = {v: tallies[v] for v in results.variants if v in tallies and tallies[v]["effect"]}
        some = [f"{variant_phrase(v)} in {t['effect']} of {t['cells']}" for v, t in effects.items()]
        left = sum(t["inconclusive"] for t in tallies.values())
        parts.append(
            f"{refuter_label(name).lower()}: {listed(some) if some else 'no variant'}{_aside(results, name, left)}"
        )
        fails |= set(effects)
        undecided += left
    said = [variant_phrase(v) for v in results.variants if v in fails]
    none = "No attempt found otherwise, but some left it open" if undecided else "No attempt says otherwise"
    answer = f"Not beyond doubt: {listed(said)} failed an attempt" if said else none
    return f"{question.capitalize()}? {answer}. Cells with an effect where there should be none: {'; '.join(parts)}."


def _aside(results: Results, refuter: str, left: int) -> str:
    """The cells of all variants that are open, and those with an effect too small to matter that is none by chance."""
    cells = {
        variant: [c for by_symbol in by_user.values() for c in by_symbol.values()]
        for variant, by_user in results.refutation["refuters"][refuter].items()
    }
    level, total = results.selftest["level"], sum(map(len, cells.values()))
    small = {v: sum(c["verdict"] == "no effect" and c["p_holm"] < level for c in of) for v, of in cells.items()}
    whose = listed([f"{variant_phrase(v)} {count}" for v, count in small.items() if count])
    said = [f"{left} open"] * bool(left) + [
        f"{sum(small.values())} too small to matter, but significant: {whose}"
    ] * any(small.values())
    return f" (of all {total} cells {listed(said)})" if said else ""


def _placebos(results: Results) -> list[str]:
    """The variants that take a patch for an item, by the pooled effect of all symbols' patches."""
    moved = {kind: _moved(results, kind) for kind in MADE}
    parts = [f"{MADE[kind]} still moves {listed(said)}" for kind, said in moved.items() if said]
    if not parts:
        return []
    return [
        f"A patch with an item's outline {'; one '.join(parts)}, all symbols' patches taken together (in brackets the "
        "effect of the items themselves). Such a model has learned that something lying there matters, and would mind "
        "a stain of that look as well; its effects hold for tables on which whatever looks so is an item."
        + "".join(_mistaken(results, kind) for kind in MADE)
    ]


def _moved(results: Results, kind: str) -> list[str]:
    said = []
    for variant in results.variants:
        cells = {u: c for u, c in results.refutation[kind][variant].items() if c["verdict"] == "effect"}
        by_user = [f"{user} {signed(c['effect'])}{_beside(results, variant, user)}" for user, c in cells.items()]
        said += [f"{variant_phrase(variant)} ({listed(by_user)})"] * bool(cells)
    return said


def _beside(results: Results, variant: str, user: str) -> str:
    """The mean effect of the items themselves, in the same scenes."""
    return f" ({signed(results.refutation['items_alone'][variant][user])})"


def _mistaken(results: Results, kind: str) -> str:
    """Patches made of symbols that a user does not mind, and that a model takes for one that he does."""
    cells = [
        f"{symbol} for the {user} user ({variant_phrase(variant)}, {signed(c['effect'])})"
        for variant, by_user in results.refutation["refuters"][kind].items()
        for user, by_symbol in by_user.items()
        for symbol, c in by_symbol.items()
        if c["verdict"] == "effect" and results.envelope["oracle"][user][symbol]["truth_m"] is None
    ]
    lead = f"{refuter_label(kind)}, made of an item that a user does not mind and taken for what he minds"
    return f" {lead}: {listed(cells)}." if cells else ""


def _halves(results: Results) -> str:
    halves = results.refutation["halves"]
    shaky = min(halves, key=lambda v: halves[v]["least"])
    count = next(iter(halves.values()))["scenes"]
    return (
        f"Halves of the {counted(count, 'scene')}, drawn at random, lead to the verdict of all of them in "
        f"{percent(min(h['same'] for h in halves.values()))} to {percent(max(h['same'] for h in halves.values()))} of "
        f"the cases, by variant; least often, {percent(halves[shaky]['least'], 0)}, in a cell of "
        f"{variant_phrase(shaky)}."
    )


def _items(results: Results) -> str:
    found = {v: results.refutation["items"][v] for v in results.variants}
    changed = [f"{variant_phrase(v)} ({c['cells'] - c['same']})" for v, c in found.items() if c["same"] < c["cells"]]
    return (
        "Intervals and verdicts speak of other scenes with these items. If an effect has to hold from item to item (at "
        f"least {min(c['items'] for c in found.values())} of each symbol), verdicts change of "
        f"{listed(changed) if changed else 'no variant'}."
    )
