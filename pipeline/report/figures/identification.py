"""Who labelled these paths: accuracy against the number of labelled paths, and what becomes of a stranger."""

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.report.style import INK, MUTED, colour, line, marker
from pipeline.report.wording import variant_label

SURE = 0.99
IDEAL = (0, (4, 2))
RATES = {"accuracy": "All scenes", "telling": "Telling scenes"}


def draw(curve: pd.DataFrame, variants: list[str], chance: float, level: float, columns: int) -> Figure:
    """Panels over k: all scenes, telling ones if there are two, and "none of these"; columns as in stage identify."""
    figure = Figure((8.4, 3.5) if columns > 1 else (4.2, 8.6), layout="constrained")
    rates = {name: title for name, title in RATES.items() if name in curve}
    shape = (1, len(rates) + 1) if columns > 1 else (len(rates) + 1, 1)
    *known, strange = figure.subplots(*shape, sharex=True, squeeze=False).ravel()
    ideal = curve[curve["variant"] == variants[0]]
    for ax, (column, title) in zip(known, rates.items(), strict=True):
        for variant in variants:
            c = curve[curve["variant"] == variant]
            ax.fill_between(c["k"], c[f"{column}_low"], c[f"{column}_high"], color=colour(variant), alpha=0.18, lw=0)
            _line(ax, c, column, variant)
        ax.plot(ideal["k"], ideal[f"ideal_{column}"], color=INK, lw=1.2, ls=IDEAL)
        ax.axhline(chance, color=MUTED, lw=0.8, ls=":")
        ax.axhline(SURE, color=MUTED, lw=0.6)
        ax.set(title=title, ylim=(chance - 0.05, 1.02))
        ax.set_ylabel("true user is the most probable")
    for variant in variants:
        c = curve[curve["variant"] == variant]
        _line(strange, c, "recognised", variant)
        strange.plot(c["k"], c["false_alarms"], color=colour(variant), lw=1.0, ls=":")
    strange.plot(ideal["k"], ideal["ideal_recognised"], color=INK, lw=1.2, ls=IDEAL)
    strange.axhline(level, color=MUTED, lw=0.6)
    strange.set(title="“None of these”", ylim=(-0.02, None))
    strange.set_ylabel("share called a stranger")
    for ax in (*known, strange):
        ax.title.set_horizontalalignment("center")
        ax.set_xlabel("labelled paths, k")
    handles = [Line2D([], [], color=colour(v), marker=marker(v), ms=4, lw=1.2, ls=line(v)) for v in variants]
    handles += [Line2D([], [], color=INK, lw=1.2, ls=IDEAL), Line2D([], [], color=MUTED, lw=0.8, ls=":")]
    texts = [*(variant_label(v) for v in variants), "knows the rules", "dotted: chance; known users called strangers"]
    figure.legend(handles, texts, loc="outside lower center", ncols=3 if columns > 1 else 1)
    return figure


def _line(ax, c: pd.DataFrame, column: str, variant: str) -> None:
    ax.plot(
        c["k"], c[column], color=colour(variant), lw=1.2, ls=line(variant), marker=marker(variant), ms=3, markevery=4
    )
