"""Draw valid control points of each user, and the overlap of two users' valid paths by scene."""

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


def overlaps(study: Study) -> Figure:
    """Draw each scene's overlap, true and by a model, of the first and the last of the users with invalid paths."""
    table = study.table("overlap_scenes.csv", finite=("truth", "overlap"))
    pair = table[(table["first"] == study.judged_users[0]) & (table["second"] == study.judged_users[-1])]
    shown = [variant for variant in pair["variant"].unique() if variant in study.variants]
    figure, axes = panels(1, len(shown), 3.6 * len(shown), 4.3, sharex=True, sharey=True)
    for panel, variant in zip(axes[0], shown, strict=True):
        rows, ends = pair[pair["variant"] == variant], (-0.02, 1.02)
        panel.plot([0, 1], [0, 1], color=style.RULE)
        shape, colour = style.MARKERS.get(variant, "X"), style.colour(variant)
        panel.plot(rows["truth"], rows["overlap"], shape, color=colour, alpha=0.7)
        panel.set(title=style.label(variant), xlabel="true overlap", aspect="equal", xlim=ends, ylim=ends)
    axes[0, 0].set_ylabel("overlap by the model")
    return figure
