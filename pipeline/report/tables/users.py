"""What each user asks for, and which user it was."""

from pipeline.report.results import POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, percent, percent_spread, signed, variant_label
from pipeline.table.layout import SYMBOLS


def envelopes(results: Results) -> Table:
    """Every true envelope and every found one: its radius beside the true margin."""
    rows: list[list[str | Cell]] = []
    for variant in results.variants:
        for user in results.users:
            for symbol in SYMBOLS:
                c = results.envelope["envelope"][variant][user][symbol]
                if c["truth_m"] is None and c["radius_m"] is None and c["verdict"] != "inconclusive":
                    continue
                radius = NONE
                if c["radius_m"] is not None:
                    radius = f"{_cm(c['radius_m'])} [{_cm(c['ci_low'])}–{_cm(c['ci_high'])}]"
                covered = NONE if c["covered"] is None else "yes" if c["covered"] else "no"
                rows.append(
                    [
                        variant_label(variant), user.capitalize(), symbol, signed(c["drop_at_contact"], 2),
                        Cell(c["verdict"], c["verdict"] == "effect"), radius, _cm(c["truth_m"]), covered,
                    ]
                )  # fmt: skip
    caption = (
        "Safety envelopes: the clearance [cm] at which half of an item's response is gone, with its 95 % interval over "
        f"{counted(len(results.seeds), 'seed')}, the added items and those that all seeds' training scenes share, "
        "beside the user's true margin. Response: what touching the item takes from P(valid). Rows are left out where "
        "no envelope is true, found or left open."
    )
    header = ["Variant", "User", "Symbol", "Response", "Verdict", "Radius", "Truth", "Covered"]
    return table("envelopes", caption, header, rows, labels=3)


def planning(results: Results) -> Table:
    """What a planner gets who keeps the learned envelopes."""
    found = results.envelope
    users = [u for u in results.users if found["planning_nulls"]["no_envelope"][u]["valid"] < 1]
    plans = {variant_label(v): found["planning"][v] for v in results.variants}
    plans |= {
        "Null: no envelope": found["planning_nulls"]["no_envelope"],
        "True margins": found["planning_nulls"]["true_margins"],
    }
    rows: list[list[str | Cell]] = [
        [name, *(percent(by_user[u][key]) for u in users for key in ("valid", "wasted"))]
        for name, by_user in plans.items()
    ]
    caption = (
        "Planning with the learned envelopes around the true footprints: of random paths that keep them, the share "
        "that is truly valid; and of the truly valid ones, the share that they forbid. "
        f"{counted(found['scenes'], 'scene')} of {counted(found['candidates'], 'path')}, envelopes from "
        f"{counted(len(results.seeds), 'seed')}."
    )
    header = ["Envelopes of", *(f"{u.capitalize()}: {said}" for u in users for said in ("valid", "wasted"))]
    return table("planning", caption, header, rows)


def identification(results: Results) -> Table:
    """Who it was, after a few labelled paths and after many, and the two ways to be wrong about a stranger."""
    found = results.identification
    keys = sorted(found["identification"][results.main], key=lambda key: int(key[1:]))
    few, many = keys[len(keys) // 2], keys[-1]
    rows: list[list[str | Cell]] = []
    for variant in [*results.variants, POSITION]:
        cells, strangers = found["identification"][variant], found["open_set"][variant][many]
        gap, passes = found["largest_gap"][variant]["all"], found["passes_99"][variant]["telling"]
        rows.append(
            [
                variant_label(variant),
                *(percent_spread(cells[k], "mean", "ci_low", "ci_high") for k in (few, many)),
                percent(gap), NONE if passes is None else str(passes),
                percent(strangers["recognised"]), percent(strangers["false_alarms"]),
            ]
        )  # fmt: skip
    ideal, best = found["identification"][results.main], found["open_set"][results.main][many]
    passes = found["passes_99"]["ideal"]["telling"]
    rows.append(
        [
            "Knows the rules", *(percent(ideal[k]["ideal"]) for k in (few, many)), percent(0.0),
            NONE if passes is None else str(passes), percent(best["ideal_recognised"]),
            percent(best["ideal_false_alarms"]),
        ]
    )  # fmt: skip
    caption = (
        f"Which of {counted(len(results.users), 'user')} labelled k paths in a new scene: accuracy with its 95 % "
        "interval over seeds and scenes; the largest gap to an observer who knows the rules, over all k; the k from "
        f"which accuracy passes 99 % in telling scenes ({NONE}: never, or there are none). Last, after "
        f"{many[1:]} paths: strangers called none of these, and known users called so. "
        f"{counted(len(results.seeds), 'seed')}, {counted(found['scenes'], 'scene')}."
    )
    header = ["Variant", f"k = {few[1:]}", f"k = {many[1:]}", "Largest gap", "99 % from k", "Strangers", "False alarms"]
    return table("identification", caption, header, rows)


def _cm(length: float | None) -> str:
    return NONE if length is None else f"{100 * length:.2f}"
