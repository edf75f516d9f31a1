"""Pictures of interventions, and of the procedure that judges them."""

from functools import partial

from pipeline.report.figures import (
    graph,
    interventions,
    power,
)
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.tables.causes import TWICE
from pipeline.report.wording import listed, percent, variant_phrase
from pipeline.table.layout import SYMBOLS


def causal_graph(results: Results) -> Picture:
    """The graph that the questions are asked of."""
    parents = results.intervention["scm"]
    arrows = [f"{cause} to {node}" for node in parents for cause in parents[node]]
    caption = (
        "The causal graph that every question is asked of: large circles are its variables, small ones their noises. "
        "Adding an item acts on O, exchanging the user on S; which path is asked about is drawn, not caused."
    )
    draw = partial(graph.draw, parents)
    return picture("graph", caption, f"Causal graph with arrows {listed(arrows)}.", draw)


def effects(results: Results, drawn: Drawn) -> Picture:
    cells = {v: results.intervention["interventions"][v] for v in results.variants}
    parts = []
    for variant in results.variants:
        t = results.intervention["verdicts"][variant]
        parts.append(f"{variant_phrase(variant)} {t['right']} of {t['cells']}")
    alt = f"Effects of an added item with 95 % intervals beside the true ones. Right verdicts: {listed(parts)}."
    caption = (
        "What one more item does to mean validity: each variant's average causal effect with its 95 % interval (over "
        f"seeds and scenes), the truth as upright bars, effects smaller than {drawn.smallest} in the grey band. "
        "Filled marks: "
        f"verdict “effect”."
    )
    wide, narrow = (
        partial(interventions.draw, cells, results.users, drawn.smallest, c) for c in (len(results.users), 1)
    )
    return picture("interventions", caption, alt, wide, narrow)


def added_items(drawn: Drawn) -> Picture:
    truths = [
        f"{name} {text.splitlines()[0]}" for name, text in zip(("as it is", *SYMBOLS), drawn.added_texts, strict=True)
    ]
    caption = (
        "The intervention itself: one scene, and the same scene with one more item of each symbol, drawn under the "
        "same light. "
        f"Below each: mean validity for the {drawn.added_user} user, in truth and by the paper's model (seed "
        f"{drawn.seed})."
    )
    alt = (
        f"One scene with one more item of each symbol; mean validity for the {drawn.added_user} user: {listed(truths)}."
    )
    wide, narrow = (
        partial(interventions.draw_added, drawn.added_to, drawn.added, drawn.added_texts, columns) for columns in (5, 3)
    )
    return picture("added", caption, alt, wide, narrow)


def power_curves(results: Results, drawn: Drawn) -> Picture:
    t = results.selftest
    parts = [f"{variant_phrase(v)} {percent(t['regimes'][v]['power'][TWICE]['effect'], 0)}" for v in t["measured"]]
    alt = f"Share of families in which an effect of {TWICE} is called one, with chance as in: {listed(parts)}."
    caption = (
        f"What the procedure says of one true effect among {t['cells'] - 1} null cells, {t['families']:,} "
        "simulated families "
        "a point, with chance drawn anew from each variant's own effects (whole lines) or stylised (broken). The "
        "upright line is the "
        f"smallest effect of interest, {drawn.smallest}; the rest of the verdicts is “inconclusive”."
    )
    wide, narrow = (partial(power.draw, results.regimes, t["measured"], drawn.smallest, columns) for columns in (2, 1))
    return picture("power", caption, alt, wide, narrow)
