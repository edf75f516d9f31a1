"""Success rates of repairs with baselines, and examples of repairs."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_table, panels
from pipeline.report.pages.index.figures import draw_repairs, first_start, trace
from pipeline.report.results import PAPER_TABLE_1, Results


def success(results: Results) -> Figure:
    """Draw one panel per user: success of gradient repair by variant with quartiles, and two lines for comparison."""
    users = results.repaired_users
    figure, axes = panels(1, len(users), 5.6 * len(users), 0.5 * len(results.variants) + 1.6, sharey=True)
    for panel, user in zip(axes[0], users, strict=True):
        rows = [
            [results.repair("gradient", v, user, c) for c in ("success", "success_q1", "success_q3")]
            for v in results.variants
        ]
        panel.set_yticks(range(len(rows)), [style.label(v) for v in results.variants])
        panel.set_ylim(len(rows) - 0.5, -0.5)
        panel.grid(axis="x")
        for place, (variant, (mean, low, high)) in enumerate(zip(results.variants, rows, strict=True)):
            panel.hlines(place, 100 * low, 100 * high, color=style.colour(variant), linewidth=2.5)
            panel.plot(100 * mean, place, style.marker(variant), color=style.colour(variant), markersize=9)
        detour = 100 * results.repair("constant_detour", "", user)
        panel.axvline(detour, color=style.MUTED, linestyle="--")
        panel.text(detour - 1, -0.42, "constant detour", ha="right", va="top", fontsize=9)
        if user in PAPER_TABLE_1:
            panel.plot(
                100 * PAPER_TABLE_1[user],
                results.variants.index("full") if "full" in results.variants else 0,
                "*",
                color=style.INK,
                markersize=13,
            )
        panel.set(title=f"{user} user (star: the paper)", xlim=(0, 103), xlabel="paths that end valid, per cent")
    return figure


def drawn(results: Results) -> Figure:
    """Draw the first repair in each mapped scene, one row per user: the start, and the end by each shown model."""
    users, scenes = results.repaired_users, results.drawn.mapped
    figure, axes = panels(len(users), len(scenes), 3.4 * len(scenes), 3.6 * len(users))
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.images[scene], results.drawn.layouts, scene, results.users[user])
            start = first_start(results, user, scene)
            if start is not None:
                draw_repairs(panel, {v: trace(results, v, user, scene, start) for v in results.shown})
            panel.set_title(f"{user}, scene {scene}")
    for variant in results.shown:
        axes[0, 0].plot([], [], color=style.colour(variant), linewidth=3, label=style.label(variant))
    figure.legend(loc="outside lower center", ncols=3)
    return figure
