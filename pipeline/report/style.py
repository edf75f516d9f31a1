"""Looks shared by every figure: colours told apart by everyone, and files with the same bytes every time."""

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox

INK, MUTED, RULE, PAPER = "#1b1f24", "#666e78", "#d4d8dd", "#ffffff"
CHALK = "#fefefe"  # white on a photograph; never turned dark
SOOT = "#111417"  # black on a photograph; never turned light
VALID, INVALID = "#0072b2", "#d55e00"  # Okabe and Ito's blue and vermilion
THEME = {INK: "var(--ink)", MUTED: "var(--muted)", RULE: "var(--rule)", PAPER: "var(--paper)"}
_COLOURS = {
    "full": "#0072b2",
    "ae": "#4aa3d8",
    "classifier": "#009e73",
    "irl_maxent": "#d99000",
    "irl_ranked": "#d55e00",
    "path": "#b8609a",  # Okabe and Ito's purple, darkened
    "null_nearest": MUTED,
    "null_position": MUTED,
}
_MARKERS = {"full": "o", "ae": "s", "classifier": "^", "irl_maxent": "v", "irl_ranked": "D", "path": ">"}
_LINES = {"null_nearest": (0, (1.2, 1.6)), "null_position": (0, (5, 2.5))}
_OTHER = "#8a6d3b"  # brown: a variant this file does not know
PLACES = 9  # decimals of where a figure's axes are, as shares of its width and height
LETTER = "DejaVu"  # with what the ids of letters' outlines begin: their font
RC: dict[Any, Any] = {
    "svg.hashsalt": "causal-specifications",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType: publishers refuse matplotlib's default, Type 3
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
}


def colour(variant: str) -> str:
    """A variant's colour, the same in every figure."""
    return _COLOURS.get(variant, _OTHER)


def marker(variant: str) -> str:
    """A variant's marker, so that colour is never alone."""
    return _MARKERS.get(variant, "X")


def line(variant: str):
    """A variant's line style: nulls are broken lines."""
    return _LINES.get(variant, "-")


def svg(draw: Callable[[], Figure]) -> str:
    """The figure `draw` makes, as SVG text with the same bytes every time; places to a hundredth of a point."""
    text = _saved(draw, format="svg", metadata={"Date": None, "Creator": None}).decode()
    return re.sub(r'( d="|\b[xy]="|translate\()([^")]*)', lambda place: place[1] + _terse(place[2]), text)


def _terse(places: str) -> str:
    """Coordinates and a path's commands in as few characters as a hundredth of a point needs."""
    rounded = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), places)
    return re.sub(r"\s*([A-Za-z])\s*", r"\1", rounded)


def pdf(draw: Callable[[], Figure]) -> bytes:
    """The figure `draw` makes, as PDF for a paper: vectors, embedded fonts, the same bytes every time."""
    return _saved(draw, format="pdf", metadata={"CreationDate": None, "Creator": None, "Producer": None})


def png(draw: Callable[[], Figure], dpi: int) -> bytes:
    """The figure `draw` makes, as PNG with the same bytes every time."""
    return _saved(draw, format="png", dpi=dpi, metadata={"Software": None})


def _saved(draw: Callable[[], Figure], **options: Any) -> bytes:
    with matplotlib.rc_context(RC):
        figure, buffer = draw(), io.BytesIO()
        if isinstance(engine := figure.get_layout_engine(), ConstrainedLayoutEngine):
            figure.set_layout_engine(_Rounded(**engine.get()))
        figure.savefig(buffer, **options)
    return buffer.getvalue()


class _Rounded(ConstrainedLayoutEngine):
    """Constrained layout without its last digits: its solver calculates in the order of addresses in memory."""

    def execute(self, fig: Figure) -> None:
        super().execute(fig)
        for axes in fig.axes:
            axes.set_position(Bbox(axes.get_position(original=True).get_points().round(PLACES)))


def inline(text: str, name: str) -> str:
    """An SVG for the inside of a page: ids of its own, colours that follow the page, size left to the page.

    The ids of letters stay as they are: every figure has the same outlines under them.
    """
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    needed = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    text = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in needed else "", text)
    text = re.sub(rf'( id="|href="#|url\(#)(?!{LETTER})', rf"\1{name}-", text)
    for hexadecimal, variable in THEME.items():
        text = text.replace(hexadecimal, variable)
    width, height = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text).groups()  # pyright: ignore
    head = f'<svg viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg" aria-hidden="true" '
    head += f'xmlns:xlink="http://www.w3.org/1999/xlink" style="max-width: {float(width) * 4 / 3:.0f}px">'
    return re.sub(r"^<svg[^>]*>", head, text)
