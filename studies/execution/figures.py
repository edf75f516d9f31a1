"""The arm over the table, seen from above: before the repair and after it."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.study import Study

VIEW = (-0.1, 1.1), (-0.3, 1.02)  # x and y of the panels [table sides]


def strip(study: Study) -> Figure:
    """Draw the unrepaired path with the arm half way, then the repaired path with the arm at its start, middle, end."""
    arrays = study.arrays("shown.npz")
    before, after = arrays["z_theta"]
    arm = arrays["chain"][..., :2] / arrays["side_m"]  # (path, instant, joint, 2) [table sides]
    middle = arm.shape[1] // 2
    figure, axes = panels(1, 4, 12.8, 3.9)
    shown = [("before the repair", before, arm[0, middle], style.INVALID)]
    for name, instant in (("start", 0), ("half way", middle), ("end", -1)):
        shown.append((f"after it, {name}", after, arm[1, instant], style.VALID))
    for panel, (title, z_theta, joints, colour) in zip(axes[0], shown, strict=True):
        draw_table(panel, arrays["image"])
        draw_path(panel, z_theta, colour)
        for edge, width, alpha in (("#111417", 7, 0.45), ("white", 4, 0.8)):
            panel.plot(*joints.T, color=edge, linewidth=width, alpha=alpha, solid_capstyle="round")
        panel.plot(*joints[:-1].T, "o", color="#111417", markersize=4)
        panel.plot(*joints[-1], "*", color=style.START, markersize=12, markeredgecolor="#111417")
        panel.set(title=title, xlim=VIEW[0], ylim=VIEW[1])
    return figure
