"""Whom a model blames for a rejected path, and the tables it was asked about."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import draw_path, draw_scene, row_label
from pipeline.report.style import INVALID, MUTED, VALID, colour, marker
from pipeline.report.wording import variant_label

NULLS = {
    "null_random": ("any item", ":"), "null_base_rate": ("most blamed symbol", "--"), "null_nearest": ("nearest", "-"),
}  # fmt: skip

KINDS = {"disagree": "two reasons", "one accepts": "one minds", "model wrong": "wrong blame"}  # of examples


def draw_blame(cells: Mapping[str, dict], variants: list[str], users: list[str], columns: int) -> Figure:
    """A panel per user: how often each variant blames the right item, with its interval; nulls as upright lines.

    cells: variant -> user -> numbers (stage counterfactual).
    """
    rows = -(-len(users) // columns)
    figure = Figure((3.3 * columns + 1.2, 2.0 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, user in zip(axes, users, strict=False):
        for y, variant in enumerate(variants):
            c, shade = cells[variant][user], colour(variant)
            if c is None:
                continue
            for name, (_, style) in NULLS.items():
                ax.plot([c[name]] * 2, [y - 0.4, y + 0.4], color=MUTED, lw=1.2, ls=style)
            if c["ci_low"] is not None:
                ax.plot([c["ci_low"], c["ci_high"]], [y, y], color=shade, lw=1.4)
            if c["blame_right"] is not None:
                ax.plot(c["blame_right"], y, marker(variant), color=shade, ms=5.5)
        ax.set(title=f"{user.capitalize()} user", xlim=(-0.02, 1.03), xlabel="the right item is blamed")
        ax.set_yticks(range(len(variants)), [variant_label(v) for v in variants])
        ax.set_ylim(len(variants) - 0.5, -0.5)
        ax.tick_params(axis="y", length=0)
    handles = [Line2D([], [], color=MUTED, lw=1.2, ls=style) for _, style in NULLS.values()]
    texts = [f"null: {text}" for text, _ in NULLS.values()]
    figure.legend(handles, texts, loc="outside lower center", ncols=3)
    return figure


def draw_examples(
    examples: list[dict],
    whole: UInt8[Array, "example 100 100 3"],
    without: UInt8[Array, "example slot 100 100 3"],
    variant: str,
) -> Figure:
    """A row per example: the scene with its path, then the scene without each of its items.

    Below each picture, by user: whether the path is truly valid there, and the model's P(valid).
    """
    columns = 1 + max(len(e["items"]) for e in examples)
    figure = Figure((1.75 * columns, 2.3 * len(examples)), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.12)  # pyright: ignore[reportCallIssue, reportOptionalMemberAccess]
    axes = figure.subplots(len(examples), columns, squeeze=False)
    for i, (row, example) in enumerate(zip(axes, examples, strict=True)):
        pictures = [whole[i], *without[i, : len(example["items"])]]
        names = ["as it is", *(f"without {name}" for name in _names([item["symbol"] for item in example["items"]]))]
        for ax in row[len(pictures) :]:
            ax.set_visible(False)
        for k, (ax, picture, name) in enumerate(zip(row, pictures, names, strict=False)):
            draw_scene(ax, picture)
            answers = {user: (_at(by["truth"], k), _at(by[variant], k)) for user, by in example["users"].items()}
            valid_to_all = all(truth > 0.5 for truth, _ in answers.values())
            draw_path(ax, np.array(example["z_theta"]), VALID if valid_to_all else INVALID, dashed=not valid_to_all)
            ax.set_title(name, fontsize=8)
            lines = [f"{u}: {'valid' if t > 0.5 else 'invalid'} ({p:.2f})" for u, (t, p) in answers.items()]
            ax.set_xlabel("\n".join(lines), fontsize=7)
        kind = str(example["kind"])
        row_label(row[0], KINDS.get(kind, kind))
    return figure


def _names(symbols: list[str]) -> list[str]:
    """Symbols, numbered where there are several of one."""
    several = {s for s in symbols if symbols.count(s) > 1}
    return [f"{s} {symbols[: k + 1].count(s)}" if s in several else s for k, s in enumerate(symbols)]


def _at(cell: dict, k: int) -> float:
    """P(valid) in the scene as it is (0) or without its k-th item."""
    return cell["p"] if k == 0 else cell["p_without"][k - 1]
