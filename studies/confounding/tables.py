"""Right verdicts of every model in every world, and what association says."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

WORLDS = {
    "control": "control (no common cause)",
    "confounded": "plates mostly beside glasses",
    "always": "plates always beside glasses",
}
CHANGED = {("confounded", "clearance"), ("always", "clearance")}  # results after the world was changed for the model


def verdicts(study: Study) -> Table:
    """Return the right verdicts of each model by world, and its effect of an added plate and glass, last user."""
    table = study.table("effects.csv", finite=("effect", "truth"))
    user = list(dict.fromkeys(table["user"]))[-1]
    asked = table.drop_duplicates(["user", "symbol"])
    plate, glass = f"Plate, {user}", f"Glass, {user}"
    truth = asked[asked["user"] == user].set_index("symbol")["truth"]
    rows = [
        {"Model": "Truth", "World": "any", "Right": f"{len(asked)} of {len(asked)}"}
        | {plate: truth["plate"], glass: truth["glass"]},
        {"Model": "Image-blind", "World": "any", plate: 0.0, glass: 0.0}
        | {"Right": f"{(asked['truth_verdict'] == 'negligible').sum()} of {len(asked)}"},
    ]
    for (world, variant), own in table.groupby(["world", "variant"], sort=False):
        effect = own[own["user"] == user].set_index("symbol")["effect"]
        right = f"{own['right'].astype(bool).sum()} of {len(own)}" + (" +" if (world, variant) in CHANGED else "")
        row = {"Model": style.label(str(variant)), "World": WORLDS.get(str(world), str(world)), "Right": right}
        rows.append(row | {plate: effect["plate"], glass: effect["glass"]})
    return Table(pd.DataFrame(rows), {plate: "effect", glass: "effect"})
