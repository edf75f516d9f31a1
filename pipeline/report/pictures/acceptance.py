"""Picture of paths accepted with a promise."""

from functools import partial

from pipeline.report.figures import acceptance
from pipeline.report.pictures.picture import Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, split_phrase, variant_phrase


def accepted(results: Results) -> Picture:
    """What became of promises, and what they let through."""
    found = results.acceptance
    parts = [
        f"{variant_phrase(variant)} {percent(by_rule['split']['mean'])} of {percent(by_rule['split']['power'])} on "
        f"{split_phrase(split)}"
        for variant, by_split in found["acceptance"].items()
        for split, by_rule in by_split.items()
    ]
    alt = (
        f"Promised {percent(found['level'], 0)} invalid paths at most, in the split form, models accept (share invalid "
        f"among them, of so many of the valid paths): {listed(parts)}."
    )
    caption = (
        "Above: the share of invalid paths among those accepted, against the share promised; above the grey line a "
        "promise is broken; no mark where every model accepts nothing. Below: the share of the valid paths that is "
        f"accepted. Means over {counted(found['seeds'], 'seed')} and the users {listed(results.judged_users)}, with "
        f"95 % intervals of the split form; the upright line is the promise of {percent(found['level'], 0)}."
    )
    splits = list(dict.fromkeys(results.accepted["split"]))
    wide, narrow = (partial(acceptance.draw, results.accepted, splits, found["level"], c) for c in (2, 1))
    return picture("acceptance", caption, alt, wide, narrow)
