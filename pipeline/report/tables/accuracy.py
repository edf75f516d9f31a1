"""What the models know of paths they have not seen."""

from pipeline.report import paper
from pipeline.report.results import NULLS, POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    listed,
    p_value,
    percent,
    percent_spread,
    signed,
    split_label,
    variant_label,
)

SIGNIFICANT = 0.05


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


def efficiency(results: Results) -> Table:
    """Accuracy against training scenes, and the least scenes and n at which the threshold is reached."""
    e = results.efficiency
    sizes = sorted({size for variant in results.variants for size in results.sizes(variant)})
    rows: list[list[str | Cell]] = []
    for variant in results.variants:
        shown = [percent_spread(e["accuracy"][variant].get(f"s{size}", {})) for size in sizes]
        least = [e["reaches"][variant][name] for name in ("scenes", "n")]
        scenes, n = ("never" if x is None else str(x) for x in least)
        rows.append([variant_label(variant), *shown, scenes if variant in results.refitted else NONE, n])
    null = [percent_spread(e["null"]) if size == results.per_seed else NONE for size in sizes]
    rows.append([variant_label(POSITION), *null, NONE, NONE])
    threshold = percent(e["threshold"], 0)
    caption = (
        f"Accuracy by training scenes, {counted(results.study_n, 'demonstration')} each, on {split_label(e['split'])}, "
        f"users {listed(e['users'])}: mean [quartiles] over {counted(e['seeds'], 'seed')}; and the fewest scenes (at "
        f"n = {results.study_n}) and the smallest n (in {results.per_seed} scenes) of those tried whose mean is "
        f"{threshold} or more. {NONE}: not asked."
    )
    header = ["Variant", *(counted(size, "scene") for size in sizes), f"{threshold} with scenes", f"{threshold} with n"]
    return table("efficiency", caption, header, rows)


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
    header = [
        h for s in results.splits for h in (split_label(s), f"AUROC: {split_label(s)[0].lower()}{split_label(s)[1:]}")
    ]
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
    least, count = 2 / 2 ** len(results.seeds), len(results.comparisons)
    alone = least * max(sizes) < SIGNIFICANT <= least * count  # families find what all tests together could not
    caption = (
        f"Variant against variant: exact paired Wilcoxon test over {counted(len(results.seeds), 'seed')}, p after "
        f"Holm within each family of tests ({listed(families)}), each fixed before the results of the variant it is "
        "about were seen. Difference in percentage points. So many seeds allow no p below "
        f"{least:.2g} before Holm"
        + (f"; as one family of {count} tests it would be {least * count:.2g}, and none significant." if alone else ".")
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
    header = ["Variant", *(h for s in results.splits for h in (f"{split_label(s)}: ECE", f"{split_label(s)}: Brier"))]
    return table("calibration", caption, header, rows)
