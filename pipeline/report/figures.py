"""The drawings of the paper's pages; whatever is a chart of a table stands in the templates."""

import base64
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt

from pipeline.report import style
from pipeline.report.derived import failing, worst_scenes
from pipeline.report.drawing import draw_map, draw_path, draw_table, fewer_levels, outline_table, panels
from pipeline.report.results import Results
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, lattice
from pipeline.world.layout import SYMBOLS
from pipeline.world.rules import valid

ANYWHERE = [0.43, 0.91]  # a control point on the table [m]
LEAST_DIFFERENCE = 0.05  # smallest share of a map's cells in which two users differ
KINDS = ListedColormap(["#3b4252", "#d55e00", "#56b4e9", "#f0e442"])  # valid to neither, first only, second only, both
SHARE = 0.3  # least share of the fitted models that are wrong about a drawn path
WRONG = {False: "#d55e00", True: "#f0e442"}  # by whether the path is valid: accepted though invalid, or refused
SAMPLES = 12  # paths sampled from a map


def overview(results: Results) -> Figure:
    """Draw one row per user: the image with repairs, true map, each model's map, and the last one on a patterned top.

    The scene is the first one in which the users' true maps differ and each has a path to repair, if there is one.
    Titles give the share of a map that is right.
    """
    drawn, users, shown = results.drawn, results.repaired_users, results.pictured
    differ = np.mean(drawn.truth[users[0]] != drawn.truth[users[-1]], axis=(1, 2)) > LEAST_DIFFERENCE
    starts = results.table("repairs").query("method == 'gradient'").groupby("scene")["user"].nunique()
    place = int((differ + 2 * (starts.reindex(drawn.mapped, fill_value=0) == len(users)).to_numpy()).argmax())
    scene = drawn.mapped[place]
    figure, axes = panels(len(users), 4 + len(shown), 2.15 * (4 + len(shown)), 2.5 * len(users))
    for line, user in zip(axes, users, strict=True):
        traces, truth = _traces(results, user, scene, shown), drawn.truth[user][place]
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[user])
        _draw_repairs(line[0], traces)
        draw_map(line[1], truth)
        line[0].set(title="Bad path, repairs", ylabel=f"{user} user")
        line[1].set_title("Truth")
        maps = [(line[2 + i], v, drawn.maps[v], traces.get(v)) for i, v in enumerate(shown)]
        for panel, variant, by_user, steps in [*maps, (line[-1], shown[-1], drawn.patterned_maps[shown[-1]], None)]:
            draw_map(panel, by_user[user][place], steps)
            panel.set_title(f"{style.label(variant)}: {np.mean((by_user[user][place] > 0.5) == truth):.0%}")
        draw_table(line[-2], drawn.patterned[place])
        line[-2].set_title(f"The same on {results.facts['patterned_top']}")
    handles = [Line2D([], [], color=style.START, linewidth=3, linestyle="--", label="start")]
    handles += [Line2D([], [], color=style.colour(v), linewidth=3, label=style.label(v)) for v in shown]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def widget(results: Results) -> dict[str, Any]:
    """Return the widget's data, ready for JSON.

    `maps` is one grey image, P(valid) from 0 to 255: below one another for each table, user and source in turn, each
    (side, side) with row 0 at `low`. `images` are each scene on its own table top, then on the patterned one.
    """
    drawn, users, models = results.drawn, results.judged_users, results.pictured
    images = [*drawn.images[drawn.mapped], *drawn.patterned]
    tops = [(maps, place) for maps in (drawn.maps, drawn.patterned_maps) for place in range(len(drawn.mapped))]
    maps = [m for by, i in tops for u in users for m in (drawn.truth[u][i], *(by[v][u][i] for v in models))]
    stacked = np.rint(255 * np.concatenate(maps).astype(float)).astype(np.uint8)
    first = _first_control_point(drawn.truth[users[0]][0], *(drawn.maps[v][users[0]][0] for v in models))
    data = {"start": P_INIT.tolist(), "end": P_F.tolist(), "low": Z_LOW, "high": Z_HIGH, "side": stacked.shape[1]}
    data |= {"users": users, "first": first, "sources": ["Truth", *map(style.label, models)], "scenes": drawn.mapped}
    data |= {"images": [_png(fewer_levels(image)[..., ::-1]) for image in images], "maps": _png(stacked)}
    return data | {"palette": [to_hex(hue) for hue in matplotlib.colormaps[style.MAP](np.linspace(0, 1, 9))]}


def _first_control_point(truth: Array, *maps: Array) -> list[float]:
    """Return a control point [m] on the table where models differ: the last one is right, the first one wrong.

    It lies deepest inside such a region; without one it is `ANYWHERE`.
    """
    z, last, first = lattice(len(truth)), maps[-1] > 0.5, maps[0] > 0.5
    on_table = ((z > 0) & (z < 1)).all(-1).reshape(truth.shape)
    depth = distance_transform_edt(np.pad(on_table & (last == truth) & (first != truth), 1))[1:-1, 1:-1]
    return z[int(depth.argmax())].tolist() if depth.any() else ANYWHERE


def _png(pixels: Array) -> str:
    """Return grey or BGR pixels as the data URI of a PNG."""
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()


def steps(results: Results) -> Figure:
    """Draw gradient steps of the paper's model from one start a scene, one each seventh of the way: a row a user."""
    users, of = list(results.users), results.table("repairs")
    of = of[(of["method"] == "same_starts") & (of["variant"] == "full") & (of["seed"] == results.seeds[0])]
    scenes = of["scene"].unique()[:3].tolist()
    titles, names = [f"scene {scene}" for scene in scenes], [f"{user} user" for user in users]
    figure, axes = panels(len(users), len(scenes), 3.2 * len(scenes), 3.3 * len(users), titles, names)
    shades = [to_hex(hue) for hue in matplotlib.colormaps["Blues_r"](np.linspace(0, 0.75, 8))]
    for line, user in zip(axes, users, strict=True):
        starts = of.loc[of["user"] == user, "scene"].to_numpy()
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.images[scene], results.drawn.layouts, scene, results.users[user])
            points = results.paths[f"same_starts-{user}"][starts == scene][0]
            moved = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=-1).cumsum()
            points = points[np.searchsorted(moved, moved[-1] * np.arange(8) / 7)]
            for point, shade in zip(points[1:-1], shades[1:-1], strict=True):
                draw_path(panel, point, shade, 1.4, rim="none")
            draw_path(panel, points[-1], shades[-1])
            draw_path(panel, points[0], shades[0], rim="white")
    ends = (shades[0], 2.5, "start"), (shades[3], 1.4, "steps between"), (shades[-1], 2.5, "end")
    handles = [Line2D([], [], color=shade, linewidth=width, label=name) for shade, width, name in ends]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _traces(results: Results, user: str, scene: int, variants: list[str]) -> dict[str, Array]:
    """Return by variant the control points (step, 2) [m] of the first seed's repair of the user's first invalid path.

    Nothing if no path is invalid there. Which path is first does not depend on its repair.
    """
    rows, seed, made = results.table("repairs").query("method == 'gradient' and user == @user"), results.seeds[0], {}
    starts = rows.loc[rows["scene"] == scene, "start"]
    for variant in variants if len(starts) else ():
        own = rows[(rows["variant"] == variant) & (rows["seed"] == seed)]
        at = np.flatnonzero((own["scene"] == scene) & (own["start"] == starts.min()))
        made[variant] = results.paths[f"{variant}-{user}-s{seed}"][int(at[0])]
    return made


def _draw_repairs(axes: Axes, traces: Mapping[str, Array]) -> None:
    """Draw the starts of repairs (yellow, dashed) and each variant's end, the first ones widest: ends may coincide."""
    for i, (variant, points) in enumerate(traces.items(), start=1):
        rim = {} if i == 1 else {"rim": "none"}
        draw_path(axes, points[-1], style.colour(variant), 2.5 * (len(traces) - i + 1), **rim)
    for points in list(traces.values())[:1]:
        draw_path(axes, points[0], style.START, linestyle=(0, (3, 1.5)))


def one_scene(results: Results) -> Figure:
    """Draw one scene without and with each added item: the image, the truth, and the shown models' maps."""
    drawn, shown = results.drawn, list(results.drawn.added_maps)
    columns = ["as it is", *(f"added {symbol}" for symbol in SYMBOLS)]
    names = ["", *map(style.label, shown)]
    figure, axes = panels(len(names), len(columns), 2.4 * len(columns), 2.5 * len(names), columns, names)
    for i, (top, *below) in enumerate(axes.T):
        draw_table(top, drawn.added_images[i])
        for panel, name in zip(below, shown, strict=True):
            draw_map(panel, drawn.added_maps[name][i])
    return figure


def worst(results: Results) -> Figure:
    """Draw the scenes with most errors: each wrongly judged path of the user with more errors there."""
    scenes, drawn = worst_scenes(results), results.drawn
    figure, axes = panels(1, len(scenes), 2.9 * len(scenes), 3.8)
    judged = results.table("judged")
    judged = judged[(judged["variant"] == failing(results)) & (judged["split"] == "new_items")]
    for panel, (scene, user, top) in zip(axes[0], scenes[["scene", "user", "table_top"]].to_numpy(), strict=True):
        mine = judged[(judged["scene"] == scene) & (judged["user"] == user)]
        draw_table(panel, drawn.images[scene], drawn.layouts, scene, results.users[user])
        wrong = mine[(mine["p"] > 0.5) != mine["valid"]]
        counts = wrong.groupby(["query", "z_x", "z_y", "valid"]).size().reset_index(name="models")
        for path in counts[counts["models"] >= SHARE * mine["seed"].nunique()].itertuples():
            draw_path(panel, np.array([path.z_x, path.z_y]), WRONG[bool(path.valid)], 2.2)
        panel.set(title=f"scene {scene}, {top}", xlabel=f"{user} user")
    names = {False: "accepted, but invalid", True: "rejected, but valid"}
    handles = [Line2D([], [], color=colour, linewidth=3, label=names[kind]) for kind, colour in WRONG.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def who_accepts(results: Results) -> Figure:
    """Draw, for the mapped scenes, which control points are valid to both, one or none of two users."""
    drawn, (first, *_, second) = results.drawn, results.judged_users
    columns = ["truth", *(v for v in results.shown if v in ("full", "clearance"))]
    titles = [f"Table, {first} user’s margins", *map(style.label, columns)]
    names = [f"scene {scene}" for scene in drawn.mapped]
    figure, axes = panels(len(names), len(titles), 2.9 * len(titles), 2.85 * len(names) + 0.5, titles, names)
    for place, (line, scene) in enumerate(zip(axes, drawn.mapped, strict=True)):
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[first])
        for panel, name in zip(line[1:], columns, strict=True):
            maps = drawn.truth if name == "truth" else drawn.maps[name]
            kind = np.asarray(maps[first][place] > 0.5, int) + 2 * np.asarray(maps[second][place] > 0.5, int)
            extent = (Z_LOW, Z_HIGH, Z_LOW, Z_HIGH)
            panel.imshow(kind, cmap=KINDS, vmin=0, vmax=3, origin="lower", extent=extent, interpolation="none")
            outline_table(panel, "white")
    kinds = ["neither", f"{first} only", f"{second} only", "both"]
    handles = [Patch(facecolor=KINDS(i), edgecolor=style.MUTED, label=f"valid for {n}") for i, n in enumerate(kinds)]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def samples(results: Results) -> Figure:
    """Draw control points sampled from those that the paper's model accepts, and their paths, a column a user."""
    drawn, users, rng = results.drawn, list(results.users), np.random.default_rng(0)
    scene, figure, axes = drawn.mapped[0], *panels(2, len(users), 3.4 * len(users), 6.9, [f"{u} user" for u in users])
    for (above, below), user in zip(axes.T, users, strict=True):
        p = drawn.maps["full"][user][0]
        accepted = lattice(len(p))[p.ravel() > 0.5]
        z = accepted[rng.permutation(len(accepted))[:SAMPLES]]
        draw_map(above, p)
        above.plot(*z.T, "o", color="white", markersize=5, markeredgecolor="#111417")
        draw_table(below, drawn.images[scene], drawn.layouts, scene, results.users[user])
        for point, right in zip(z, valid(drawn.layouts[[scene]], z[None], results.users[user])[0], strict=True):
            draw_path(below, point, style.VALID if right else style.INVALID, width=1.6)
    return figure


def demonstrations(results: Results) -> Figure:
    """Draw the first training scenes with each user's demonstrations: valid ones blue, invalid ones orange."""
    users, scenes = results.judged_users, range(len(results.drawn.training))
    figure, axes = panels(len(users), len(scenes), 2.8 * len(scenes), 2.95 * len(users))
    table = results.table("demos")
    table = table[table["seed"] == results.seeds[0]]
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.training[scene])
            rows = table[(table["user"] == user) & (table["scene"] == scene)]
            for x, y, is_valid in rows[["z_x", "z_y", "valid"]].itertuples(index=False):
                draw_path(panel, np.array([x, y]), style.VALID if is_valid else style.INVALID, 1.6)
            panel.set_title(f"{user}, scene {scene}")
    return figure


def graph(_: Results) -> Figure:
    """Draw the paper's cyclic graph and ours: items cause the scene; scene, path and user cause validity.

    Ours has a hidden cause of paths and labels (dashed), and a bar where an added item cuts the arrows into the scene.
    """
    figure, axes = panels(1, 2, 11.0, 3.6, titles=["The paper: a cycle", "Ours"], width_ratios=[2, 3])
    nodes = {"$Z_I$": (2.2, 1.4), "$Z_\\theta$": (2.9, 2.6), "$S$": (2.9, 0.2), "$V$": (4.4, 1.4)}
    words = {"$Z_I$": "scene", "$Z_\\theta$": "path", "$S$": "user", "$V$": "valid"}
    aside = {"$Z_I$": (0.0, -0.36, "right", "top"), "$Z_\\theta$": (0.0, 0.36, "center", "bottom")}
    head: dict[str, Any] = {"color": style.MUTED, "shrinkB": 72 * 0.3, "shrinkA": 72 * 0.3, "linewidth": 1.2}
    middle: dict[str, Any] = {"ha": "center", "va": "center"}

    def node(panel: Axes, name: str, place: tuple[float, float], word: str, line: str = "-") -> None:
        panel.add_patch(Circle(place, 0.3, fill=False, edgecolor=style.INK, linewidth=1.4, linestyle=line))
        panel.text(*place, name, fontsize=13, **middle)
        x, y, ha, va = aside.get(name, (0.4, 0.02, "left", "bottom"))
        panel.text(place[0] + x, place[1] + y, word, ha=ha, va=va, fontsize=10, color=style.MUTED)

    def arrow(panel: Axes, start: tuple[float, float], end: tuple[float, float], **look: Any) -> None:
        panel.annotate("", end, start, arrowprops={"arrowstyle": "-|>"} | head | look)

    cyclic, ours = axes[0]
    for one, other in combinations(nodes.values(), 2):
        arrow(cyclic, one, other, arrowstyle="<|-|>")
    items = {name: (0.2, 2.6 - 2.4 * i / max(len(SYMBOLS) - 1, 1)) for i, name in enumerate(SYMBOLS)}
    for name, place in items.items():
        arrow(ours, place, nodes["$Z_I$"], shrinkA=72 * 0.42)
        box: dict[str, Any] = {"boxstyle": "round", "fc": "none", "ec": style.MUTED}
        ours.text(*place, name, fontsize=11, bbox=box, **middle)
    for name in list(nodes)[:-1]:  # all but V
        arrow(ours, nodes[name], nodes["$V$"])
    hidden = (4.4, 2.9)
    for end in (nodes["$Z_\\theta$"], nodes["$V$"]):
        arrow(ours, hidden, end, linestyle="--")
    node(ours, "$U$", hidden, "hidden", "--")
    ours.plot([1.6, 1.6], [0.9, 1.9], color=style.INK, linewidth=3)
    for panel, left in ((cyclic, 1.7), (ours, -0.5)):
        for name, place in nodes.items():
            node(panel, name, place, words[name])
        panel.set(xlim=(left, 5.5), ylim=(-0.3, 3.4), aspect="equal")
        panel.axis("off")
    return figure
