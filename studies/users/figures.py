"""Draw valid control points of each user."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study
from pipeline.world.bezier import Z_HIGH, Z_LOW


def demonstrations(study: Study) -> Figure:
    """Draw the control points of the valid demonstrations of the first seed, a panel for each user."""
    table, users = study.table("shown.csv", finite=("z_x", "z_y")), list(study.users)
    figure, axes = panels(1, len(users), 3.1 * len(users), 3.9, sharex=True, sharey=True)
    for panel, user in zip(axes[0], users, strict=True):
        points = table[table["user"] == user]
        panel.plot(points["z_x"], points["z_y"], "o", color=style.INK, markersize=3, alpha=0.7)
        panel.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color=style.MUTED, linewidth=0.8, linestyle=(0, (3, 2)))
        panel.set(title=f"{user}: {len(points)}", aspect="equal", xlim=(Z_LOW, Z_HIGH), ylim=(Z_LOW, Z_HIGH))
        panel.set(xticks=[0, 1], yticks=[0, 1], xlabel="x [m]")
    axes[0, 0].set_ylabel("y [m]")
    return figure
