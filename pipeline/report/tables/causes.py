"""What interventions reveal, and how far the procedure behind the verdicts can be trusted."""

from pipeline.report import paper
from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    listed,
    p_value,
    percent,
    signed,
    variant_label,
)
from pipeline.table.layout import SYMBOLS

TWICE = "0.1"  # the effect whose power is tabulated: twice the smallest of interest


def interventions(results: Results) -> Table:
    """Table 2 of the paper: mean validity without and with one more item of each symbol."""
    cells = results.intervention["interventions"]
    rows: list[list[str | Cell]] = []
    for user in results.users:
        world = results.world["p_valid"][user]
        if world["none"].get("paper") is not None:
            quoted = [Cell(f"{world[s]['paper']:.2f}", (user, s) in paper.BOLD) for s in SYMBOLS]
            rows.append([user.capitalize(), "Paper", f"{world['none']['paper']:.2f}", *quoted])
        truth = cells[results.main][user]
        base = f"{truth[SYMBOLS[0]]['truth_baseline']:.2f}"
        true_cells = [
            Cell(f"{truth[s]['truth_intervened']:.2f}", truth[s]["truth_verdict"] == "effect") for s in SYMBOLS
        ]
        rows.append([user.capitalize(), "Truth", base, *true_cells])
        rows.append([user.capitalize(), "Null: image ignored", *[base] * (1 + len(SYMBOLS))])
        for variant in results.variants:
            ours = cells[variant][user]
            shown = [Cell(f"{ours[s]['intervened']:.2f}", ours[s]["verdict"] == "effect") for s in SYMBOLS]
            rows.append([user.capitalize(), variant_label(variant), f"{ours[SYMBOLS[0]]['baseline']:.2f}", *shown])
    caption = (
        "Mean probability that a random path is valid, as the scene is and with one more item of each symbol placed at "
        f"random: {counted(results.intervention['scenes'], 'scene')} of unseen items, "
        f"{counted(results.intervention['paths'], 'path')} each, {counted(len(results.seeds), 'seed')}. "
        "Bold: verdict “effect” (Holm p < .05 and more than .05 in size; for the truth, its size alone; "
        "for the paper, as it printed it)."
    )
    header = ["User", "Source", "No intervention", *(s.capitalize() for s in SYMBOLS)]
    return table("interventions", caption, header, rows, labels=2)


def verdicts(results: Results) -> Table:
    """How many verdicts of each variant are right, and in which way the others are wrong."""
    cells = results.intervention["interventions"]
    total = len(results.users) * len(SYMBOLS)
    true = sum(c["truth_verdict"] == "effect" for by in cells[results.main].values() for c in by.values())
    far = [abs(c["truth"]) for by in cells[results.main].values() for c in by.values()]
    rows: list[list[str | Cell]] = [
        ["Null: image ignored", str(total - true), "0", str(true), "0", f"{sum(far) / total:.3f}", NONE]
    ]
    for variant in results.variants:
        t = results.intervention["verdicts"][variant]
        far = [abs(c["effect"] - c["truth"]) for by in cells[variant].values() for c in by.values()]
        counts = [str(t[k]) for k in ("right", "false_causes", "missed_causes", "inconclusive")]
        alone = results.selftest["precision"][variant]["seed_by_seed"]
        single = f"{alone['right']} of {alone['of']}"
        rows.append([variant_label(variant), *counts, f"{sum(far) / total:.3f}", single])
    caption = (
        f"Verdicts on the {total} cells, {true} of them true effects, over {counted(len(results.seeds), 'seed')}. "
        "False cause: an effect that is not there, is not larger than .05 or has the other sign. Missed: “no effect” "
        "where there is one. Distance: mean absolute difference between a cell's effect and the true one. Single "
        "seeds: verdicts that are right if each seed is asked alone."
    )
    header = ["Variant", "Right", "False causes", "Missed causes", "Inconclusive", "Distance", "Single seeds"]
    return table("verdicts", caption, header, rows)


def intervention_detail(results: Results) -> Table:
    """Every cell's effect with its interval, p-value and verdict, beside the true effect."""
    rows: list[list[str | Cell]] = []
    found = results.intervention["interventions"]
    still = [u for u in results.users if all(c["effect"] == 0 for by in found.values() for c in by[u].values())]
    for variant in results.variants:
        for user in (u for u in results.users if u not in still):
            for symbol in SYMBOLS:
                c = found[variant][user][symbol]
                rows.append(
                    [
                        variant_label(variant), user.capitalize(), symbol, signed(c["effect"]),
                        f"[{signed(c['ci_low'])}, {signed(c['ci_high'])}]", p_value(c["p_holm"]).removeprefix("p = "),
                        Cell(c["verdict"], c["verdict"] == "effect"), signed(c["truth"]),
                        signed(c["effect"] - c["truth"]), "yes" if c["right"] else "no",
                    ]
                )  # fmt: skip
    caption = (
        "Average causal effect of one more item on mean validity, 95 % interval (over seeds and scenes), "
        f"p after Holm over the {len(results.users) * len(SYMBOLS)} cells of a variant, verdict, and the true effect "
        "on the same scenes and paths. Error: the effect less the true one. Right: the verdict, and the sign of an "
        "effect, are the true ones."
    )
    if still:
        caption += f" Left out: {listed(still)}, where every effect is exactly 0 for every variant."
    header = ["Variant", "User", "Symbol", "Effect", "95 % interval", "p", "Verdict"]
    return table("intervention_detail", caption, [*header, "Truth", "Error", "Right"], rows, labels=3)


def specifications(results: Results) -> Table:
    """do(S := s): what changes if another user's model judges the same scenes and paths."""
    rows: list[list[str | Cell]] = []
    for variant in results.variants:
        by_user = results.intervention["specifications"][variant]
        for user in results.users:
            for other in (u for u in results.users if u != user):
                c = by_user[user][other]
                rows.append(
                    [
                        variant_label(variant), f"{user} → {other}", f"{c['baseline']:.2f}", f"{c['intervened']:.2f}",
                        signed(c["effect"]), f"[{signed(c['ci_low'])}, {signed(c['ci_high'])}]",
                        p_value(c["p_holm"]).removeprefix("p = "), Cell(c["verdict"], c["verdict"] == "effect"),
                        signed(c["truth"]),
                    ]
                )  # fmt: skip
    caption = (
        "Exchanging the user, do(S := s): mean validity under one user's model and under another's, on the same scenes "
        "and paths, with the 95 % interval of the change, p after Holm over a variant's exchanges, and the true change."
    )
    header = ["Variant", "Change", "Before", "After", "Effect", "95 % interval", "p", "Verdict", "Truth"]
    return table("specifications", caption, header, rows, labels=2)


def selftest(results: Results) -> Table:
    """How often the causal procedure errs where nothing has an effect, and what it makes of effects that are there."""
    t = results.selftest
    rows: list[list[str | Cell]] = [
        [
            variant_label(name) if name in t["measured"] else name.capitalize(),
            f"{r['by_seed']:.3f}", f"{r['by_scene']:.3f}", f"{r['rest']:.3f}",
            percent(r["coverage"]), percent(r["family_wise_error"]), percent(r["false_causes"]),
            percent(r["power"][TWICE]["effect"]),
        ]
        for name, r in results.regimes.items()
    ]  # fmt: skip
    caption = (
        f"The procedure on {t['families']:,} simulated families a regime, each of {t['cells']} cells, "
        f"{t['seeds']} seeds "
        f"and {t['scenes']} scenes. With a variant's name: its own effects less their means, seeds and scenes drawn "
        "anew; the others normal, if skewed exponential, or a scene's chance in so few scenes alone. Spread: standard "
        "deviations of seeds, scenes and the rest. Covered: 95 % intervals that hold the truth. Rejected, and named: "
        "null families in which Holm rejects anything, and in which a verdict is “effect”. Found: verdicts “effect” "
        "where it is "
        f"{TWICE}."
    )
    header = ["Chance as in", "Seeds", "Scenes", "Rest", "Covered", "Rejected", "Named", "Found"]
    return table("selftest", caption, header, rows)
