"""The same table for different users: which paths suit whom, by the truth and by the shown models."""

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pipeline.report import style
from pipeline.report.drawing import draw_table, panels
from pipeline.report.results import Results
from pipeline.world.bezier import Z_HIGH, Z_LOW

KINDS = ListedColormap(["#3b4252", "#d55e00", "#56b4e9", "#f0e442"])  # valid to neither, first only, second only, both


def who_accepts(results: Results) -> Figure:
    """Draw, for the mapped scenes, which control points are valid to both, one or none of two users."""
    drawn, (first, second) = results.drawn, pair(results)
    columns = ["truth", *(v for v in results.shown if v in ("full", "clearance"))]
    figure, axes = panels(len(drawn.mapped), 1 + len(columns), 2.9 * (1 + len(columns)), 2.85 * len(drawn.mapped) + 0.5)
    for place, (line, scene) in enumerate(zip(axes, drawn.mapped, strict=True)):
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[first])
        for panel, name in zip(line[1:], columns, strict=True):
            maps = drawn.truth if name == "truth" else drawn.maps[name]
            kind = np.asarray(maps[first][place] > 0.5, int) + 2 * np.asarray(maps[second][place] > 0.5, int)
            extent = (Z_LOW, Z_HIGH, Z_LOW, Z_HIGH)
            panel.imshow(kind, cmap=KINDS, vmin=0, vmax=3, origin="lower", extent=extent, interpolation="none")
            panel.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color="white", linewidth=0.8, linestyle=(0, (3, 2)))
            panel.set(xticks=[], yticks=[])
            panel.spines[:].set_visible(False)
        line[0].set_ylabel(f"scene {scene}", color=style.INK)
    for panel, name in zip(axes[0], ["Table", *columns], strict=True):
        panel.set_title({"truth": "Truth", "Table": f"Table, {first} user’s margins"}.get(name, style.label(name)))
    names = ["neither", f"{first} only", f"{second} only", "both"]
    handles = [Patch(facecolor=KINDS(i), edgecolor=style.MUTED, label=f"valid for {n}") for i, n in enumerate(names)]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def pair(results: Results) -> tuple[str, str]:
    """Return the first and the last of the users with invalid paths: one and the same if there is one."""
    return results.judged_users[0], results.judged_users[-1]
