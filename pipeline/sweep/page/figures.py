"""Figures of a sweep's page."""

import matplotlib.pyplot as plt
import pandas as pd
import yaml
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.sweep.page.tables import title
from pipeline.sweep.summary import Summary

MAX_PANELS = 4  # results beside one another


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
                by = part.groupby(parameter)["value"].agg(
                    ["mean", lambda x: x.quantile(0.25), lambda x: x.quantile(0.75)]
                )
                by.columns = ["mean", "q1", "q3"]
                by = by.reindex(values)
                x = [place + 0.06 * (offset - (len(names) - 1) / 2) for place in range(len(values))]
                reach = [(by["mean"] - by["q1"]).clip(lower=0), (by["q3"] - by["mean"]).clip(lower=0)]
                look = {"color": style.colour(variant), "marker": style.marker(variant), "capsize": 2, "markersize": 5}
                panel.errorbar(x, by["mean"], yerr=reach, label=style.label(variant), **look)
            panel.set_xticks(range(len(values)), values)
            panel.set_xlabel(parameter)
            panel.set_title(heading)
            panel.grid(axis="y")
    axes[0][0].legend(fontsize=9)
    return figure


def panels(headlines: list[str]) -> dict[str, dict[str, str]]:
    """Return panel -> {headline: variant}: results that differ in nothing but the variant share a panel."""
    found: dict[str, dict[str, str]] = {}
    for headline in headlines:
        kind, variant, *rest = [*headline.split("."), ""]
        found.setdefault(title(".".join(part for part in (kind, *rest) if part)).replace(", ", "\n", 1), {})[
            headline
        ] = variant
    return dict(list(found.items())[:MAX_PANELS])


def at_reference(summary: Summary, parameter: str) -> pd.DataFrame:
    """Return the results with all other parameters as in the reference; all results if these are of one value."""
    others = [name for name in summary.parameters if name != parameter]
    reference = summary.results[summary.results["setting"] == summary.reference].iloc[0]
    held = summary.results[(summary.results[others] == reference[others]).all(axis=1)]
    return held if held[parameter].nunique() > 1 else summary.results


def _order(text: str) -> tuple[bool, float, str]:
    value = yaml.safe_load(text)
    number = isinstance(value, int | float)
    return not number, float(value) if number else 0.0, text
