"""The paper's rates and ours, as intervals."""

from matplotlib.figure import Figure

from pipeline.report.claims import PAPER, claims_table
from pipeline.report.drawing import draw_intervals, panels
from pipeline.report.results import Results
from pipeline.report.style import label


def rates(results: Results) -> Figure:
    """Draw accuracy in the training scenes and success of gradient repair: paper, ours, image-blind."""
    claims = claims_table(results).dropna(subset=["paper", "q1"])
    groups = [
        f"accuracy, {label(m)}" if c == "accuracy" else f"repair, {m}"
        for c, m in zip(claims["claim"], claims["measure"], strict=True)
    ]
    intervals = {
        "paper": list(zip(claims["paper"], claims["paper_low"], claims["paper_high"], strict=True)),
        PAPER: list(zip(claims["ours"], claims["q1"], claims["q3"], strict=True)),
        "blind": [(x, x, x) for x in claims["baseline"]],
    }
    figure, axes = panels(1, 1, 8.4, 0.9 * len(groups) + 1.3)
    draw_intervals(axes[0, 0], groups, intervals)
    axes[0, 0].set(xlim=(0, 103), xlabel="per cent")
    axes[0, 0].legend(loc="lower left")
    return figure
