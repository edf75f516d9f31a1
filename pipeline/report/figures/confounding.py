"""Association beside intervention in a world where plates stand beside glasses."""

from collections.abc import Mapping

from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report.figures.interventions import forest, key
from pipeline.report.figures.tabletop import draw_scene, row_label
from pipeline.report.style import INK, MUTED, PAPER
from pipeline.table.layout import SYMBOLS

WORLDS = {"ordinary": PAPER, "confounded": INK}  # faces of the association's marks


def draw(
    association: Mapping[str, dict], effects: Mapping[str, dict], users: list[str], smallest: float, columns: int
) -> Figure:
    """Per user two panels: what association says in both worlds, and what intervention on the models says.

    association: world -> user -> symbol -> numbers; effects: variant -> user -> symbol -> numbers (stage confound).
    """
    figure = Figure((7.4, 2.6 * len(users) + 0.7) if columns > 1 else (4.2, 5.2 * len(users)), layout="constrained")
    panels = figure.subplots(2 * len(users) // columns, columns, squeeze=False).ravel()
    for user, ax, beside in zip(users, panels[::2], panels[1::2], strict=True):
        for y, symbol in enumerate(SYMBOLS):
            for at, (world, face) in zip((y - 0.15, y + 0.15), WORLDS.items(), strict=True):
                c = association[world][user][symbol]
                ax.plot([c["ci_low"], c["ci_high"]], [at, at], color=INK, lw=1.1)
                ax.plot(c["difference"], at, "s", ms=5, mec=INK, mfc=face)
        ax.axvline(0, color=MUTED, lw=0.6)
        ax.set_yticks(range(len(SYMBOLS)), [f"near {s}" for s in SYMBOLS])
        ax.set_ylim(len(SYMBOLS) - 0.45, -0.55)
        ax.tick_params(axis="y", length=0)
        ax.set_title(f"{user.capitalize()}: association", loc="left")
        ax.set_xlabel("P(invalid | near) − P(invalid | not near)")
        forest(beside, {variant: by_user[user] for variant, by_user in effects.items()}, smallest)
        beside.set_title("intervention", loc="left")
        beside.set_xlabel("change of mean P(valid)")
    handles, texts = key(list(effects))
    handles += [Line2D([], [], ls="", marker="s", mec=INK, mfc=face, ms=5) for face in WORLDS.values()]
    texts += [f"{world} scenes" for world in WORLDS]
    figure.legend(handles, texts, loc="outside lower center", ncols=3 if columns > 1 else 2, handlelength=1.8)
    return figure


def draw_worlds(worlds: Mapping[str, UInt8[Array, "scene 100 100 3"]], shown: int) -> Figure:
    """A row of training scenes of each world."""
    figure = Figure((1.35 * shown + 0.3, 1.4 * len(worlds)), layout="constrained")
    for row, (name, pictures) in zip(figure.subplots(len(worlds), shown, squeeze=False), worlds.items(), strict=True):
        for ax, picture in zip(row, pictures, strict=False):
            draw_scene(ax, picture, ends=False)
        row_label(row[0], name)
    return figure
