"""The path model without one ingredient at a time, in numbers."""

from pipeline.report.findings.ablation import WHOLE, ingredient
from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, listed, percent, signed, split_label


def ablation(results: Results) -> Table:
    """Accuracy, its change and the calibration error of each ablation, by n."""
    a = results.ablation
    ns = list(a["ablations"][WHOLE])
    rows: list[list[str | Cell]] = []
    for name in a["order"]:
        cells = a["ablations"][name]
        row: list[str | Cell] = [ingredient(name)]
        for n in ns:
            cell = cells[n]
            low, high = (signed(100 * cell[x], 1) for x in ("change_low", "change_high"))
            change = NONE if name == WHOLE else f"{signed(100 * cell['change'], 1)} [{low}, {high}]"
            row += [percent(cell["accuracy"]), change, f"{cell['ece']:.3f}"]
        rows.append(row)
    caption = (
        f"The path model without one ingredient at a time: {counted(a['seeds'], 'validation seed')}, "
        f"{listed(a['users'])} users, scenes and items of validation ({listed([split_label(p) for p in a['pools']])}). "
        "Accuracy, its change in percentage points [lowest, highest of the seeds] and the expected calibration error."
    )
    header = ["Missing", *(h for n in ns for h in (f"n = {n[1:]}", "Change", "Calibration error"))]
    return table("ablation", caption, header, rows)
