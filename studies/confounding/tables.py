"""Right verdicts of every model in every world, and what association says."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

WORLDS = {
    "control": "control (no common cause)",
    "confounded": "plates mostly beside glasses",
}
ITEMS = ["plate", "glass"]  # the two that a common cause puts side by side
COLUMNS = ["effect", "ci_low", "ci_high"]
CHANGED = {("confounded", "clearance")}  # results after the world was changed for the model


def verdicts(study: Study) -> Table:
    """Return the right verdicts of each model by world, and its effect of an added plate and glass, last user.

    Ends of 95 % intervals are None for the truth and for an image-blind model, which have no spread.
    """
    table = study.table("effects.csv", finite=("effect", "ci_low", "ci_high", "truth"))
    user = list(dict.fromkeys(table["user"]))[-1]
    asked = table.drop_duplicates(["user", "symbol"])
    truth = asked[asked["user"] == user].set_index("symbol")["truth"]
    blind = f"{(asked['truth_verdict'] == 'negligible').sum()} of {len(asked)}"
    ends = dict.fromkeys(f"{symbol} {end}" for symbol in ITEMS for end in ("low", "high"))
    rows = [
        {"Model": "Truth", "World": "any", "Right": f"{len(asked)} of {len(asked)}"} | ends | dict(truth[ITEMS]),
        {"Model": "Image-blind", "World": "any", "Right": blind} | ends | dict.fromkeys(ITEMS, 0.0),
    ]
    for (world, variant), own in table.groupby(["world", "variant"], sort=False):
        right = f"{own['right'].astype(bool).sum()} of {len(own)}" + (" +" if (world, variant) in CHANGED else "")
        row = {"Model": style.label(str(variant)), "World": WORLDS.get(str(world), str(world)), "Right": right}
        effects = own[own["user"] == user].set_index("symbol")
        for symbol in ITEMS:
            row |= dict(zip((symbol, f"{symbol} low", f"{symbol} high"), effects.loc[symbol, COLUMNS], strict=True))
        rows.append(row)
    numbers = [f"{symbol}{end}" for symbol in ITEMS for end in ("", " low", " high")]
    frame = pd.DataFrame(rows, dtype=object)[["Model", "World", "Right", *numbers]]
    return Table(frame, dict.fromkeys(numbers, "effect"))
