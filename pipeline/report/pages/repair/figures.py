"""Success rates of repairs with baselines, and examples of repairs, failures among them."""

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.report import style
from pipeline.report.drawing import draw_table, legend_below, panels
from pipeline.report.pages.index.figures import draw_repairs, first_start, trace
from pipeline.report.results import PAPER_TABLE_1, Results
from pipeline.world.bezier import curve
from pipeline.world.rules import valid

MIDDLE = 40  # of 81 points along a path: where its mark stands


def success(results: Results) -> Figure:
    """Draw one panel per user: success of gradient repair by variant with quartiles, the detour and the paper."""
    users = results.repaired_users
    figure, axes = panels(1, len(users), 6.2 * len(users), 0.5 * len(results.variants) + 1.9, sharey=True)
    for panel, user in zip(axes[0], users, strict=True):
        for place, variant in enumerate(results.variants):
            columns = ("success", "success_q1", "success_q3")
            mean, low, high = (100 * results.repair("gradient", variant, user, column) for column in columns)
            panel.hlines(place, low, high, color=style.colour(variant), linewidth=2.5)
            panel.plot(mean, place, style.marker(variant), color=style.colour(variant), markersize=9)
            panel.text(112, place, f"{mean:.0f}", ha="right", va="center")
        detour = 100 * results.repair("constant_detour", "", user)
        panel.axvline(detour, color=style.MUTED, linestyle="--", label="one detour for all", zorder=0)
        if user in PAPER_TABLE_1 and "full" in results.variants:
            rate, place = 100 * PAPER_TABLE_1[user], results.variants.index("full")
            panel.plot(rate, place, "*", color=style.INK, markersize=13, linestyle="", label="the paper")
        panel.set_yticks(range(len(results.variants)), [style.label(v) for v in results.variants])
        panel.set(ylim=(len(results.variants) - 0.5, -0.5), xticks=range(0, 101, 20))
        panel.grid(axis="x")
        panel.set(title=f"{user} user", xlim=(0, 113), xlabel="paths that end valid, per cent")
    legend_below(figure, axes[0, 0], 2)
    return figure


def drawn(results: Results) -> Figure:
    """Draw the first repair in each mapped scene, one row per user: the start, and each shown model's end.

    An end that is truly invalid has a cross.
    """
    users, scenes = results.repaired_users, results.drawn.mapped
    figure, axes = panels(len(users), len(scenes), 3.9 * len(scenes), 4.0 * len(users))
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.images[scene], results.drawn.layouts, scene, results.users[user])
            panel.set_title(f"{user} user, scene {scene}")
            start = first_start(results, user, scene)
            if start is None:
                panel.set_xlabel("no invalid path")
                continue
            traces = {v: trace(results, v, user, scene, start) for v in results.shown}
            draw_repairs(panel, traces)
            for steps in traces.values():
                if not valid(results.drawn.layouts[[scene]], steps[None, -1:], results.users[user])[0, 0]:
                    panel.plot(
                        *curve(steps[-1], 81)[MIDDLE], "X", color="white", markersize=11, markeredgecolor="black"
                    )
    handles = [Line2D([], [], color=style.START, linewidth=3, linestyle="--", label="start")]
    handles += [Line2D([], [], color=style.colour(v), linewidth=3, label=style.label(v)) for v in results.shown]
    cross = {"linestyle": "", "markersize": 11, "markeredgecolor": "black", "label": "ends invalid"}
    handles.append(Line2D([], [], marker="X", color="white", **cross))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
