"""Association against intervention, in numbers."""

from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, listed, percent, signed, variant_label
from pipeline.table.layout import SYMBOLS


def association(results: Results) -> Table:
    """What association and intervention say of each symbol, by user."""
    found = results.confounding
    fitted = [v for v in results.variants if v in found["interventions"]]
    rows: list[list[str | Cell]] = []
    for user in found["association"]["confounded"]:
        for symbol in SYMBOLS:
            cells = [found["interventions"][v][user][symbol] for v in fitted]
            said = [signed(found["association"][world][user][symbol]["difference"]) for world in _WORLDS]
            effects = [Cell(signed(c["effect"]), c["verdict"] == "effect") for c in cells]
            rows.append([user.capitalize(), symbol, *said, *effects, signed(cells[0]["truth"])])
    caption = (
        f"Association: P(invalid | near the symbol, within {100 * found['near_m']:g} cm) − P(invalid | not near), in "
        "ordinary training scenes and in confounded ones. Effect: change of mean validity by one more item, by models "
        "fitted to the confounded world and asked in ordinary scenes (bold: verdict “effect”), and in truth. "
        f"{counted(found['seeds'], 'seed')}."
    )
    header = ["User", "Symbol", *(f"Association, {w}" for w in _WORLDS), *(variant_label(v) for v in fitted), "Truth"]
    return table("association", caption, header, rows, labels=2)


def worlds(results: Results) -> Table:
    """Every strength of the common cause: accuracy where it acts and where it does not, and the verdicts."""
    found = results.confounding
    rows: list[list[str | Cell]] = []
    for name, world in found["worlds"].items():
        for variant in (v for v in results.variants if v in world["verdicts"]):
            scores, tally = world["accuracy"][variant], world["verdicts"][variant]
            for user in scores:
                shares = [percent(scores[user][pool]["mean"]) if pool in scores[user] else NONE for pool in _POOLS]
                rows.append(
                    [
                        name.capitalize(), variant_label(variant), user.capitalize(), *shares,
                        f"{tally['right']} of {tally['cells']}",
                    ]
                )  # fmt: skip
    worlds = [
        f"{name} {world['together']:g}, {100 * world['gap_m'][0]:g}–{100 * world['gap_m'][1]:g}"
        for name, world in found["worlds"].items()
    ]
    caption = (
        "Models by the world they were fitted in: accuracy in new scenes of the confounded world, of its control and "
        f"of the ordinary one, and verdicts that are right (of both users, so in each of their rows). Chance that "
        f"one cause lays a plate and a glass beside it, and their gap [cm]: {listed(worlds)}. "
        f"{counted(found['seeds'], 'seed')}."
    )
    header = ["World", "Model", "User", *(f"In {pool} scenes" for pool in _POOLS), "Verdicts right"]
    return table("worlds", caption, header, rows, labels=3)


_WORLDS = ("ordinary", "confounded")
_POOLS = ("confounded", "control", "ordinary")
