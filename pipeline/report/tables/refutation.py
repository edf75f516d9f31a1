"""Attempts to refute: what each does and asks, and how often it found something."""

from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, percent, refuter_label, variant_label


def refuters(results: Results) -> Table:
    """What each refuter does, which question it serves, and how to read it."""
    rows: list[list[str | Cell]] = [
        [
            refuter_label(name),
            f"{r['done'].capitalize()}.",
            f"{r['asks'].capitalize()}?",
            r["null"],
            r["reading"],
        ]
        for name, r in results.refutation["said"].items()
    ]
    caption = "What should have no effect, the question it serves, and how to read it."
    return table(
        "refuters", caption, ["Refuter", "What is done", "Question", "Null hypothesis", "How to read p"], rows, labels=1
    )


def refuted(results: Results) -> Table:
    """Cells in which a refuter found an effect, by variant; verdicts of half of the scenes."""
    found = results.refutation
    rows: list[list[str | Cell]] = []
    for variant in results.variants:
        shown = []
        for name in results.refuters:
            t = found["tallies"][name].get(variant)
            left = f", {t['inconclusive']} open" if t and t["inconclusive"] else ""
            shown.append(NONE if t is None else f"{t['effect']} ({_significant(results, name, variant)}){left}")
        half = found["halves"][variant]
        rows.append([variant_label(variant), *shown, f"{percent(half['same'])} ({percent(half['least'], 0)})"])
    caption = (
        f"Of {_cells(results)} cells, a user and a symbol each, those in which a refuter finds an effect where there "
        "should be none, or on another table another effect: significant and larger than .05 (in brackets: p < .05 "
        "after Holm over these cells, however small); open: inconclusive "
        f"({counted(found['seeds'], 'seed')}, the first {counted(_scenes(results), 'scene')}). Half of the scenes: how "
        "often a random half of all that were intervened on leads to the verdict of all of them, on average over the "
        "cells (and in the cell where it does least often)."
    )
    header = ["Variant", *(refuter_label(name) for name in results.refuters), "Half of the scenes"]
    return table("refuted", caption, header, rows)


def _significant(results: Results, refuter: str, variant: str) -> int:
    cells = (c for by_symbol in results.refutation["refuters"][refuter][variant].values() for c in by_symbol.values())
    return sum(c["p_holm"] < results.selftest["level"] for c in cells)


def _cells(results: Results) -> int:
    return max(t["cells"] for by_variant in results.refutation["tallies"].values() for t in by_variant.values())


def _scenes(results: Results) -> int:
    return max(t["scenes"] for by_variant in results.refutation["tallies"].values() for t in by_variant.values())
