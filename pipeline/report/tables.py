"""The report's tables: the paper's two, with its numbers, the nulls and the truth beside ours, and the rest."""

from pipeline.report import paper
from pipeline.report.results import NULLS, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    listed,
    method_label,
    p_value,
    percent,
    percent_spread,
    signed,
    split_label,
    variant_label,
)
from pipeline.table.layout import SYMBOLS

TWICE = "0.1"  # the effect whose power is tabulated: twice the smallest of interest


def all_tables(results: Results) -> list[Table]:
    """Every table, in the order of the report."""
    return [
        models(results), world(results),
        accuracy(results), comparisons(results), by_user(results), calibration(results),
        backprop(results), repair_detail(results), searches(results),
        interventions(results), verdicts(results), intervention_detail(results), specifications(results),
        selftest(results),
    ]  # fmt: skip


def models(results: Results) -> Table:
    """Every model at a glance: what it knows of new scenes, what its repairs and its verdicts are worth."""
    scores, anchor = results.evaluation["accuracy"], results.repair[results.main]
    few, many = f"n{min(results.ns)}", f"n{results.study_n}"
    repaired = [u for u in results.users if anchor[u]["success"] is not None]
    rows: list[list[str | Cell]] = []
    for v in results.variants:
        known, tally = scores[v]["new_items"], results.intervention["verdicts"][v]
        repairs = [results.search[v][u]["probe"] for u in repaired]
        rows.append(
            [
                variant_label(v), percent(known[few]["mean"]), percent(known[many]["mean"]),
                *(f"{percent(c['success'])} ({c['displacement_ratio']:.1f})" for c in repairs),
                f"{tally['right']} of {tally['cells']}",
            ]
        )  # fmt: skip
    known, nothing = scores["null_position"]["new_items"], [NONE for _ in repaired]
    rows.append(
        [variant_label("null_position"), percent(known[few]["mean"]), percent(known[many]["mean"]), *nothing, NONE]
    )
    detours = [anchor[u] for u in repaired]
    moved = [f"{percent(c['null_constant'])} ({c['null_constant_displacement_ratio']:.1f})" for c in detours]
    rows.append([variant_label("null_constant"), NONE, NONE, *moved, NONE])
    caption = (
        "Every model in new scenes with unseen items: accuracy (mean of the users "
        f"{listed(results.judged_users)}), success of repairs by a search that stays near the start (in brackets how "
        "far they move, over the least that would do) and causal verdicts that are right; means over "
        f"{counted(len(results.seeds), 'seed')}, "
        f"n = {results.study_n} unless said. The last rows never look at the image."
    )
    header = ["Model", f"Accuracy, n = {few[1:]}", f"Accuracy, n = {many[1:]}"]
    header += [f"Repaired, {u}" for u in repaired] + ["Verdicts right"]
    return table("models", caption, header, rows)


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
        "end invalid. Ratio: mean displacement of the control point over that of the nearest valid path; "
        f"1 is ideal. Means over {counted(len(results.seeds), 'seed')}."
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
                        percent(c["success"]), percent(c["fooled"]), percent(c["abstained"]),
                        f"{c['displacement_ratio']:.2f}",
                    ]
                )  # fmt: skip
    caption = (
        "Repairs that stay near their start: each search asks the model equally often and weighs P(valid) against "
        "displacement. Fooled, abstained and ratio as above; the last row of a user was told the footprints and the "
        f"user's margins, which leaves what the search itself costs. Means over {counted(len(results.seeds), 'seed')}."
    )
    header = ["User", "Model", "Search", "Starts", "Success", "Fooled", "Abstained", "Ratio"]
    return table("searches", caption, header, rows, labels=3)


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
        ["Null: image ignored", str(total - true), "0", str(true), "0", f"{sum(far) / total:.3f}"]
    ]
    for variant in results.variants:
        t = results.intervention["verdicts"][variant]
        far = [abs(c["effect"] - c["truth"]) for by in cells[variant].values() for c in by.values()]
        counts = [str(t[k]) for k in ("right", "false_causes", "missed_causes", "inconclusive")]
        rows.append([variant_label(variant), *counts, f"{sum(far) / total:.3f}"])
    caption = (
        f"Verdicts on the {total} cells, {true} of them true effects, over {counted(len(results.seeds), 'seed')}. "
        f"False cause: an "
        "effect that is not there or has the other sign. Missed: “no effect” where there is one. Distance: mean "
        "absolute "
        "difference between a cell's effect and the true one."
    )
    header = ["Variant", "Right", "False causes", "Missed causes", "Inconclusive", "Distance"]
    return table("verdicts", caption, header, rows)


def intervention_detail(results: Results) -> Table:
    """Every cell's effect with its interval, p-value and verdict, beside the true effect."""
    rows: list[list[str | Cell]] = []
    for variant in results.variants:
        for user in results.users:
            for symbol in SYMBOLS:
                c = results.intervention["interventions"][variant][user][symbol]
                rows.append(
                    [
                        variant_label(variant), user.capitalize(), symbol, signed(c["effect"]),
                        f"[{signed(c['ci_low'])}, {signed(c['ci_high'])}]", p_value(c["p_holm"]).removeprefix("p = "),
                        Cell(c["verdict"], c["verdict"] == "effect"), signed(c["truth"]),
                        Cell(c["truth_verdict"], c["truth_verdict"] == "effect"), "yes" if c["right"] else "no",
                    ]
                )  # fmt: skip
    caption = (
        "Average causal effect of one more item on mean validity, 95 % interval (over seeds and scenes), "
        f"p after Holm over the {len(results.users) * len(SYMBOLS)} cells of a variant, verdict, and the true effect "
        "on the same scenes and paths. Right: the verdict, and the sign of an effect, are the true ones."
    )
    header = ["Variant", "User", "Symbol", "Effect", "95 % interval", "p", "Verdict"]
    return table("intervention_detail", caption, [*header, "Truth", "True verdict", "Right"], rows, labels=3)


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
                        Cell(c["verdict"], c["verdict"] == "effect"), signed(c["truth"]),
                    ]
                )  # fmt: skip
    caption = (
        "Exchanging the user, do(S := s): mean validity under one user's model and under another's, on the same scenes "
        "and paths, with the 95 % interval of the change and the true change."
    )
    header = ["Variant", "Change", "Before", "After", "Effect", "95 % interval", "Verdict", "Truth"]
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
        f"and {t['scenes']} scenes. Spread: standard deviations of seeds, scenes and the rest; the first "
        "regimes are those "
        "of the variants' own effects. Covered: 95 % intervals that hold the truth. Rejected, and named: null "
        "families in "
        "which Holm rejects anything, and in which a verdict is “effect”. Found: verdicts “effect” where it is "
        f"{TWICE}."
    )
    header = ["Chance as in", "Seeds", "Scenes", "Rest", "Covered", "Rejected", "Named", "Found"]
    return table("selftest", caption, header, rows)


def accuracy(results: Results) -> Table:
    """Accuracy against n per variant and split, the paper's two numbers first."""
    summary = results.evaluation["accuracy"]
    quoted = [percent_spread(paper.ACCURACY[n]._asdict()) if n in paper.ACCURACY else NONE for n in results.ns]
    rows: list[list[str | Cell]] = [["Paper", "“unseen trajectories”", *quoted]]
    for variant in [*results.variants, *NULLS]:
        for split in (s for s in results.splits if s in summary[variant]):
            shown = [percent_spread(summary[variant][split][f"n{n}"]) for n in results.ns]
            rows.append([variant_label(variant), split_label(split), *shown])
    caption = (
        f"Accuracy by demonstrations per scene (n), users {listed(results.judged_users)}: mean [quartiles] over "
        f"{counted(len(results.seeds), 'seed')}. The nulls never look at the image."
    )
    return table("accuracy", caption, ["Variant", "Judged on", *(f"n = {n}" for n in results.ns)], rows, labels=2)


def by_user(results: Results) -> Table:
    """Accuracy and AUROC at study_n per user, so that no user hides behind the mean."""
    rows: list[list[str | Cell]] = []
    frame = results.accuracy[results.accuracy["n"] == results.study_n]
    for user in results.users:
        for variant in [*results.variants, *NULLS]:
            part = frame[(frame["variant"] == variant) & (frame["user"] == user)]
            means = part.groupby("split")[["accuracy", "auroc"]].mean()
            cells = []
            for split in results.splits:
                there = split in means.index
                cells.append(percent(means["accuracy"].get(split)) if there else NONE)
                area = means["auroc"].get(split) if there else None
                cells.append(NONE if area is None or area != area else f"{area:.3f}")
            rows.append([user.capitalize(), variant_label(variant), *cells])
    caption = (
        f"Accuracy and area under the ROC curve (AUROC) by user at n = {results.study_n}, means over "
        f"{counted(len(results.seeds), 'seed')}. {NONE}: not defined (one class only, or no demonstrations there)."
    )
    header = [h for s in results.splits for h in (split_label(s), "AUROC")]
    return table("accuracy_by_user", caption, ["User", "Variant", *header], rows, labels=2)


def comparisons(results: Results) -> Table:
    """The tests between variants that were fixed in advance."""
    sizes = results.comparisons.groupby("family", sort=False).size()
    families = [f"{family}: {counted(int(size), 'test')}" for family, size in sizes.items()]
    rows: list[list[str | Cell]] = [
        [
            f"{variant_label(r.variant).removesuffix(' (paper)')} vs {variant_label(r.against)}",
            split_label(r.split), str(r.n),
            percent(r.mean), percent(r.mean_against), signed(100 * r.difference, 1),
            p_value(r.p_holm).removeprefix("p = "),
            Cell("effect", True) if r.significant else "not told apart",
        ]
        for r in results.comparisons.itertuples(index=False)
    ]  # fmt: skip
    caption = (
        f"Variant against variant: exact paired Wilcoxon test over {counted(len(results.seeds), 'seed')}, p after "
        f"Holm within each family of tests ({listed(families)}), each fixed before the results of the variant it is "
        "about were seen. Difference in percentage points."
    )
    header = ["Compared", "Judged on", "n", "Mean", "Against", "Difference", "p", "Verdict"]
    return table("comparisons", caption, header, rows, labels=2)


def calibration(results: Results) -> Table:
    """Expected calibration error and Brier score at study_n."""
    rows: list[list[str | Cell]] = []
    for variant in [*results.variants, *NULLS]:
        by_split = results.evaluation["calibration"][variant]
        cells = [by_split.get(s) for s in results.splits]
        shown = [f"{c[k]:.3f}" if c else NONE for c in cells for k in ("ece", "brier")]
        rows.append([variant_label(variant), *shown])
    caption = (
        f"Calibration at n = {results.study_n}, seeds and users {listed(results.judged_users)} pooled: expected "
        "calibration error (ECE) and Brier score; 0 is ideal for both."
    )
    header = ["Variant", *(h for s in results.splits for h in (f"{split_label(s)}: ECE", "Brier"))]
    return table("calibration", caption, header, rows)


def world(results: Results) -> Table:
    """The simulated world's true P(valid) beside the paper's Table 2, to which it was calibrated."""
    rows: list[list[str | Cell]] = []
    for user in results.users:
        row: list[str | Cell] = [user.capitalize()]
        for symbol in ("none", *SYMBOLS):
            c = results.world["p_valid"][user][symbol]
            row.append(f"{c['truth']:.3f} ({NONE if c.get('paper') is None else format(c['paper'], '.2f')})")
        rows.append(row)
    caption = (
        "The simulated world: true share of random paths that are valid, the paper's Table 2 in brackets; "
        f"{counted(results.world['layouts'], 'scene')} of {counted(results.world['paths'], 'path')} each."
    )
    return table("world", caption, ["User", "No intervention", *(s.capitalize() for s in SYMBOLS)], rows)
