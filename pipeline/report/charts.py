"""Charts of a table of results by its columns: lines with bands, and intervals, in panels with one legend."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.style import INK, MUTED, RULE, label, looks, of_series, toggles
from pipeline.report.tables import Words, beside, check_finite, chosen, in_words

STYLES = ("-", "--", ":", "-.")
MAX_TICKS = 20  # the most values of x that each get a tick and a mark
SHORT = 4  # digits of a tick
WRAP = 4  # the most panels in a row


@dataclass(frozen=True)
class Panel:
    """A panel: its title, its rows of the table, and the columns of the numbers drawn and of their interval's ends."""

    title: str
    rows: pd.DataFrame
    y: str
    ends: tuple[str, str] | None


@dataclass(frozen=True)
class Series:
    """A series in a panel: its id, its name in the legend, its rows, and its colour, marker and line."""

    id: str
    name: str
    rows: pd.DataFrame
    look: dict[str, Any]

    def marks(self, artist: Artist, value: str = "") -> None:
        """Mark a part of the series, which the legend hides, with its value under the pointer."""
        of_series(artist, self.id, f"{self.name}, {value}" if value else "")


def curves(
    data: Any,
    table: str | Callable[[Any], pd.DataFrame],
    x: str,
    y: str | Sequence[str],
    low: str | Sequence[str] = "",
    high: str | Sequence[str] = "",
    panel: str | Sequence[str] = "",
    hue: str = "",
    style: str = "",
    where: Mapping[str, Any] | None = None,
    words: Mapping[str, Words] | None = None,
    titles: Mapping[str, str] | None = None,
    unit: int | float = 1,
    x_unit: int | float = 1,
    log: bool = False,
    reference: Mapping[str, int | float] | None = None,
    diagonal: str = "",
    gaps: Collection[str] = (),
    xlabel: str = "",
    ylabel: str = "",
    **others: Any,
) -> Figure:
    """Return lines of y over x, with a band from low to high, a line for each value of `hue`.

    table, where: as in `rows`; a list in `where` orders panels and series. y: a column, or several with a panel each;
    low and high then are as many, or the part of their names after `y_`. panel: a column with a panel for each value,
    or two for rows and columns of panels. style: a column whose values are drawn as full, broken and dotted lines.
    words: what stands for the values of columns x, panel, hue and style. titles: of the panels of each y. unit, x_unit:
    what numbers are multiplied by. log: a logarithmic x. reference: horizontal lines, by name. diagonal: the name of a
    line on which y is x. gaps: columns with numbers that may be missing, and are not drawn then. others: what else
    `Axes.set` knows, of each panel. Raise InputError for another number that is missing or not finite.
    """
    made = _Chart(data, table, y, low, high, panel, hue, style, where, words or {}, titles or {}, gaps)
    text = made.frame[x].dtype == object or isinstance(made.frame[x].dtype, pd.StringDtype)
    figure, axes = made.grid(sharex=not text, sharey=made.shared)
    for one, of in axes:
        values = list(dict.fromkeys(of.rows[x]))
        for series in made.series(of.rows):
            rows = series.rows if text else series.rows.sort_values(x, kind="stable")
            places = np.array([values.index(v) for v in rows[x]]) if text else x_unit * rows[x].to_numpy(float)
            middle = unit * rows[of.y].to_numpy(float)
            if of.ends:
                low_end, high_end = (unit * rows[end].to_numpy(float) for end in of.ends)
                if series.look["linestyle"]:
                    band = one.fill_between(
                        places, low_end, high_end, color=series.look["color"], alpha=0.13, linewidth=0
                    )
                else:
                    band = one.vlines(places, low_end, high_end, color=series.look["color"])
                series.marks(band)
            series.marks(one.plot(places, middle, label=series.name, linewidth=2, **series.look)[0])
            size = 11 if series.id == "paper" else 6
            if len(places) <= MAX_TICKS:
                for place, number, value in zip(places, middle, rows[x], strict=True):
                    mark = one.plot(
                        place, number, series.look["marker"] or ".", color=series.look["color"], markersize=size
                    )[0]
                    series.marks(mark, f"{made.word(x, value)}: {number:.3g}")
        if diagonal:
            one.axline((0, 0), slope=unit / x_unit, color=INK, linewidth=1.2, linestyle=":", label=diagonal)
        for (name, level), line in zip((reference or {}).items(), STYLES[::-1], strict=False):
            one.axhline(unit * level, color=MUTED, linewidth=1, linestyle=line, label=name)
        if log:
            one.set_xscale("log")
            one.minorticks_off()
        if text:
            one.set_xticks(range(len(values)), [made.word(x, value) for value in values])
        else:
            one.xaxis.set_major_formatter(lambda number, _: f"{number:g}")
            if len(values) <= MAX_TICKS and all(len(f"{x_unit * value:g}") <= SHORT for value in values):
                one.set_xticks([x_unit * value for value in values])
        one.grid(axis="y")
    made.finish(figure, axes, xlabel, ylabel, **others)
    return figure


def bars(
    data: Any,
    table: str | Callable[[Any], pd.DataFrame],
    x: str,
    y: str | Sequence[str],
    low: str | Sequence[str] = "",
    high: str | Sequence[str] = "",
    panel: str | Sequence[str] = "",
    hue: str = "",
    where: Mapping[str, Any] | None = None,
    words: Mapping[str, Words] | None = None,
    titles: Mapping[str, str] | None = None,
    unit: int | float = 1,
    truth: str = "",
    band: int | float = 0,
    gaps: Collection[str] = (),
    xlabel: str = "",
    ylabel: str = "",
    **others: Any,
) -> Figure:
    """Return y with the interval from low to high, horizontal, a group for each value of x and a mark for each `hue`.

    If hue is x, each group has its own colour.
    truth: a column whose number is a line across its group. band: the numbers up to this far from 0 are shaded. All
    else is as in `curves`; xlabel is the name of the numbers.
    """
    made = _Chart(data, table, y, low, high, panel, hue, "", where, words or {}, titles or {}, gaps)
    groups = list(dict.fromkeys(made.frame[x]))
    names = [series.id for series in made.series(made.frame)]
    figure, axes = made.grid(
        1.4 + len(groups) * max(0.45, 0.17 * len(names) * (hue != x)), sharex=made.shared, sharey=True
    )
    for one, of in axes:
        if band:
            one.axvspan(-band, band, color=RULE, alpha=0.5, linewidth=0)
        for series in made.series(of.rows):
            offset = 0.36 * ((2 * names.index(series.id) + 1) / len(names) - 1) if hue != x else 0.0
            look = series.look | {
                "linestyle": "",
                "marker": series.look["marker"] or "X",
                "markersize": 12 if series.id == "paper" else 7,
            }
            at = np.array([groups.index(group) for group in series.rows[x]]) + offset
            middle = unit * series.rows[of.y].to_numpy(float)
            ends = [unit * series.rows[end].to_numpy(float) for end in of.ends] if of.ends else []
            if ends:
                series.marks(one.hlines(at, *ends, color=look["color"], linewidth=2))
            for i, (place, number) in enumerate(zip(at, middle, strict=True)):
                spread = f" ({ends[0][i]:.3g} to {ends[1][i]:.3g})" if ends else ""
                group = made.word(x, series.rows[x].iloc[i])
                mark = one.plot(number, place, label=None if i else series.name, **look)[0]
                series.marks(mark, f"{group}: {number:.3g}{spread}")
        if truth:
            for group, number in of.rows.drop_duplicates(x)[[x, truth]].itertuples(index=False):
                y_at, name = groups.index(group), "Truth" if group == of.rows[x].iloc[0] else ""
                one.vlines(unit * number, y_at - 0.42, y_at + 0.42, color=INK, linewidth=1.6, label=name)
        one.set_yticks(range(len(groups)), [made.word(x, group) for group in groups])
        one.set_ylim(len(groups) - 0.5, -0.5)
        one.grid(axis="x")
    made.finish(figure, axes, xlabel, ylabel, legend=hue != x, **others)
    return figure


class _Chart:
    """What the two kinds of chart share: rows, panels, series, labels and legend."""

    def __init__(
        self,
        data: Any,
        table: str | Callable[[Any], pd.DataFrame],
        y: str | Sequence[str],
        low: str | Sequence[str],
        high: str | Sequence[str],
        panel: str | Sequence[str],
        hue: str,
        style: str,
        where: Mapping[str, Any] | None,
        words: Mapping[str, Words],
        titles: Mapping[str, str],
        gaps: Collection[str],
    ):
        self.frame = frame = chosen(data, table, where)
        self.words, self.titles, self.columns = words, titles, [name for name in (hue, style) if name]
        self.split = [panel] * bool(panel) if isinstance(panel, str) else list(panel)
        self.ys = [y] if isinstance(y, str) else list(y)
        parts = [[part] * len(self.ys) if isinstance(part, str) else list(part) for part in (low, high)]
        named = [[beside(frame, y, part) for y, part in zip(self.ys, part, strict=True)] for part in parts]
        self.ends = [(low, high) if low and high else None for low, high in zip(*named, strict=True)]
        drawn = {*self.ys, *(name for ends in self.ends for name in ends or ())}
        check_finite(frame, getattr(table, "__name__", str(table)), sorted(drawn - set(gaps)))
        hues = list(map(str, dict.fromkeys(frame[hue]))) if hue else [""]
        self.shared = True if len(self.ys) == 1 else "row" if self.split else False  # the axis of the numbers
        self.looks = looks(hues)
        self.lines = dict(zip(dict.fromkeys(frame[style]), STYLES, strict=False)) if style else {}

    def word(self, column: str, value: Any) -> str:
        """Return what stands for a value of a column; names of variants and splits need no words."""
        return str(in_words(value, self.words.get(column, label if isinstance(value, str) else None)))

    def panels(self) -> tuple[list[Panel], int]:
        """Return the panels, row by row, and how many are in a row."""
        parts: list[tuple[list[str], pd.DataFrame]] = [([], self.frame)]
        for column in self.split:
            values = list(dict.fromkeys(self.frame[column]))
            parts = [([*names, self.word(column, v)], rows[rows[column] == v]) for names, rows in parts for v in values]
        made = [
            Panel(", ".join([*names, *([self.titles[y]] if y in self.titles else [])]), rows, y, ends)
            for y, ends in zip(self.ys, self.ends, strict=True)
            for names, rows in parts
        ]
        if len(self.split) > 1 or (self.split and len(self.ys) > 1):
            return made, self.frame[self.split[-1]].nunique()
        return made, -(-len(made) // -(-len(made) // WRAP))

    def grid(self, height: float = 4.4, **shared: Any) -> tuple[Figure, list[tuple[Axes, Panel]]]:
        """Return a figure with its panels, and their axes."""
        made, across = self.panels()
        down = -(-len(made) // across)
        figure, axes = panels(down, across, {1: 8.4, 2: 12.0}.get(across, 12.6), down * height, **shared)
        for empty in axes.flat[len(made) :]:
            empty.set_visible(False)
        for one, panel in zip(axes.flat, made, strict=False):
            one.set_title(panel.title)
        for above in axes.flat[len(made) - across : len(made)]:
            above.tick_params(labelbottom=True)
        return figure, list(zip(axes.flat, made, strict=False))

    def series(self, rows: pd.DataFrame) -> Iterator[Series]:
        """Yield the series of a panel's rows, in the order of the whole table."""
        if not self.columns:
            yield Series("all", "", rows, self.looks[""])
            return
        for values in self.frame[self.columns].drop_duplicates().itertuples(index=False, name=None):
            own = rows[(rows[self.columns] == list(values)).all(axis=1)]
            if own.empty:
                continue
            given = dict(zip(self.columns, values, strict=True))
            look = self.looks[str(values[0])] if str(values[0]) in self.looks else self.looks[""]
            line = {"linestyle": self.lines[values[-1]]} if self.lines else {}
            name = ", ".join(self.word(column, value) for column, value in given.items())
            yield Series(" ".join(map(str, values)), name, own, look | line)

    def finish(
        self,
        figure: Figure,
        drawn: list[tuple[Axes, Panel]],
        xlabel: str,
        ylabel: str,
        legend: bool = True,
        **others: Any,
    ) -> None:
        """Label the axes, and draw one legend below, whose names show and hide their series."""
        places = [one.get_subplotspec() for one, _ in drawn]
        for (one, _), place in zip(drawn, places, strict=True):
            one.set(**others)
            if place is None or place.is_first_col():
                one.set_ylabel(ylabel)
        across = max(place.colspan.stop for place in places if place is not None)
        for one, _ in drawn[-across:]:
            one.set_xlabel(xlabel)
        handles = [pair for one, _ in drawn for pair in zip(*one.get_legend_handles_labels(), strict=True)]
        named = {name: handle for handle, name in reversed(handles)}
        named = {name: named[name] for name in dict.fromkeys(name for _, name in handles)}
        if set(named) - {""} and legend:
            columns = -(-len(named) // -(-len(named) // (2 + across)))
            names = figure.legend(named.values(), named, loc="outside lower center", ncols=columns, fontsize=10)
            ids = {series.name: series.id for series in self.series(self.frame)}
            for text in names.get_texts():
                if text.get_text() in ids:
                    toggles(text, ids[text.get_text()])
