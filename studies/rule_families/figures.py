"""Accuracy and unsafe answers by rule, and which rule the clearance model finds."""

from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

from pipeline.report.drawing import draw_intervals, legend_below, panels
from pipeline.report.study import Study
from studies.rule_families.tables import RULES

MEASURES = {
    "accuracy": ("ci_low", "ci_high", "accuracy, per cent"),
    "unsafe": ("unsafe_ci_low", "unsafe_ci_high", "invalid paths accepted, per cent"),
}


def by_rule(study: Study) -> Figure:
    """Draw accuracy and the share of invalid paths accepted with 95 % intervals, a group for each rule."""
    table = study.table("summary.csv", finite=("accuracy", "ci_low", "ci_high", "unsafe"))
    rules, variants = list(dict.fromkeys(table["family"])), list(dict.fromkeys(table["variant"]))
    figure, axes = panels(1, 2, 12.0, 1.2 + 0.9 * len(rules), sharey=True)
    for panel, (measure, (low, high, title)) in zip(axes[0], MEASURES.items(), strict=True):
        by_variant = {
            variant: table[table["variant"] == variant].set_index("family").loc[rules, [measure, low, high]].to_numpy()
            for variant in variants
        }
        draw_intervals(panel, [RULES[rule] for rule in rules], by_variant)
        panel.set(xlabel=title, xlim=(0 if measure == "unsafe" else 55, 102))
    legend_below(figure, axes[0, 0], 4)
    return figure


def posterior(study: Study) -> Figure:
    """Draw the mean posterior probability of each fitted rule, a row for each true rule."""
    table = study.table("posterior.csv", finite=("probability",))
    rules, fitted = list(dict.fromkeys(table["family"])), list(dict.fromkeys(table["fitted_family"]))
    mean = table.pivot_table(index="family", columns="fitted_family", values="probability").loc[rules, fitted]
    figure, axes = panels(1, 1, 9.6, 1.2 + 0.5 * len(rules))
    panel = axes[0, 0]
    panel.imshow(mean, cmap="Blues", vmin=0, vmax=1.6, aspect="auto")
    for (row, column), p in np.ndenumerate(mean.to_numpy()):
        panel.text(column, row, f"{p:.2f}", ha="center", va="center", color="#1b1f23")
    panel.set_yticks(range(len(rules)), [f"true: {RULES[rule]}" for rule in rules])
    panel.set_xticks(range(len(fitted)), [fill(RULES.get(str(rule), str(rule)), 11) for rule in fitted])
    panel.tick_params(length=0)
    panel.set_xlabel("rule in the model")
    return figure
