"""Pictures of repairs."""

from functools import partial

from pipeline.report.figures import (
    repairs,
)
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.tables.repair import repairer
from pipeline.report.wording import counted, listed, variant_label, variant_phrase


def repairs_of(results: Results, drawn: Drawn, variant: str) -> Picture:
    ends = {u: [r.valid for r in found] for u, found in drawn.repairs[variant].items()}
    parts = [f"{sum(v)} of {len(v)} for {u}" for u, v in ends.items()]
    alt = f"Repairs by {variant_phrase(variant)}; end valid in truth: {listed(parts)}."
    steps = max(len(r.z) - 1 for found in drawn.repairs[variant].values() for r in found)
    caption = (
        f"{variant_label(variant)}: {counted(steps, 'gradient step')} from the same invalid start for each user, dark "
        f"to light; "
        "white outlines are the items' true footprints, below each picture is what came of it. The first scenes whose "
        "start is "
        f"invalid to every user that has invalid paths, seed {drawn.seed}; not chosen by their outcome."
    )
    draw = partial(repairs.draw, drawn.pool, drawn.layouts, drawn.repairs[variant])
    return picture(f"repair-{variant}", caption, alt, draw)


def failures_of(results: Results, drawn: Drawn) -> Picture:
    """The worst of what the best searches get wrong."""
    best = repairer(results)
    said = [f"{r.said} ({user}, scene {r.scene})" for user, found in drawn.failures.items() for r in found]
    alt = f"Searches with {variant_phrase(best)} that end in an invalid path which it calls valid: {listed(said)}."
    caption = (
        f"The worst of what the search with {variant_phrase(best)} gets wrong, one a scene, over all seeds, the worst "
        "first: from the invalid start (dark) to an end (light) that it calls valid and that comes closer than the "
        "user's margin to an item, by the millimetres below. White outlines are the items' true footprints."
    )
    return picture("repair-failures", caption, alt, partial(repairs.draw, drawn.pool, drawn.layouts, drawn.failures))
