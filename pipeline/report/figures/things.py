"""What the path model sees: the things it finds in new scenes, coloured by how much it takes them to matter."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import capsule, draw_footprints, draw_scene
from pipeline.report.style import CHALK, INVALID, SOOT, VALID
from pipeline.table.layout import Layouts, point_segment_distance

MATTERS = LinearSegmentedColormap.from_list("matters", [VALID, "#d9d9d9", INVALID])
ROOM = 0.1  # metres that a label needs below or above a thing


@dataclass(frozen=True)
class Things:
    """What was found in each scene of a pool, as capsules, padded."""

    ends: Float[Array, "scene thing 2 2"]  # of each capsule's segment [m]
    radius: Float[Array, "scene thing"]  # [m]
    present: Bool[Array, "scene thing"]


@dataclass(frozen=True)
class Seen:
    """One user's model in a pool of scenes."""

    scenes: list[int]  # those drawn, the last one the scene the model judges worst
    relevance: Float[Array, "scene thing"]  # of every scene of the pool
    agreement: Float[Array, " scene"]  # share of control points judged as is true


def lies_on(things: Things, layouts: Layouts) -> Bool[Array, "scene thing slot"]:
    """Whether a thing's middle lies on an item's footprint."""
    middle, ends = things.ends.mean(2)[:, :, None], layouts.ends[:, None]
    away = point_segment_distance(middle, ends[..., 0, :], ends[..., 1, :])  # (scene, thing, slot)
    return (away < layouts.radius[:, None]) & things.present[:, :, None] & layouts.present[:, None]


def draw(images: UInt8[Array, "scene 100 100 3"], layouts: Layouts, things: Things, seen: dict[str, Seen]) -> Figure:
    """Rows: users; columns: scenes, the user's worst last."""
    users, columns = list(seen), len(next(iter(seen.values())).scenes)
    figure = Figure((2.15 * columns + 0.3, 2.4 * len(users) + 0.65), layout="constrained")
    axes = figure.subplots(len(users), columns, squeeze=False)
    for row, user in zip(axes, users, strict=True):
        found = seen[user]
        for column, (ax, scene) in enumerate(zip(row, found.scenes, strict=True)):
            draw_scene(ax, images[scene])
            draw_footprints(ax, layouts, scene)
            labels: list[tuple[float, float]] = []
            for thing in np.flatnonzero(things.present[scene]):
                _draw_thing(ax, things, scene, int(thing), float(found.relevance[scene, thing]), labels)
            worst = column == columns - 1
            name = f"scene {scene}" + (f": worst of {len(images)}" if worst else "")
            ax.set_title(f"{user.capitalize()}, {name}", fontsize=8)
            ax.set_xlabel(f"right about {100 * found.agreement[scene]:.0f} % of control points", fontsize=8)
    bar = figure.colorbar(
        ScalarMappable(cmap=MATTERS), ax=axes, location="bottom", shrink=0.5, aspect=40, pad=0.02, ticks=[0, 0.5, 1]
    )
    bar.set_label("learned chance that the user keeps away from the thing", fontsize=8)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    return figure


def _draw_thing(
    ax: Axes, things: Things, scene: int, thing: int, relevance: float, labels: list[tuple[float, float]]
) -> None:
    """One outline in its colour, its relevance below or above: within the table, and away from other `labels`."""
    outline = capsule(things.ends[scene, thing], float(things.radius[scene, thing]))
    rim = [Stroke(linewidth=3.4, foreground=SOOT), Normal()]
    colour = MATTERS(relevance)
    ax.add_patch(Polygon(outline, fill=False, edgecolor=colour, lw=2.2, zorder=1.5, path_effects=rim))
    x, low, high = map(float, (things.ends[scene, thing, :, 0].mean(), outline[:, 1].min(), outline[:, 1].max()))
    places = [(x, low - 0.02)] * bool(low > ROOM) + [(x, high + 0.02)] * bool(high < 1 - ROOM) or [(x, high)]
    place = max(places, key=lambda p: min([ROOM, *(float(np.hypot(p[0] - a, p[1] - b)) for a, b in labels)]))
    labels.append(place)
    halo = [Stroke(linewidth=2.2, foreground=SOOT), Normal()]
    ax.text(
        *place, f"{relevance:.2f}", color=CHALK, fontsize=7, ha="center",
        va="top" if place[1] < low else "bottom", zorder=6, path_effects=halo,
    )  # fmt: skip
