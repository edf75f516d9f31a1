"""What each disturbance costs each variant, in numbers."""

from pipeline.report.results import POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    disturbance_label,
    listed,
    percent,
    percent_spread,
    percent_within,
    signed,
    strength_label,
    variant_label,
    variant_phrase,
)


def robustness(results: Results) -> Table:
    """Accuracy as it is, and its change at every strength of every disturbance."""
    found, variants = results.robustness, [*results.variants, POSITION]
    as_is = found["undisturbed"]["models"]
    first = [disturbance_label("as_is"), NONE, *(percent_spread(as_is[v]["accuracy"]) for v in variants)]
    rows: list[list[str | Cell]] = [list(first)]
    for name in found["order"]:
        for level in found["disturbed"][name]:
            changes = [_change(level["models"].get(v)) for v in variants]
            rows.append([disturbance_label(name), strength_label(name, level["strength"]), *changes])
    caption = (
        f"Accuracy as it is (mean and quartiles over {counted(found['seeds'], 'seed')}, {listed(found['users'])} "
        f"users, the first {counted(found['scenes'], 'scene')} with unseen items), and what each disturbance adds to "
        "it, in percentage points (95 % intervals over seeds and scenes)."
    )
    return table("robustness", caption, ["Disturbance", "Level", *map(variant_label, variants)], rows, labels=2)


def accepted(results: Results) -> Table:
    """How many invalid paths are accepted, as it is and at every strength of every disturbance."""
    found, variants = results.robustness, [*results.variants, POSITION]

    def shares(models: dict) -> list[str]:
        return [_share(models[v]) if v in models else NONE for v in variants]

    rows: list[list[str | Cell]] = [[disturbance_label("as_is"), NONE, *shares(found["undisturbed"]["models"])]]
    for name in found["order"]:
        for level in found["disturbed"][name]:
            rows.append([disturbance_label(name), strength_label(name, level["strength"]), *shares(level["models"])])
    caption = (
        "Of the invalid paths, those accepted (P > 0.5): means over "
        f"{counted(found['seeds'], 'seed')}, {listed(found['users'])} users and the same scenes [95 % intervals over "
        "seeds and scenes]."
    )
    header = ["Disturbance", "Level", *map(variant_label, variants)]
    return table("robustness_accepted", caption, header, rows, labels=2)


def strange(results: Results) -> Table:
    """How often a picture is called unlike the training pictures, and what abstaining there would leave."""
    found, best = results.robustness, most_accurate(results)
    levels = [("as_is", None, found["undisturbed"])]
    levels += [(name, level["strength"], level) for name in found["order"] for level in found["disturbed"][name]]
    rows: list[list[str | Cell]] = []
    for name, strength, level in levels:
        if "strange" not in level:
            continue
        called, cell, kept = level["strange"], level["models"][best], level["kept"][best]
        accepted = None if cell["false_rejects"] is None else 1 - cell["false_rejects"]
        rows.append(
            [
                disturbance_label(name), NONE if strength is None else strength_label(name, strength),
                percent_within(called["mean"], (called["ci_low"], called["ci_high"])),
                percent(cell["false_accepts"]), percent(kept["false_accepts"]), percent(accepted),
                percent(kept["accepted"]),
            ]
        )  # fmt: skip
    caption = (
        "Pictures called strange, told from a model's own training pictures without a label, so that of pictures like "
        f"those at most 1 in {found['per_seed'] + 1} is; and what {variant_phrase(best)} would accept of the invalid "
        "and of the valid paths if it abstained there (of all of them, those abstained from among them). Means over "
        f"{counted(found['seeds'], 'seed')} [95 % intervals over seeds and scenes]."
    )
    header = [
        "Disturbance",
        "Level",
        "Called strange",
        "Invalid accepted",
        "abstaining",
        "Valid accepted",
        "abstaining",
    ]
    return table("robustness_strange", caption, header, rows, labels=2)


def most_accurate(results: Results) -> str:
    """The variant that judges most paths rightly in the pictures as they are."""
    models = results.robustness["undisturbed"]["models"]
    return max(results.variants, key=lambda v: models[v]["accuracy"]["mean"])


def _share(cell: dict) -> str:
    if cell["false_accepts_ci"] is None:
        return NONE
    low, high = cell["false_accepts_ci"]
    return f"{percent(cell['false_accepts'])} [{100 * low:.1f}–{100 * high:.1f}]"


def _change(cell: dict | None) -> str:
    if cell is None:
        return NONE
    low, high = (signed(100 * cell[name], 1) for name in ("ci_low", "ci_high"))
    return f"{signed(100 * cell['difference'], 1)} [{low}, {high}]"
