"""One table with S-shaped demonstrations, as they were fitted and forced into parabolas."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_table, panels
from pipeline.report.study import Study


def demonstrations(study: Study) -> Figure:
    """Draw the first table's demonstrations in both spaces."""
    shown = study.arrays("shown.npz")
    figure, axes = panels(1, 2, 9.6, 4.8)
    for panel, (name, title) in zip(axes[0], (("curves", "as curves"), ("parabolas", "as parabolas")), strict=True):
        draw_table(panel, shown["image"])
        for points, valid in zip(shown[name], shown["valid"], strict=True):
            panel.plot(*points.T, color=style.VALID if valid else style.INVALID, linewidth=2)
        panel.set(title=title, xlim=(-0.15, 1.15), ylim=(-0.15, 1.15))
    return figure
