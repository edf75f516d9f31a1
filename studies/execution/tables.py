"""Tables of what each arm executes, and of which items it pushes."""

import pandas as pd

from pipeline.report import style
from pipeline.report.study import Study
from pipeline.report.tables import Table, with_gaps

ARMS = {"pr2": "PR2"}
METHODS = {
    "gradient": "repairs, gradient",
    "nearest": "repairs, search",
    "oracle": "nearest valid (truth)",
    "unrepaired": "unrepaired",
    "straight": "straight path",
    "demonstrations": "demonstrations",
}
FAILURES = ("out of reach", "joint limit", "collision", "off the table", "joint speed", "tracking")


def executed(study: Study) -> Table:
    """Return, for each arm and kind of path, what was executed and why not, errors, time and clearance."""
    summary = study.table("summary.csv").query("variant == 'all'")
    rows = []
    for (arm, method), part in summary.groupby(["arm", "method"], sort=False):
        if method not in METHODS:
            continue
        row = part.iloc[0]
        failed = {name: row[name] for name in FAILURES if row[name] > 0}
        worst = max(failed, key=lambda name: failed[name]) if failed else "–"
        rows.append(
            {
                "Path": f"{ARMS.get(str(arm), arm)}: {METHODS[str(method)]}",
                "Paths": row["accepted"],
                "Executed": row["executed"],
                "Main failure": worst,
                "Mean error [mm]": row["error_mean_mm"],
                "Time [s]": row["duration_s"],
                "Clearance [mm]": row["clearance_mm"],
                "Touching": row["touching"],
            }
        )
    formats = {"Paths": "count", "Executed": "pct1", "Mean error [mm]": "rate"}
    formats |= {"Time [s]": "times", "Clearance [mm]": "count", "Touching": "pct1"}
    return Table(with_gaps(rows), formats)


def touched(study: Study) -> Table:
    """Return, for each user and repair, the simulated executions with items touched or fallen."""
    rows = []
    for row in study.table("touched.csv").to_dict("records"):
        name = METHODS[row["method"]] + (f", {style.label(row['variant']).lower()}" if row["variant"] else "")
        shown = {"User": row["user"], "Path": name, "Valid": row["valid"]}
        shown |= {"Touched": row["touched_share"], "Fallen": row["fallen_share"]}
        rows.append(shown | {"Touched on valid paths": row["touched_valid"]})
    formats = dict.fromkeys(("Valid", "Touched", "Fallen"), "pct1")
    frame = pd.DataFrame(rows).sort_values("User", kind="stable", ignore_index=True)
    return Table(frame, formats | {"Touched on valid paths": "count"})
