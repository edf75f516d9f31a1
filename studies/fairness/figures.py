"""Draw demonstrations of each kind on one table."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.study import Study


def shown(study: Study) -> Figure:
    """Draw one scene's demonstrations: at random, the clearest ones, and those of few families of routes."""
    examples, (least, *_, most) = study.arrays("examples.npz"), study.settings["clear_cm"]
    names = [str(name) for name in examples["names"]]
    kinds = {f"any {least}": "At random", f"any {most}": f"Clear by {most} cm"}
    kinds |= {f"few {least}": "Few families", f"few {most}": f"Few families, clear by {most} cm"}
    figure, axes = panels(1, len(kinds), 3.0 * len(kinds), 3.3, list(kinds.values()))
    for panel, name in zip(axes[0], kinds, strict=True):
        draw_table(panel, examples["image"])
        kind = names.index(name)
        for z, valid in zip(examples["z_theta"][kind], examples["valid"][kind], strict=True):
            draw_path(panel, z, style.VALID if valid else style.INVALID, linestyle="-" if valid else (0, (3, 1)))
    return figure
