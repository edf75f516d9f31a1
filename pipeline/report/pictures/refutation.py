"""Pictures of the attempts to refute."""

from functools import partial

from pipeline.report.figures import refuters
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import listed, refuter_label, variant_phrase


def refuted_effects(results: Results, drawn: Drawn) -> Picture:
    """Every effect that should not be there."""
    found = results.refutation
    parts = []
    for name in results.refuters:
        tallies = found["tallies"][name]
        effects = {v: tallies[v]["effect"] for v in results.variants if v in tallies}
        some = [f"{count} for {variant_phrase(v)}" for v, count in effects.items() if count]
        parts.append(f"{refuter_label(name).lower()}: {listed(some)}")
    alt = f"Effects where there is none. Verdicts “effect” by refuter: {'; '.join(parts)}."
    caption = (
        "Effects under each refuter, with 95 % intervals (over seeds and scenes), a mark for each user and symbol. "
        f"Each should lie in the grey band, which ends at the smallest effect of interest, {drawn.smallest}."
    )
    ordered = {name: found["refuters"][name] for name in results.refuters}
    wide, narrow = (
        partial(refuters.draw, ordered, results.variants, results.judged_users, drawn.smallest, columns)
        for columns in (3, 1)
    )
    return picture("refuted", caption, alt, wide, narrow)


def placebo_patches(drawn: Drawn) -> Picture:
    """What a placebo looks like."""
    caption = (
        "An added item, its placebo (the same pixels, shuffled within the same outline) and a mosaic of its pieces "
        "(single pixels where none fits in). Nothing stands there, so in truth neither changes any path's validity."
    )
    alt = (
        "A scene with a bowl, a plate, cutlery or a glass added, and below each the same patch with its pixels mixed, "
        "and with its pieces mixed."
    )
    return picture("placebos", caption, alt, partial(refuters.draw_placebos, drawn.added, drawn.placebos))
