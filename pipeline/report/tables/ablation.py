"""The path model without one ingredient at a time, in numbers."""

from pipeline.report.findings.ablation import WHOLE, asked, ingredient, span
from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, listed, percent, signed, split_phrase


def ablation(results: Results) -> Table:
    """Accuracy, its change and the calibration error of each ablation, by n."""
    a = results.ablation
    ns = asked(results)
    rows: list[list[str | Cell]] = []
    for name in a["order"]:
        cells = a["ablations"][name]
        row: list[str | Cell] = [ingredient(name)]
        for n in ns:
            change = NONE if name == WHOLE else f"{signed(100 * cells[n]['change'], 1)} {span(cells[n])}"
            row += [percent(cells[n]["accuracy"]), change, f"{cells[n]['ece']:.3f}"]
        rows.append(row)
    caption = (
        f"The path model without one ingredient at a time: {counted(a['seeds'], 'validation seed')}, "
        f"{listed(a['users'])} users, {listed([split_phrase(p) for p in a['pools']])}. Accuracy, its change in "
        "percentage points [lowest, highest of the seeds] and the expected calibration error (ECE)."
    )
    header = ["Missing", *(f"{what}, n\u00a0=\u00a0{n[1:]}" for n in ns for what in ("Accuracy", "Change", "ECE"))]
    return table("ablation", caption, header, rows)
