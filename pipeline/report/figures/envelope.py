"""Dose and response: what an item takes from validity by how near a path comes to it, beside the true step."""

from collections.abc import Mapping

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.report.style import INK, MUTED, RULE, colour, marker
from pipeline.report.wording import variant_label
from pipeline.table.layout import SYMBOLS

LOWEST, STEP = -0.1, 0.09  # where radii are drawn below the curves


def draw(
    curves: Mapping[str, dict], envelopes: Mapping[str, dict], variants: list[str], users: list[str], columns: int
) -> Figure:
    """A panel per user and symbol; curves and envelopes: variant -> user -> symbol -> numbers (stage envelope)."""
    panels = [(user, symbol) for user in users for symbol in SYMBOLS]
    rows = -(-len(panels) // columns)
    figure = Figure((1.85 * columns + 0.6, 1.75 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, (user, symbol) in zip(axes, panels, strict=True):
        truth = curves[variants[0]][user][symbol]
        ax.axhline(0, color=RULE, lw=0.6)
        ax.step(_cm(truth["clearance_m"]), truth["truth"], where="mid", color=INK, lw=1.6)
        for i, variant in enumerate(variants):
            c, e, y = curves[variant][user][symbol], envelopes[variant][user][symbol], LOWEST - STEP * i
            x = _cm(c["clearance_m"])
            ax.fill_between(x, c["ci_low"], c["ci_high"], color=colour(variant), alpha=0.2, lw=0)
            ax.plot(x, c["drop"], color=colour(variant), lw=1.2)
            if e["radius_m"] is not None:
                ax.plot(_cm([e["ci_low"], e["ci_high"]]), [y, y], color=colour(variant), lw=1.6)
                ax.plot(*_cm([e["radius_m"]]), y, marker(variant), color=colour(variant), ms=3.6)
        ax.set_title(f"{user}, {symbol}", loc="left", fontsize=8)
        ax.set_ylim(LOWEST - STEP * len(variants), 1.06)
        ax.set_yticks([0, 0.5, 1])
    for ax in axes[-columns:]:
        ax.set_xlabel("clearance [cm]")
    handles = [Line2D([], [], color=INK, lw=1.6)]
    handles += [Line2D([], [], color=colour(v), marker=marker(v), ms=4, lw=1.2) for v in variants]
    handles.append(Line2D([], [], color=MUTED, marker="o", ms=4, lw=1.6))
    texts = ["truth", *(variant_label(v) for v in variants), "below: radius, 95 % interval"]
    figure.legend(handles, texts, loc="outside lower center", ncols=len(texts) if columns > 2 else 2)
    return figure


def _cm(lengths) -> list[float]:
    return [100 * length for length in lengths]
