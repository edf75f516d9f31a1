"""The arm over the table, seen from above: before the repair and after it."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray as Array

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
    shown += [
        (f"after it, {name}", after, arm[1, instant], style.VALID)
        for name, instant in (("start", 0), ("half way", middle), ("end", -1))
    ]
    for panel, (title, z_theta, joints, colour) in zip(axes[0], shown, strict=True):
        draw_table(panel, arrays["image"])
        draw_path(panel, z_theta, colour)
        _draw_arm(panel, joints)
        panel.set(title=title, xlim=VIEW[0], ylim=VIEW[1])
    return figure


def _draw_arm(axes: Axes, joints: Array) -> None:
    """Draw the arm's joints (joint, 2), shoulder first, and the grip as a star."""
    axes.plot(*joints.T, color="#111417", linewidth=7, alpha=0.45, solid_capstyle="round")
    axes.plot(*joints.T, color="white", linewidth=4, alpha=0.8, solid_capstyle="round")
    axes.plot(*joints[:-1].T, "o", color="#111417", markersize=4)
    axes.plot(*joints[-1], "*", color=style.START, markersize=12, markeredgecolor="#111417")
