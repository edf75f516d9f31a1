"""Picture of paths accepted with a promise."""

from functools import partial

from pipeline.report.figures import acceptance
from pipeline.report.pictures.picture import Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, split_label, split_phrase, variant_phrase


def accepted(results: Results) -> Picture:
    """What became of promises, and what they let through."""
    found = results.acceptance
    parts = [
        f"{variant_phrase(variant)} {percent(by_rule['split']['mean'])} of {percent(by_rule['split']['power'])} on "
        f"{split_phrase(split)}"
        for variant, split, by_rule in results.promises
    ]
    alt = (
        f"Promised {percent(found['level'], 0)} invalid paths at most, in the split form, models accept (share invalid "
        f"among them, of so many of the valid paths): {listed(parts)}."
    )
    caption = (
        "Above: the share of invalid paths among those accepted in new scenes, against the share promised; above the "
        "grey line a promise is broken; no mark where every model accepts nothing. Below: the share of the valid paths "
        "that is accepted. The split form levels off where nothing is left but what the model itself finds invalid, "
        "which is level in the last place. "
        f"Means over {counted(found['seeds'], 'seed')} and the users {listed(results.judged_users)}, "
        f"with 95 % intervals of the split form; the upright line is the promise of {percent(found['level'], 0)}."
    )
    titles = {split: split_label(split).split(", ")[-1].capitalize() for split in results.accepted["split"].unique()}
    return picture("acceptance", caption, alt, partial(acceptance.draw, results.accepted, titles, found["level"]))
