"""The worlds as images, and association beside the effects that models report."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_images, legend_below, panels
from pipeline.report.study import Study
from pipeline.world.symbols import SYMBOLS
from studies.confounding.tables import WORLDS

MODELS = ("full", "irl_ranked", "clearance")
PER_WORLD = 5  # training scenes drawn of each world
CONFOUNDED = "confounded"


def worlds(study: Study) -> Figure:
    """Draw the first training scenes of the control and of the confounded world."""
    images = study.arrays("examples.npz")
    shown = [world for world in ("control", CONFOUNDED) if world in images]
    return draw_images({WORLDS[world].partition(" (")[0]: images[world][:PER_WORLD] for world in shown})


def association_and_effect(study: Study) -> Figure:
    """Draw, for the last user, association in the confounded world's labels beside models' effects and the truth."""
    associations = study.table("association.csv", finite=("difference",))
    effects = study.table("effects.csv", finite=("effect", "ci_low", "ci_high", "truth"))
    user = list(dict.fromkeys(effects["user"]))[-1]
    here = (associations["world"] == CONFOUNDED) & (associations["user"] == user)
    rows = associations[here].set_index("symbol").loc[list(SYMBOLS)]
    figure, axes = panels(1, 2, 12.0, 1.4 + 0.75 * len(SYMBOLS), sharey=True)
    left, right = axes[0]
    y = np.arange(len(SYMBOLS))
    left.hlines(y, rows["ci_low"], rows["ci_high"], color=style.INK, linewidth=2)
    left.plot(rows["difference"], y, "o", color=style.INK)
    left.set(title="association in the labels", xlabel="P(invalid | near) − P(invalid | not near)")
    effects = effects[(effects["user"] == user) & (effects["world"] == CONFOUNDED)]
    shown = [variant for variant in MODELS if variant in set(effects["variant"])]
    for i, variant in enumerate(shown):
        own = effects[effects["variant"] == variant].set_index("symbol").loc[list(SYMBOLS)]
        at = y + 0.5 * (i / max(len(shown) - 1, 1) - 0.5)
        right.hlines(at, -own["ci_high"], -own["ci_low"], color=style.colour(variant), linewidth=2)
        marks = {"color": style.colour(variant), "label": style.label(variant)}
        right.plot(-own["effect"], at, style.marker(variant), **marks)
        right.vlines(-own["truth"], y - 0.4, y + 0.4, color=style.INK, label="Truth" if i == 0 else None)
    right.set(title="intervention: the item is added", xlabel="fall in P(valid)")
    for panel in (left, right):
        panel.axvline(0, color=style.RULE, linewidth=1)
        panel.set_yticks(y, SYMBOLS)
        panel.set_ylim(len(SYMBOLS) - 0.5, -0.5)
        panel.grid(axis="x")
    legend_below(figure, right, 4)
    return figure
