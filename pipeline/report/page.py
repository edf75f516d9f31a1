"""One page from its template: numbers by name and format, figures and tables numbered in order of appearance."""

import hashlib
import importlib
import json
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import matplotlib
import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from omegaconf import DictConfig

from pipeline.artifacts.files import data_version, write_json, write_table
from pipeline.report import style
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Table:
    """A table of a page: its numbers as written to csv, and the format of each numeric column.

    Columns "X, q1" and "X, q3" are shown in brackets behind X: the quartiles over training sets. A true "X, bold" makes
    the cell bold, and a true "X, beyond" puts a dagger behind it.
    """

    frame: pd.DataFrame
    formats: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """The files, by stage and name, that a table of results was read or computed from."""

    files: tuple[tuple[str, Path], ...]  # stage, and the file in its folder

    def __str__(self) -> str:
        """Return the files' names by stage."""
        return ", ".join(f"{file.name} of {stage}" for stage, file in self.files)

    def digests(self) -> list[dict[str, str]]:
        """Return stage, name and md5 of each file; a stage's lock names the same md5."""
        parts = [{"stage": stage, "file": file.name} for stage, file in self.files]
        sums = [hashlib.md5(file.read_bytes()).hexdigest() for _, file in self.files]
        return [part | {"md5": md5} for part, md5 in zip(parts, sums, strict=True)]


@runtime_checkable
class Traceable(Protocol):
    """Results whose tables can say what they are made of."""

    @property
    def reads(self) -> list[str]:
        """Return the names of the tables that were asked for."""
        ...

    @property
    def sources(self) -> Mapping[str, Source]:
        """Return what is behind each table."""
        ...

    @property
    def seeds(self) -> list[int]:
        """Return the training sets that the results are over."""
        ...


@dataclass(frozen=True)
class Site:
    """All output: pages by name, figures as SVG text by file name, tables by file name."""

    pages: dict[str, str] = field(default_factory=dict)
    figures: dict[str, str] = field(default_factory=dict)
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)
    claims: dict[str, str] = field(default_factory=dict)  # of the paper: claim -> its verdict (pipeline.report.claims)
    sources: dict[str, Source] = field(default_factory=dict)  # of each table of results that a page's table reads
    read: dict[str, dict[str, list[str]]] = field(default_factory=dict)  # page -> its table -> tables of results


def environment(folders: Sequence[Path], **names: Any) -> Environment:
    """Return Jinja2's environment for templates in `folders` and this one; `names` are global in templates."""
    made = Environment(
        loader=FileSystemLoader([*folders, FOLDER]),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals |= (
        FORMATS
        | {"label": style.label, "formats": FORMATS, "headings": headings, "in_brackets": in_brackets}
        | {"number_alone": number_alone, "hidden": HIDDEN}
        | names
    )
    return made


HIDDEN = tuple(f", {part}" for part in ("q1", "q3", "bold", "beyond"))  # ends of columns about another column


def with_gaps(rows: Any) -> pd.DataFrame:
    """Return rows as a frame in which a number that cannot exist is None, which a page shows as a dash."""
    frame = pd.DataFrame(rows, dtype=object)
    return frame.where(frame.notna(), None)


def pick(table: pd.DataFrame, titles: Mapping[str, str], **words: Callable | Mapping) -> pd.DataFrame:
    """Return the columns of a table that `titles` names, under their titles; `words` translate a column."""
    shown = table.assign(**{column: table[column].map(word) for column, word in words.items()})
    return shown[list(titles)].rename(columns=dict(titles)).reset_index(drop=True)


def in_brackets(row: Mapping[str, Any], column: str, write: Callable[[Any], str]) -> str:
    """Return the quartiles of a cell, in brackets and without their unit; nothing where there are none."""
    ends: list[Any] = [row.get(f"{column}, {end}") for end in ("q1", "q3")]
    if None in ends:
        return ""
    between = "–" if min(map(float, ends)) >= 0 else " to "
    return f" [{between.join(write(float(end)).partition(chr(0xA0))[0] for end in ends)}]"


def number_alone(cell: Any) -> float | None:
    """Return a cell's number without its source, which its `title` states."""
    return None if cell is None else float(cell)


def in_words(seeds: Sequence[int]) -> str:
    """Return seeds as text: `seeds 0–9` where they follow one another."""
    first, last = min(seeds), max(seeds)
    whole = len(seeds) > 2 and sorted(seeds) == list(range(first, last + 1))
    return f"seeds {first}–{last}" if whole else f"seeds {', '.join(map(str, seeds))}"


def headings(content: str) -> list[tuple[str, str]]:
    """Return the id and the text of each section's heading, for the table of contents."""
    return re.findall(r'<h2 id="([^"]+)">([^<]+)</h2>', content)


def render_page(
    name: str, template: str, package: str, data: Any, made: Environment, site: Site, prefix: str = ""
) -> None:
    """Add page `name` with its figures and tables to `site`.

    package: where the modules `figures` and `tables` lie, whose functions the template names; prefix: begins the names
    of their files. If `data` is Traceable, each table says what it is made of. Raise InputError or ValueError if the
    page uses a number that is missing or not finite.
    """
    counts, page = {"figure": 0, "table": 0}, name

    def figure(name: str, alt: str, wide: bool = False, recording: str = "", caller: Callable[[], str] = str) -> Markup:
        """Draw a figure; `recording`: `overview` or `worst`, the recording in git that shows the same."""
        draw = getattr(importlib.import_module(f"{package}.figures"), name)
        counts["figure"] += 1
        with matplotlib.rc_context(style.RC):
            drawn = draw(data)
        file = prefix + name.replace("_", "-")
        site.figures[file] = style.svg(drawn)
        width, height = (round(96 * inches) for inches in drawn.get_size_inches())
        text = {"file": file, "alt": alt, "number": counts["figure"], "caption": caller()}
        text |= {"width": width, "height": height, "wide": wide, "chart": "<script>" in site.figures[file]}
        text |= {"command": {"overview": "make review", "worst": "make review WORST=1"}.get(recording, "")}
        return Markup(made.get_template("figure.html.j2").render(text))

    def table(name: str, caller: Callable[[], str] = str) -> Markup:
        reads = data.reads if isinstance(data, Traceable) else []
        reads.clear()
        shown: Table = getattr(importlib.import_module(f"{package}.tables"), name)(data)
        counts["table"] += 1
        file = prefix + name.replace("_", "-")
        site.tables[file] = shown.frame
        if isinstance(data, Traceable):
            site.read.setdefault(page, {})[file] = sorted(set(reads))
            site.sources.update({table: data.sources[table] for table in reads if table in data.sources})
        text = {"file": file, "table": shown, "rows": _rows(shown.frame)}
        text |= {"number": counts["table"], "caption": caller(), "origins": ()}
        if isinstance(data, Traceable):
            origins = dict.fromkeys(str(site.sources.get(table, table)) for table in sorted(set(reads)))
            text |= {"origins": origins, "seeds": in_words(data.seeds)}
        return Markup(made.get_template("table.html.j2").render(text))

    def table_number() -> str:
        """Return the number of a table whose markup is in the template."""
        counts["table"] += 1
        return f"Table {counts['table']}."

    numbered = {"figure": figure, "table": table, "table_number": table_number}
    site.pages[name] = made.get_template(template).render(page=name, **numbered)


def _rows(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table; unlike `to_dict`, leave its Traced numbers as they are."""
    return [dict(zip(frame.columns, row, strict=True)) for row in frame.astype(object).to_numpy()]


def write_files(site: Site, out_dir: Path) -> None:
    """Write pages, figures and tables; remove figures and tables of an earlier run."""
    for folder, suffix in (("figures", "svg"), ("tables", "csv")):
        (out_dir / folder).mkdir(parents=True, exist_ok=True)
        for old in (out_dir / folder).glob(f"*.{suffix}"):
            old.unlink()
    texts = {f"{name}.html": page for name, page in site.pages.items()}
    texts |= {f"figures/{name}.svg": figure for name, figure in site.figures.items()}
    for name, text in texts.items():
        atomic_write(out_dir / name, lambda part, text=text: part.write_text(text))
    for name, table in site.tables.items():
        write_table(out_dir / "tables" / f"{name}.csv", table.infer_objects())


def write_provenance(site: Site, out_dir: Path, facts: Mapping[str, Any]) -> None:
    """Write provenance.json: `facts`, the tables behind each page's tables, and the md5 of the files behind those."""
    sources = {name: source.digests() for name, source in sorted(site.sources.items())}
    write_json(out_dir / "provenance.json", {**facts, "sources": sources, "pages": site.read})


def provenance(cfg: DictConfig) -> dict[str, Any]:
    """Return what every page's numbers depend on: version of the data, profile, seeds, splits, demonstrations.

    Raise InputError if no file names the data's version.
    """
    facts: dict[str, Any] = {"data_md5": data_version(cfg.paths.data), "root_seed": cfg.scenes.root_seed}
    facts |= {"profile": cfg.profile}
    facts |= {"seeds": list(cfg.protocol.seeds), "splits": dict(cfg.protocol.splits)}
    return facts | {"main_n_demos": cfg.main_n_demos}


# Numbers


class Traced(float):
    """A number that knows which cell of which table it is; a page shows that on hover, and an audit checks it."""

    source: tuple[str, str, dict[str, Any]]  # table, column, and the values that select the row

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


# Formats: each raises for a number that is not finite; None marks a value that cannot exist, such as a baseline's
# seeds.


def _number(pattern: str, scale: float = 1.0) -> Callable[[Any], str]:
    def write(number: Any) -> str:
        if number is None:
            return "–"
        if not math.isfinite(number):
            raise ValueError(f"{number} in a page: expected a finite number; run the stage that writes it again")
        text = pattern.format(scale * number).replace("-", "−")
        text = text.lstrip("+−") if float(pattern.format(scale * number).split("\u00a0")[0]) == 0 else text
        return number.mark(text) if isinstance(number, Traced) else text

    return write


def _spread(low: float, high: float) -> str:
    """Return a range of rates in per cent."""
    write = _number("{:.0f}", 100.0)
    return f"{write(float(low))}–{write(float(high))}"


FORMATS: dict[str, Callable] = {
    "pct": _number("{:.0f}\u00a0%", 100.0),  # prose: whole per cents
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
    "spread": _spread,
}
