"""Figures of a sweep's page."""

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from pipeline.legend import label
from pipeline.report import style
from pipeline.sweep.page.tables import title
from pipeline.sweep.summary import QUARTILES, Summary

MAX_PANELS = 4  # results beside one another
REACH = 0.3  # difference in accuracy at which colours end
DARK = "#1b1f25"  # not style.INK: cells stay light at night


def parameters(summary: Summary) -> Figure:
    """Draw the results against each swept parameter, a row a parameter; the others are as in the reference."""
    shown = panels(summary.headlines)
    rows, columns = len(summary.parameters), len(shown)
    figure, axes = plt.subplots(
        rows, columns, figsize=(3.2 * columns + 0.6, 2.9 * rows), squeeze=False, layout="constrained"
    )
    for row, parameter in zip(axes, summary.parameters, strict=True):
        at = at_reference(summary, parameter)
        values = sorted(at[parameter].unique(), key=_order)
        for panel, (heading, names) in zip(row, shown.items(), strict=True):
            for offset, (headline, variant) in enumerate(names.items()):
                part = at[at["headline"] == headline]
                by = part.groupby(parameter)["value"].agg(**QUARTILES).reindex(values)
                x = [place + 0.06 * (offset - (len(names) - 1) / 2) for place in range(len(values))]
                reach = [(by["mean"] - by["q1"]).clip(lower=0), (by["q3"] - by["mean"]).clip(lower=0)]
                look = {"color": style.colour(variant), "marker": style.marker(variant), "capsize": 2, "markersize": 5}
                panel.errorbar(x, by["mean"], yerr=reach, label=label(variant), **look)
            panel.set_xticks(range(len(values)), values)
            panel.set_xlabel(parameter)
            panel.set_title(heading)
            panel.grid(axis="y")
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=9)
    return figure


def comparisons(summary: Summary) -> Figure:
    """Draw how much better a variant is than another, a row a setting and a panel a split; bold if p (Holm) < .05."""
    table = summary.comparisons
    table = table.assign(pair=[f"{label(v)}\nagainst {label(a)}" for v, a in table[["variant", "against"]].to_numpy()])
    settings, splits, pairs = (list(dict.fromkeys(table[column])) for column in ("setting", "split", "pair"))
    size = (2.6 + 0.8 * len(pairs), 2 + (0.4 + 0.24 * len(settings)) * len(splits))
    figure, axes = plt.subplots(len(splits), 1, figsize=size, sharex=True, squeeze=False, layout="constrained")
    for panel, split in zip(axes[:, 0], splits, strict=True):
        part = table[table["split"] == split]
        grid = part.pivot(index="setting", columns="pair", values="difference").reindex(index=settings, columns=pairs)
        panel.pcolormesh(100 * grid, cmap="RdBu", vmin=-100 * REACH, vmax=100 * REACH, edgecolors="white", linewidth=1)
        for row in part.itertuples():
            x, y = pairs.index(str(row.pair)) + 0.5, settings.index(str(row.setting)) + 0.5
            weight = "bold" if row.word in ("better", "worse") else "normal"
            ink = "white" if abs(row.difference) > 0.7 * REACH else DARK
            panel.text(x, y, f"{100 * row.difference:+.0f}", ha="center", va="center", weight=weight, color=ink)
        panel.set_yticks([y + 0.5 for y in range(len(settings))], settings, fontsize=9)
        panel.set_title(label(split))
        panel.invert_yaxis()
    axes[-1, 0].set_xticks([x + 0.5 for x in range(len(pairs))], pairs, rotation=90, fontsize=9)
    return figure


def panels(headlines: list[str]) -> dict[str, dict[str, str]]:
    """Return panel -> {headline: variant}: results that differ in nothing but the variant share a panel."""
    shared: dict[str, dict[str, str]] = {}
    for headline in headlines:
        kind, variant, *rest = [*headline.split("."), ""]
        heading = title(".".join(part for part in (kind, *rest) if part)).replace(", ", "\n", 1)
        shared.setdefault(heading, {})[headline] = variant
    return dict(list(shared.items())[:MAX_PANELS])


def at_reference(summary: Summary, parameter: str) -> pd.DataFrame:
    """Return the results with all other parameters as in the reference; all results if these are of one value."""
    others = [name for name in summary.parameters if name != parameter]
    reference = summary.results[summary.results["setting"] == summary.reference].iloc[0]
    held = summary.results[(summary.results[others] == reference[others]).all(axis=1)]
    return held if held[parameter].nunique() > 1 else summary.results


def _order(text: str) -> tuple[bool, float, str]:
    try:
        return False, float(text), text
    except ValueError:
        return True, 0.0, text
