"""Accuracy against the strength of what is worse than in training, and what each disturbance looks like."""

from collections.abc import Mapping

from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import bare
from pipeline.report.style import colour, line, marker
from pipeline.report.wording import disturbance_axis, strength_label, variant_label

COLUMNS = 2  # narrow enough for a phone
MARGIN = 10  # pixels of a small picture's edge that are left out: no item's middle lies there
STEP = 4  # between the grey levels of a small picture: finer ones are not seen, and take twice the room


def draw(found: Mapping, variants: list[str]) -> Figure:
    """A panel per disturbance: mean accuracy without it (at the left) and at each strength.

    found: what stage robustness writes; variants: the models, and the null.
    """
    rows = -(-len(found["order"]) // COLUMNS)
    figure = Figure((4.4, 1.6 * rows + 0.9), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, sharey=True, squeeze=False).ravel()
    handles: dict = {}
    for ax, name in zip(axes, found["order"], strict=False):
        levels = found["disturbed"][name]
        for variant in variants:
            handles[variant_label(variant)] = _line(ax, found["undisturbed"]["models"], levels, variant)
        ax.set_title(disturbance_axis(name), loc="left", fontsize=8)
        ax.set_xticks(range(len(levels) + 1), ["–", *(strength_label(name, level["strength"]) for level in levels)])
        ax.set_yticks([0.5, 0.75, 1.0])
        ax.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
        ax.tick_params(labelsize=7, left=False, bottom=False)
        ax.grid(axis="y")
    for ax in axes[len(found["order"]) :]:
        ax.set_visible(False)
    figure.supylabel("paths judged rightly", fontsize=8)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2, handlelength=2.4)
    return figure


def _line(ax: Axes, as_is: Mapping, levels: list[dict], variant: str):
    """One variant where it was asked, and its key; table tops have no order and are not joined."""
    at = [0, *(i for i, level in enumerate(levels, 1) if variant in level["models"])]
    scores = [as_is[variant], *(levels[i - 1]["models"][variant] for i in at[1:])]
    mean = [score["accuracy"]["mean"] for score in scores]
    null, ordered = variant.startswith("null"), not isinstance(levels[0]["strength"], str)
    style = {"color": colour(variant), "marker": None if null else marker(variant), "ms": 3.4, "lw": 1.2}
    if len(at) > 1:
        ax.plot(at, mean, ls=line(variant) if ordered or null else "", **style)
    return Line2D([], [], ls=line(variant), **style)


def draw_examples(examples: Mapping[str, UInt8[Array, "100 100 3"]], names: Mapping[str, str]) -> Figure:
    """One scene as it is and under each disturbance; names: what is written above each."""
    rows = -(-len(examples) // COLUMNS)
    figure = Figure((1.55 * COLUMNS, 1.75 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for ax in axes[len(examples) :]:
        ax.set_visible(False)
    for ax, (name, picture) in zip(axes, examples.items(), strict=False):
        ax.imshow(picture[MARGIN:-MARGIN, MARGIN:-MARGIN] // STEP * STEP, interpolation="none")
        bare(ax)
        ax.set_title(names[name], fontsize=7)
    return figure
