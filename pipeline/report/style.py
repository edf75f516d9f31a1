"""The shared style of all figures: one colour per variant, font sizes, and SVG files with reproducible bytes."""

import io
import re
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from pipeline.legend import INVALID, MAP, START, VALID, label  # noqa: F401  # the rest of the style

INK, MUTED, RULE = "#1b1f24", "#5d6670", "#d4d8dd"
TRAIN, UNSEEN = "#009e73", "#d55e00"  # green and red as in the paper, in hues of Okabe and Ito
COLOURS = {  # hues of Okabe and Ito; the paper's model and its ablations share blue
    "full": "#0072b2",
    "ae": "#56b4e9",
    "classifier": "#009e73",
    "irl_maxent": "#e69f00",
    "irl_ranked": "#d55e00",
    "clearance": "#cc79a7",
    "paper": "#f0e442",
}
MARKERS = {"full": "o", "ae": "s", "classifier": "^", "irl_maxent": "v", "irl_ranked": "D", "clearance": "P"}
RC: dict[Any, Any] = {
    "svg.hashsalt": "causal-specifications",
    "svg.fonttype": "path",
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "legend.frameon": False,
    "grid.color": RULE,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}
THEME = """<style>
:root { --ink: #1b1f24; --muted: #5d6670; --rule: #d4d8dd; }
@media screen and (prefers-color-scheme: dark) { :root { --ink: #e7eaed; --muted: #a3acb6; --rule: #3a4148; } }
</style>"""


def colour(name: str) -> str:
    """Return a variant's colour, the same in all figures; grey for baselines and unknown variants."""
    return COLOURS.get(name, MUTED)


def marker(name: str) -> str:
    """Return a variant's marker, so that colour is never the only distinction."""
    return MARKERS.get(name, "X")


def svg(figure: Figure) -> str:
    """Return a figure as SVG text with reproducible bytes; its text colour follows the light or dark scheme."""
    buffer = io.StringIO()
    with matplotlib.rc_context(RC):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = re.sub(r"<metadata>.*?</metadata>", "", buffer.getvalue(), flags=re.DOTALL)
    text = re.sub(r"image-rendering:[^;\"]*;?", "", text)  # browsers then interpolate enlarged images
    text = re.sub(r'( d="|\b[xy]="|translate\()([^")]*)', lambda part: part[1] + _rounded(part[2]), text)
    for hexadecimal, name in ((INK, "ink"), (MUTED, "muted"), (RULE, "rule")):
        text = text.replace(hexadecimal, f"var(--{name})")
    return re.sub(r"(<svg[^>]*>)", lambda tag: tag[1] + "\n" + THEME, text, count=1)


def _rounded(places: str) -> str:
    """Return coordinates rounded to a hundredth of a point."""
    return re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), places)
