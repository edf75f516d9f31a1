"""What became of bad paths."""

from pipeline.report import paper
from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    listed,
    method_label,
    percent,
    percent_spread,
    percent_within,
    variant_label,
    variant_phrase,
)


def backprop(results: Results) -> Table:
    """Table 1 of the paper: the success rate of perturbing an invalid trajectory into a valid one."""
    users = results.users
    anchor = results.repair[results.main]
    rows: list[list[str | Cell]] = [["Paper", *(percent(paper.REPAIR.get(u), 0) for u in users)]]
    for variant in results.variants:
        cells = [results.repair[variant][u] for u in users]
        rows.append(
            [variant_label(variant), *(percent_spread(c, "success", "success_q1", "success_q3") for c in cells)]
        )
    for reference in ("null_constant", "null_random", "oracle"):
        rows.append([variant_label(reference), *(percent(anchor[u][reference]) for u in users)])
    rows.append(["Invalid starts", *(str(anchor[u]["starts"]) for u in users)])
    vacuous = [u for u in users if anchor[u]["success"] is None]
    caption = (
        "Success of repairing an invalid path, judged by the world's true rules, in new scenes with unseen items: "
        f"mean [quartiles] over {counted(len(results.seeds), 'seed')} at n = {results.study_n}."
    )
    if vacuous:
        caption += f" {listed(vacuous).capitalize()}: no path is invalid, so there is nothing to repair ({NONE})."
    return table("backprop", caption, ["Method", *(u.capitalize() for u in users)], rows)


def repair_detail(results: Results) -> Table:
    """What success hides: how far a repair moves, and how often the model is wrong about it."""
    rows: list[list[str | Cell]] = []
    for user in results.users:
        for variant in results.variants:
            c = results.repair[variant][user]
            if c["success"] is None:
                continue
            rows.append(
                [
                    user.capitalize(), variant_label(variant), percent(c["success"]), percent(c["fooled"]),
                    percent(c["abstained"]), f"{c['displacement_m']:.3f}", f"{c['displacement_ratio']:.2f}",
                ]
            )  # fmt: skip
        c = results.repair[results.main][user]
        for reference in ("null_constant", "null_random", "oracle"):
            ratio = c.get(f"{reference}_displacement_ratio")
            if c[reference] is not None:
                shown = NONE if ratio is None else f"{ratio:.2f}"
                rows.append(
                    [user.capitalize(), variant_label(reference), percent(c[reference]), NONE, NONE, NONE, shown]
                )
    caption = (
        "Repairs in detail. Fooled: the model calls the end valid and it is not. Abstained: the model itself calls the "
        "end invalid. Ratio: mean displacement of the control point over that of the nearest valid path, failures "
        f"included: to be read beside success. Means over {counted(len(results.seeds), 'seed')}."
    )
    header = ["User", "Method", "Success", "Fooled", "Abstained", "Moved [m]", "Ratio"]
    return table("repair_detail", caption, header, rows, labels=2)


def searches(results: Results) -> Table:
    """Repairs that stay near: every model by the same search, the rivals of that search, and the truth told."""
    rows: list[list[str | Cell]] = []
    for user in results.users:
        for model in [*results.variants, "truth"]:
            for method, c in results.search.get(model, {}).get(user, {}).items():
                rows.append(
                    [
                        user.capitalize(), variant_label(model), method_label(method), f"{c['starts']:,}",
                        percent_within(c["success"], c["success_ci"]), percent_within(c["fooled"], c["fooled_ci"]),
                        percent(c["abstained"]), _ratio(c),
                    ]
                )  # fmt: skip
    caption = (
        "Repairs that stay near their start: each search asks the model equally often and weighs P(valid) against "
        "displacement. Fooled, abstained and ratio as above, and, in brackets, the ratio of the ends that are valid; "
        "the last row of a user was told the footprints and the user's margins, which leaves what the search itself "
        f"costs. Means over {counted(len(results.seeds), 'seed')} [95 % intervals over seeds and scenes]."
    )
    header = ["User", "Model", "Search", "Starts", "Success", "Fooled", "Abstained", "Ratio"]
    return table("searches", caption, header, rows, labels=3)


def thresholds(results: Results) -> Table:
    """What would become of the best searches' ends if a robot accepted only what the model is surer of."""
    best, rows = repairer(results), []
    for user in results.users:
        for level in results.search.get(best, {}).get(user, {}).get("bayesian", {}).get("by_threshold", []):
            shares = (percent(level[name]) for name in ("accepted", "fooled", "invalid"))
            rows.append([user.capitalize(), f"{level['above']:g}", *shares])
    caption = (
        f"Ends of the search with {variant_phrase(best)} that a robot would accept if P(valid) had to exceed a "
        "threshold; "
        "the others it would not drive. Fooled: accepted, and invalid. All thresholds asked about are here; none was "
        f"chosen, and the rest of the report takes 0.5. Means over {counted(len(results.seeds), 'seed')}."
    )
    header = ["User", "P(valid) above", "Accepted", "Fooled", "Invalid among accepted"]
    return table("search_thresholds", caption, header, rows, labels=2)


def repairer(results: Results) -> str:
    """The variant whose searches end most often in a valid path, mean over users."""

    def success(variant: str) -> float:
        return sum(by_method["bayesian"]["success"] for by_method in results.search.get(variant, {}).values())

    return max(results.variants, key=success)


def _ratio(cell: dict) -> str:
    valid = cell["displacement_ratio_valid"]
    return f"{cell['displacement_ratio']:.2f} ({NONE if valid is None else f'{valid:.2f}'})"
