"""Results of repairs by method, variant and user."""

from pipeline.report.page import Table, with_gaps
from pipeline.report.results import Results
from pipeline.report.style import label

BASELINES = ("random_path", "constant_detour", "oracle")
COLUMNS = {
    "success": ("success", "pct1"), "success, q1": ("success_q1", "pct1"), "success, q3": ("success_q3", "pct1"),
    "moved": ("displacement_ratio", "times"), "unsafe": ("unsafe", "pct1"),
}  # fmt: skip


def gradient(results: Results) -> Table:
    """Return the results of the paper's gradient repair by model and user, with baselines last."""
    return _table(results, "gradient")


def nearest(results: Results) -> Table:
    """Return the results of searching the nearest accepted path, by model and user, with baselines last."""
    return _table(results, "nearest")


def _table(results: Results, method: str) -> Table:
    """Return one row per model; baselines accept nothing, so they have no unsafe share."""
    fitted = set(results.tables["repair"].query("method == @method")["variant"])
    keys = [(method, variant) for variant in results.variants if variant in fitted]
    rows, formats = [], {}
    for method, variant in [*keys, *((baseline, "") for baseline in BASELINES)]:
        row: dict[str, str | float | None] = {"Model": label(variant or method)}
        for user in results.repaired_users:
            for name, (column, form) in COLUMNS.items():
                exists = variant or column != "unsafe"
                row[f"{user}, {name}"] = results.repair(method, variant, user, column) if exists else None
                formats[f"{user}, {name}"] = form
        rows.append(row)
    return Table(with_gaps(rows), formats)
