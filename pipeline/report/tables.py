"""A page's numbers and tables: numbers that know where they come from, formats, and rows of a table of results."""

import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from pipeline.runtime.errors import InputError

SIGNIFICANT = 0.05  # a corrected p below it makes a cell bold
ENDS = (("q1", "q3"), ("low", "high"))  # parts of a cell that are shown in brackets: quartiles, an interval
HIDDEN = tuple(f", {part}" for part in ("q1", "q3", "low", "high", "bold", "beyond"))  # of columns about another one
Words = Callable[[Any], Any] | Mapping[Any, Any]


class Traced(float):
    """A number that knows which cell of which table it is; a page shows that on hover."""

    source: tuple[str, str, dict[str, Any]]  # table, column, and the values that select the row
    note: str = ""  # what it rests on, if not on all seeds

    def __new__(cls, number: float, table: str, column: str, where: Mapping[str, Any]):
        """Return the number with its source."""
        made = super().__new__(cls, number)
        made.source = table, column, dict(where)
        return made

    def mark(self, text: str) -> Markup:
        """Return its text as HTML that carries the source."""
        html = '<data value="{}" title="{}" data-source="{}">{}</data>'
        return Markup(html).format(float(self), self.words, json.dumps(self.source), text)

    @property
    def words(self) -> str:
        """Return its source in words: table, column, and what selects the row."""
        table, column, where = self.source
        return f"{table}, {column}: {', '.join(f'{name} {value}' for name, value in where.items())}"


def lookup(frame: pd.DataFrame, table: str, column: str, **where: Any) -> Any:
    """Return the value of `column` in the one row of a table that `where` selects.

    Raise InputError if no row or several match, or if the number is missing or not finite.
    """
    for name, wanted in where.items():
        frame = frame[frame[name] == wanted]
    if len(frame) != 1:
        raise InputError(f"table {table} has {len(frame)} rows with {where}, expected 1; run its stage again")
    value = checked(frame[column].iloc[0], f"table {table}, column {column}, {where}")
    return Traced(value, table, column, where) if isinstance(value, float) else value


def named(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table in which missing names, such as the variant of a baseline, are empty ones."""
    names = table.select_dtypes(["object", "string"]).columns
    return table.assign(**{name: table[name].fillna("") for name in names})


def check_finite(frame: pd.DataFrame, table: str, columns: Collection[str]) -> None:
    """Raise InputError for the first of these columns with a number that is missing or not finite."""
    for column in columns:
        if not np.isfinite(frame[column].astype(float)).all():
            raise InputError(f"table {table}, column {column}: expected finite numbers; run its stage again")


def checked(number: Any, name: str) -> Any:
    """Return a value as a Python type; raise InputError if it is missing or not finite."""
    if number is None or (isinstance(number, float | np.floating) and not math.isfinite(number)):
        raise InputError(f"{name} is {number}: expected a finite number; run the stage that writes it again")
    return number.item() if isinstance(number, np.generic) else number


def _number(pattern: str, scale: float = 1.0, nearly: str = "") -> Callable[[Any], str]:
    """Return a format that raises for a number that is not finite; None marks a value that cannot exist.

    nearly: the pattern of a share that would else read as all.
    """

    def write(number: Any) -> str:
        if number is None:
            return "–"
        if not math.isfinite(number):
            raise ValueError(f"{number} in a page: expected a finite number; run the stage that writes it again")
        shown, form = (min(number, 0.999), nearly) if nearly and 0.995 <= number < 1 else (number, pattern)
        text = form.format(scale * shown).replace("-", "−")
        text = text.lstrip("+−") if float(pattern.format(scale * number).split("\u00a0")[0]) == 0 else text
        return number.mark(text) if isinstance(number, Traced) else text

    return write


FORMATS: dict[str, Callable] = {
    "pct": _number("{:.0f}\u00a0%", 100.0, "{:.1f}\u00a0%"),  # prose: whole per cents
    "pct1": _number("{:.1f}\u00a0%", 100.0),  # tables
    "points": _number("{:+.0f}", 100.0),
    "points1": _number("{:+.1f}", 100.0),
    "effect": _number("{:+.2f}"),
    "rate": _number("{:.2f}"),
    "fine": _number("{:.3f}"),
    "times": _number("{:.1f}"),
    "digits": _number("{:.3g}"),
    "cm": _number("{:.1f}\u00a0cm", 100.0),
    "count": _number("{:.0f}"),
    "spread": lambda low, high: "–".join(_number("{:.0f}", 100.0)(float(end)) for end in (low, high)),  # of rates
}


def chosen(data: Any, table: str | Callable[[Any], pd.DataFrame], where: Mapping[str, Any] | None) -> pd.DataFrame:
    """Return the rows of a table of results that `where` selects; a list selects any of its values, in its order.

    data: results with `table(name)`, and `source(name)`, the table's name in a number's source. table: its name, or a
    function that makes it from the results. Raise InputError if there is no such row.
    """
    frame = table(data) if callable(table) else data.table(table)
    for column, wanted in reversed(list((where or {}).items())):
        if isinstance(wanted, str) or not isinstance(wanted, Iterable):
            frame = frame[frame[column] == wanted]
        else:
            place = {value: i for i, value in enumerate(wanted)}
            frame = frame[frame[column].isin(place)].sort_values(column, key=lambda c: c.map(place), kind="stable")
    if frame.empty:
        raise InputError(f"table {table} has no row with {where}; run its stage again")
    return frame


def beside(frame: pd.DataFrame, column: str, part: str, first: bool = True) -> str | None:
    """Return the column with a part (an interval's end, p) of another: its own, or the table's one if it is `first`."""
    own = f"{column}_{part}"
    return own if own in frame else part if first and part in frame else None


def rows_of(
    data: Any,
    table: str | Callable[[Any], pd.DataFrame],
    columns: Mapping[str, str],
    where: Mapping[str, Any] | None = None,
    formats: Mapping[str, str] | str = "",
    words: Mapping[str, Words] | None = None,
    quartiles: bool = False,
    interval: Sequence[str] = (),
    bold: str = "",
    beyond: str = "",
    across: str = "",
    gaps: Collection[str] = (),
    note: Callable[[Mapping[str, Any]], str] | None = None,
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return rows of a table of results under other titles, and the format of each numeric column.

    Behind a number X are its parts, columns "X, q1" and "X, q3", "X, low" and "X, high", "X, bold", "X, beyond".
    columns: the columns shown, with their titles, in that order. where: see `chosen`. formats: the format of each
    column with numbers, by title, or one name for all columns of fractions. words: what stands for a column's values.
    quartiles, interval: show the columns `X_q1` and `X_q3`, or those of the interval, in brackets behind X; columns
    without X's name belong to the first column of fractions. So do `bold` (a truth value, or a p that is to be below
    0.05) and `beyond` (a dagger). across: a column of which each value gets its own columns of the fractions; the other
    columns come first, and name the rows; a row without some value has a dash there. gaps: titles of columns whose
    missing numbers cannot exist and are shown as a dash. note: what a row's numbers rest on, shown on hover. Raise
    InputError for any other number that is missing or not finite.
    """
    frame, words = chosen(data, table, where), words or {}
    source = table.__name__ if callable(table) else data.source(table)
    shares = () if isinstance(formats, str) else [title for title, form in formats.items() if form.startswith("pct")]
    is_float = pd.api.types.is_float_dtype  # csv files hold 1.0 as 1
    fractions = [name for name in columns if is_float(frame[name]) or columns[name] in shares]
    if isinstance(formats, str):
        formats = dict.fromkeys((columns[name] for name in fractions), formats) if formats else {}
    fractions = [name for name in fractions if columns[name] in formats]
    keys = [name for name in columns if name not in fractions]
    check_finite(frame, source, [name for name in fractions if columns[name] not in gaps])
    parts = {"q1": "q1", "q3": "q3"} if quartiles else dict(zip(("low", "high"), interval, strict=False))
    parts |= {part: name for part, name in (("bold", bold), ("beyond", beyond)) if name}
    marks = {n: {part: beside(frame, n, parts[part], n == fractions[0]) for part in parts} for n in fractions}
    marks = {name: {part: own for part, own in of.items() if own} for name, of in marks.items()}
    if absent := parts.keys() - {part for of in marks.values() for part in of}:
        raise KeyError(f"table {source} has no column for {sorted(absent)}")
    fixed = {name: value for name, value in (where or {}).items() if isinstance(value, str | int | float)}
    heads, lines = dict[str, None](), dict[Any, dict[str, Any]]()
    for i, row in enumerate(frame.to_dict("records")):
        head = str(in_words(row[across], words.get(across))) if across else ""
        heads[head] = None
        texts = {columns[name]: in_words(row[name], words.get(name)) for name in keys}
        line = lines.setdefault(tuple(texts.values()) if across else i, texts)
        at = fixed | {name: row[name] for name in [*keys, across] if name}
        for name in fractions:
            title = _joined(head, columns[name])
            line[title] = Traced(float(row[name]), source, name, at) if pd.notna(row[name]) else None
            if note and line[title] is not None:
                line[title].note = note(row)
            for part, own in marks[name].items():
                is_p = (part, type(row[own])) == ("bold", float)
                line[f"{title}, {part}"] = row[own] < SIGNIFICANT if is_p else row[own]
    order = [columns[name] for name in keys] if across else []
    for head in heads:
        for name in fractions if across else columns:
            title = _joined(head, columns[name])
            order += [title, *(f"{title}, {part}" for part in marks.get(name, ()))]
    made = pd.DataFrame([{name: line.get(name) for name in order} for line in lines.values()], dtype=object)
    made = made.where(made.notna(), None)  # which a page shows as a dash
    if across:
        formats = dict(formats) | {_joined(head, title): form for head in heads for title, form in formats.items()}
        made = made.drop(columns=[name for name in order if name.endswith(HIDDEN) and made[name].isna().all()])
    return made, dict(formats)


def in_words(value: Any, words: Words | None) -> Any:
    """Return what stands for a value: itself, if a mapping has nothing for it."""
    return value if words is None else words(value) if callable(words) else words.get(value, value)


def _joined(head: str, title: str) -> str:
    return ", ".join(filter(None, [head, title]))


def in_brackets(row: Mapping[str, Any], column: str, write: Callable[[Any], str]) -> str:
    """Return the quartiles or the interval of a cell, in brackets and without their unit; nothing if it has none."""
    for low, high in ENDS:
        ends: list[Any] = [row.get(f"{column}, {end}") for end in (low, high)]
        if None not in ends:
            texts = [write(float(end)).partition(chr(0xA0))[0] for end in ends]
            return f" [{('–' if all(text[0].isdigit() for text in texts) else ' to ').join(texts)}]"
    return ""
