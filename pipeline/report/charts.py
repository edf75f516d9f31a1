"""Charts of a table of results by its columns: lines with bands, and intervals, in panels with one legend.

Both kinds take `data`, `table`, `x`, `y` and these options. low, high: the columns of an interval's ends. With several
y there is a panel for each; low and high then are as many, or the part of their names after `y_`. panel: a column with
a panel for each value, or two for rows and columns of panels. hue: a column with a series for each value. where: as in
`rows`; a list in it orders panels and series. words: what stands for the values of a column. titles: of the panels of
each y. unit: what numbers are multiplied by. gaps: columns with numbers that may be missing, and are not drawn then.
Whatever else `Axes.set` knows holds for each panel. InputError for another number that is missing or not finite.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.style import INK, MUTED, RULE, label, looks, of_series, toggles
from pipeline.report.tables import Words, beside, check_finite, chosen, in_words

STYLES = ("-.", ":", "--", "-")  # of lines of reference
MAX_TICKS = 20  # the most values of x that each get a tick and a mark
SHORT = 4  # digits of a tick
WRAP = 4  # the most panels in a row
Table = str | Callable[[Any], pd.DataFrame]
Names = str | Sequence[str]


def curves(
    data: Any, table: Table, x: str, y: Names, unit=1, x_unit=1, log=False, reference=None, diagonal="", joined=True,
    **options: Any,
) -> Figure:  # fmt: skip
    """Return lines of y over x, with a band from low to high, a line for each value of `hue`.

    x_unit: what x is multiplied by. log: a logarithmic x. reference: horizontal lines, by name. diagonal: the name of a
    line on which y is x. joined: false if a series that skips an x of its panel has marks without a line.
    """
    chart = _Chart(data, table, y, **options)
    text = not pd.api.types.is_numeric_dtype(chart.frame[x])
    for axes, rows, column, ends in chart.grid(4.4, sharex=not text, sharey=chart.shared):
        values = list(dict.fromkeys(rows[x]))
        for name, shown, own, look in chart.series(rows):
            own = own if text else own.sort_values(x, kind="stable")
            places = np.array([values.index(v) for v in own[x]]) if text else x_unit * own[x].to_numpy(float)
            middle = unit * own[column].to_numpy(float)
            if not joined and set(rows[x]) - set(own[x]):
                look |= {"linestyle": "", "marker": look["marker"] or "o"}
            if ends:
                low, high = (unit * own[end].to_numpy(float) for end in ends)
                band = {"color": look["color"], "alpha": 0.13, "linewidth": 0}
                draw = axes.fill_between if look["linestyle"] else axes.vlines
                of_series(draw(places, low, high, **band if look["linestyle"] else {"color": look["color"]}), name)
            of_series(axes.plot(places, middle, label=shown, linewidth=2, **look)[0], name)
            mark = {"color": look["color"], "markersize": 11 if name == "paper" else 6}
            for place, number, value in zip(places, middle, own[x], strict=True) if len(places) <= MAX_TICKS else ():
                dot = axes.plot(place, number, look["marker"] or ".", **mark)[0]
                at = chart.word(x, value) if text else f"{place:g} {chart.xlabel}"
                of_series(dot, name, f"{shown}, {at}: {_said(chart.ylabel, number)}")
        if diagonal:
            axes.axline((0, 0), slope=unit / x_unit, color=INK, linewidth=1.2, linestyle=":", label=diagonal)
        for (shown, level), line in zip((reference or {}).items(), STYLES, strict=False):
            axes.axhline(unit * level, color=MUTED, linewidth=1, linestyle=line, label=shown)
        if log:
            axes.set_xscale("log")
            axes.minorticks_off()
        if text:
            axes.set_xticks(range(len(values)), [chart.word(x, value) for value in values])
        else:
            axes.xaxis.set_major_formatter(lambda number, _: f"{number:g}")
            if len(values) <= MAX_TICKS and all(len(f"{x_unit * value:g}") <= SHORT for value in values):
                axes.set_xticks([x_unit * value for value in values])
        axes.grid(axis="y")
    return chart.finished()


def bars(data: Any, table: Table, x: str, y: Names, unit=1, truth="", band=0, note="", **options: Any) -> Figure:
    """Return y with the interval from low to high, horizontal, a group for each value of x and a mark for each `hue`.

    If hue is x, each group has its own colour. truth: a column whose number is a line across its group. band: the
    numbers up to this far from 0 are shaded. note: a column whose word, if any, is written beside its group. xlabel is
    the name of the numbers.
    """
    chart = _Chart(data, table, y, **options)
    groups, alone = list(dict.fromkeys(chart.frame[x])), chart.hue == x
    names = [name for name, *_ in chart.series(chart.frame)]
    height = 1.4 + len(groups) * max(0.45, 0.17 * len(names) * (not alone))
    for axes, rows, column, ends in chart.grid(height, sharex=chart.shared, sharey=True):
        if band:
            axes.axvspan(-band, band, color=RULE, alpha=0.5, linewidth=0)
        for name, shown, own, look in chart.series(rows):
            offset = 0.0 if alone else 0.36 * ((2 * names.index(name) + 1) / len(names) - 1)
            look |= {"linestyle": "", "marker": look["marker"] or "X", "markersize": 12 if name == "paper" else 7}
            at = np.array([groups.index(group) for group in own[x]]) + offset
            middle, *reach = (unit * own[part].to_numpy(float) for part in (column, *ends))
            if ends:
                of_series(axes.hlines(at, *reach, color=look["color"], linewidth=2), name)
            for i, (place, number) in enumerate(zip(at, middle, strict=True)):
                spread = f" ({reach[0][i]:.3g} to {reach[1][i]:.3g})" if ends else ""
                mark = axes.plot(number, place, label=None if i else shown, **look)[0]
                said = f"{_said(chart.xlabel, number)}{spread}"
                of_series(mark, name, f"{shown}, {chart.word(x, own[x].iloc[i])}: {said}")
        if truth:
            for group, number in rows.drop_duplicates(x)[[x, truth]].itertuples(index=False):
                place, shown = groups.index(group), "Truth" if group == rows[x].iloc[0] else ""
                axes.vlines(unit * number, place - 0.42, place + 0.42, color=INK, linewidth=1.6, label=shown)
        for group, word in rows[[x, note]].itertuples(index=False) if note else ():
            axes.annotate(word, (1.02, groups.index(group)), xycoords=("axes fraction", "data"), va="center")
        axes.set_yticks(range(len(groups)), [chart.word(x, group) for group in groups])
        axes.set_ylim(len(groups) - 0.5, -0.5)
        axes.grid(axis="x")
    return chart.finished(legend=not alone)


def _said(label: str, number: float) -> str:
    return f"{number:.1f}\u00a0%" if "per cent" in label else f"{number:.3g}"


class _Chart:
    """Hold what both kinds of chart share: rows, panels, series, labels and legend."""

    def __init__(
        self, data: Any, table: Table, y: Names, low: Names = "", high: Names = "", panel: Names = "", hue: str = "",
        where: Mapping[str, Any] | None = None, words: Mapping[str, Words] | None = None,
        titles: Mapping[str, str] | None = None, gaps: Collection[str] = (), xlabel: str = "", ylabel: str = "",
        **others: Any,
    ):  # fmt: skip
        self.frame = frame = chosen(data, table, where)
        self.words, self.titles, self.hue, self.others = words or {}, titles or {}, hue, others
        self.xlabel, self.ylabel, self.drawn = xlabel, ylabel, list[Axes]()
        self.split = [panel] * bool(panel) if isinstance(panel, str) else list(panel)
        self.ys = [y] if isinstance(y, str) else list(y)
        parts = [[part] * len(self.ys) if isinstance(part, str) else part for part in (low, high)]
        named = [[beside(frame, y, part) for y, part in zip(self.ys, part, strict=True)] for part in parts]
        self.ends = [tuple(filter(None, ends)) for ends in zip(*named, strict=True)]
        drawn = {*self.ys, *(name for ends in self.ends for name in ends)}
        check_finite(frame, getattr(table, "__name__", str(table)), sorted(drawn - set(gaps)))
        self.looks = looks(list(map(str, dict.fromkeys(frame[hue]))) if hue else [""])
        self.shared = True if len(self.ys) == 1 else "row" if self.split else False  # the axis of the numbers

    def word(self, column: str, value: Any) -> str:
        """Return what stands for a value of a column; names of variants and splits need no words."""
        return str(in_words(value, self.words.get(column, label if isinstance(value, str) else None)))

    def grid(self, height: float, **shared: Any) -> list[tuple[Axes, pd.DataFrame, str, tuple]]:
        """Return the axes of each panel with its rows, and the columns of its numbers and of their interval's ends."""
        parts: list[tuple[list[str], pd.DataFrame]] = [([], self.frame)]
        for column in self.split:
            values = list(dict.fromkeys(self.frame[column]))
            parts = [([*names, self.word(column, v)], rows[rows[column] == v]) for names, rows in parts for v in values]
        made = [(names, rows, y, e) for y, e in zip(self.ys, self.ends, strict=True) for names, rows in parts]
        across = -(-len(made) // -(-len(made) // WRAP))
        if len(self.split) > 1 or (self.split and len(self.ys) > 1):
            across = self.frame[self.split[-1]].nunique()
        down = -(-len(made) // across)
        self.figure, axes = panels(down, across, {1: 8.4, 2: 12.0}.get(across, 12.6), down * height, **shared)
        for empty in axes.flat[len(made) :]:
            empty.set_visible(False)
        self.drawn = list(axes.flat[: len(made)])
        for one, (names, _, y, _) in zip(self.drawn, made, strict=True):
            one.set_title(", ".join([*names, *([self.titles[y]] if y in self.titles else [])]))
        for above in self.drawn[len(made) - across :]:
            above.tick_params(labelbottom=True)
        return [(one, *panel[1:]) for one, panel in zip(self.drawn, made, strict=True)]

    def series(self, rows: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame, dict[str, Any]]]:
        """Yield id, name, rows, and colour, marker and line of each series in a panel, in the whole table's order."""
        if not self.hue:
            yield "all", "", rows, dict(self.looks[""])
            return
        for value in dict.fromkeys(self.frame[self.hue]):
            own = rows[rows[self.hue] == value]
            if len(own):
                yield str(value), self.word(self.hue, value), own, dict(self.looks[str(value)])

    def finished(self, legend: bool = True) -> Figure:
        """Label the axes, and draw one legend below, whose names show and hide their series; return the figure."""
        places: list[Any] = [axes.get_subplotspec() for axes in self.drawn]
        across = max(place.colspan.stop for place in places)
        for axes, place in zip(self.drawn, places, strict=True):
            axes.set(**self.others)
            if place.is_first_col():
                axes.set_ylabel(self.ylabel)
        for axes in self.drawn[-across:]:
            axes.set_xlabel(self.xlabel)
        handles = [pair for axes in self.drawn for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
        first = {name: handle for handle, name in reversed(handles)}
        named = {name: first[name] for _, name in handles}
        if set(named) - {""} and legend:
            columns = -(-len(named) // -(-len(named) // (2 + across)))
            box = self.figure.legend(named.values(), named, loc="outside lower center", ncols=columns, fontsize=10)
            ids = {shown: name for name, shown, *_ in self.series(self.frame)}
            for text in box.get_texts():
                if text.get_text() in ids:
                    toggles(text, ids[text.get_text()])
        return self.figure
