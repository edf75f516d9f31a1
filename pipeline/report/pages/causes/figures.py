"""Effects of added items with the truth, and one scene with each added item."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_table, panels
from pipeline.report.results import Results
from pipeline.stats.tests import SMALLEST_EFFECT
from pipeline.world.layout import SYMBOLS


def effects(results: Results) -> Figure:
    """Draw one panel per user: each model's effect of each added item with its 95 % interval, and the true effect."""
    users, symbols = results.judged_users, results.added_symbols
    figure, axes = panels(1, len(users), 6.0 * len(users), 1.2 + len(symbols), sharey=True)
    for panel, user in zip(axes[0], users, strict=True):
        for i, symbol in enumerate(symbols):
            for j, variant in enumerate(results.variants):
                rows = results.asked("add", variant)
                row = rows[(rows["user"] == user) & (rows["symbol"] == symbol)].iloc[0]
                y = i + 0.7 * (j - (len(results.variants) - 1) / 2) / max(len(results.variants), 1)
                interval = panel.hlines(y, row["ci_low"], row["ci_high"], color=style.colour(variant), linewidth=2)
                mark = panel.plot(row["effect"], y, style.marker(variant), color=style.colour(variant), markersize=6)[0]
                value = f"{row['effect']:+.2f} ({row['ci_low']:+.2f} to {row['ci_high']:+.2f})"
                style.of_series(interval, variant)
                style.of_series(mark, variant, f"{style.label(variant)}, {symbol}: {value}")
                panel.vlines(row["truth"], i - 0.42, i + 0.42, color=style.INK, linewidth=1.6)
        panel.axvspan(-SMALLEST_EFFECT, SMALLEST_EFFECT, color=style.RULE, alpha=0.5, linewidth=0)
        panel.set_yticks(range(len(symbols)), symbols)
        panel.set(title=f"{user} user", xlabel="change in P(valid)", ylim=(len(symbols) - 0.5, -0.5))
    marks = [
        axes[0, 0].plot([], [], style.marker(v), color=style.colour(v), label=style.label(v))[0]
        for v in results.variants
    ]
    marks += [axes[0, 0].plot([], [], "|", color=style.INK, markersize=14, label="Truth")[0]]
    legend = figure.legend(handles=marks, loc="outside lower center", ncols=4, fontsize=10)
    for variant, text in zip(results.variants, legend.get_texts(), strict=False):
        style.toggles(text, variant)
    return figure


def one_scene(results: Results) -> Figure:
    """Draw one scene without and with each added item: the image, the truth, and the shown models' maps."""
    drawn, shown = results.drawn, list(results.drawn.added_maps)
    columns = ["as it is", *(f"added {symbol}" for symbol in SYMBOLS)]
    figure, axes = panels(1 + len(shown), len(columns), 2.4 * len(columns), 2.5 * (1 + len(shown)))
    for i, title in enumerate(columns):
        draw_table(axes[0, i], drawn.added_images[i])
        axes[0, i].set_title(title)
        for j, name in enumerate(shown, 1):
            draw_map(axes[j, i], drawn.added_maps[name][i])
    for j, name in enumerate(shown, 1):
        axes[j, 0].set_ylabel("Truth" if name == "truth" else style.label(name), color=style.INK)
    return figure
