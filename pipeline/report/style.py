"""The shared style of all figures: one colour per variant, font sizes, and SVG files with reproducible bytes."""

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from pipeline.legend import INVALID, MAP, START, VALID, label  # noqa: F401  # the rest of the style

SCRIPT, CHART, THEME = (
    Path(__file__).with_name(name).read_text(encoding="utf-8") for name in ("chart.js", "chart.css", "theme.css")
)
INK, MUTED, RULE = "#1b1f24", "#5d6670", "#d4d8dd"
COLOURS = {  # hues of Okabe and Ito; the paper's model and its ablations share blue
    "full": "#0072b2",
    "ae": "#56b4e9",
    "classifier": "#009e73",
    "irl_maxent": "#e69f00",
    "irl_ranked": "#d55e00",
    "clearance": "#cc79a7",
    "paper": "#f0e442",
    "clearance_margin": INK,
    "ideal": INK,
    "truth": INK,
}
# so that colour is never the only distinction
MARKERS = {"full": "o", "ae": "s", "classifier": "^", "irl_maxent": "v", "irl_ranked": "D", "clearance": "P"}
MARKERS |= {"paper": "*"}
LINES = {"position_only": ":", "blind": ":", "ideal": "--"}  # of those that are no models: grey but for `ideal`
LINES |= dict.fromkeys(("nearest_demonstration", "constant_detour", "random_path"), "--") | {"paper": ""}
RC: dict[Any, Any] = {
    "svg.hashsalt": "causal-specifications",
    "svg.fonttype": "path",
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "axes.titlesize": 11,
    "legend.frameon": False,
    "grid.color": RULE,
}
RC |= dict.fromkeys(("axes.spines.top", "axes.spines.right"), False)
RC |= dict.fromkeys(("axes.facecolor", "figure.facecolor", "savefig.facecolor"), "none")
RC |= dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), MUTED)
RC |= dict.fromkeys(("text.color", "axes.labelcolor", "axes.titlecolor", "xtick.labelcolor", "ytick.labelcolor"), INK)


def colour(name: str) -> str:
    """Return a variant's colour, the same in all figures; grey for baselines and unknown variants."""
    return COLOURS.get(name, MUTED)


def looks(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return colour, marker and line of each series; names that are no variants take the hues and markers in turn."""
    known = [name for name in names if name in COLOURS or name in LINES or not name]
    spare = [name for name in list(COLOURS)[:6] if name not in known] * len(names)
    stands_for = {name: name for name in known}
    stands_for |= dict(zip((name for name in names if name not in known), spare, strict=False))
    made = {}
    for name, as_if in stands_for.items():
        hue, marker = INK if name in ("", "paper") else colour(as_if), MARKERS.get(as_if, "" if name else "o")
        made[name] = {"color": hue, "marker": marker, "linestyle": LINES.get(as_if, "-")}
    return made


def of_series(artist: Artist, name: str, value: str = "") -> None:
    """Mark an artist as a part of a series, which a legend entry hides, with the value shown under the pointer."""
    artist.set_gid(f"series:{name}|{value}")


def toggles(artist: Artist, name: str) -> None:
    """Mark an artist as the button that shows and hides a series."""
    artist.set_gid(f"toggle:{name}|{label(name)}")


def svg(figure: Figure) -> str:
    """Return a figure as SVG text with reproducible bytes; its text colour follows the light or dark scheme.

    Charts with series carry the script chart.js.
    """

    def rounded(number: re.Match) -> str:
        return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")  # a hundredth of a point

    buffer = io.StringIO()
    with matplotlib.rc_context(RC):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = re.sub(r"<metadata>.*?</metadata>", "", buffer.getvalue(), flags=re.DOTALL)
    text = re.sub(r"image-rendering:[^;\"]*;?", "", text)  # browsers then interpolate enlarged images
    text = re.sub(r'( d="|\b[xy]="|translate\()[^")]*', lambda part: re.sub(r"-?\d+\.\d+", rounded, part[0]), text)
    for hexadecimal, name in ((INK, "ink"), (MUTED, "muted"), (RULE, "rule")):
        text = text.replace(hexadecimal, f"var(--{name})")
    text, count = re.subn(
        r'<g id="(series|toggle):([^|"]+)\|([^"]*)">', r'<g class="\1" data-series="\2"><title>\3</title>', text
    )
    text = text.replace("<title></title>", "")
    css = f"\n<style>\n{THEME}{CHART * (count > 0)}</style>"
    text = re.sub(r"(<svg[^>]*>)", lambda tag: tag[1] + css, text, count=1)
    return text.replace("</svg>", f"<script><![CDATA[\n{SCRIPT}]]></script>\n</svg>") if count else text
