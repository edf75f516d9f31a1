"""One page from its template: figures and tables numbered in order of appearance, with files of their own."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure
from omegaconf import DictConfig

from pipeline.artifacts.files import data_version, write_json, write_table
from pipeline.report import charts, style
from pipeline.report.study import Data, Source
from pipeline.report.tables import FORMATS, HIDDEN, in_brackets, rows_of
from pipeline.runtime.writing import atomic_write

FOLDER = Path(__file__).parent


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
    made = Environment(loader=FileSystemLoader([*folders, FOLDER]), undefined=StrictUndefined, autoescape=True)
    made.trim_blocks = made.lstrip_blocks = True
    made.globals |= FORMATS | {"formats": FORMATS, "label": style.label, "in_brackets": in_brackets, "hidden": HIDDEN}
    made.globals |= {"heading": lambda name: style.label(name).capitalize(), "headings": headings}
    made.globals |= {"seeds_in_words": seeds_in_words} | names
    return made


def seeds_in_words(seeds: Sequence[int]) -> str:
    """Return seeds as text: `seeds 0–9` where they follow one another."""
    first, last = min(seeds), max(seeds)
    whole = len(seeds) > 2 and sorted(seeds) == list(range(first, last + 1))
    return f"seeds {first}–{last}" if whole else f"seeds {', '.join(map(str, seeds))}"


def headings(content: str) -> list[tuple[str, str]]:
    """Return the id and the text of each section's heading, for the table of contents."""
    return re.findall(r'<h2 id="([^"]+)">([^<]+)</h2>', content)


def render_page(
    name: str, template: str, figures: Any, data: Any, made: Environment, site: Site, prefix: str = ""
) -> None:
    """Add page `name` with its figures and tables to `site`.

    figures: the module with the functions that the template names; prefix: begins the names of figures' and tables'
    files. If the results are `Data`, each table says what it is made of. Raise InputError or ValueError if the page
    uses a number that is missing or not finite.
    """
    page = Page(name, data, made, site, prefix)
    calls: dict[str, Any] = {call: getattr(page, call) for call in ("figure", "rows", "table_number")}
    calls |= {draw.__name__: partial(page.chart, draw) for draw in (charts.curves, charts.bars)}
    site.pages[name] = made.get_template(template).render(page=name, figures=figures, **calls)


@dataclass
class Page:
    """Number, draw and show the figures and tables that a template asks for."""

    name: str
    data: Any
    made: Environment
    site: Site
    prefix: str
    figure_count: int = 0
    table_count: int = 0

    def figure(self, draw: Callable[[Any], Figure], caller: Callable[[], str] = str, **options: Any) -> Markup:
        """Show the figure that a function draws of the data."""
        return self._figure(draw.__name__, partial(draw, self.data), caller, **options)

    def chart(self, draw: Callable, name: str, table: Any, caller: Callable[[], str] = str, **options: Any) -> Markup:
        """Show lines or intervals of a table of results: `draw` is `charts.curves` or `charts.bars`."""
        return self._figure(name, partial(draw, self.data, table), caller, **options)

    def table_number(self) -> str:
        """Return the number of a table whose markup is in the template."""
        self.table_count += 1
        return f"Table {self.table_count}."

    def _figure(self, name: str, draw: Callable, caller: Callable, alt: str, wide=False, recording="", **options):
        """Return a figure's markup; `recording`: `overview` or `worst`, a recording of such tables."""
        with matplotlib.rc_context(style.RC):
            drawn = draw(**options)
        self.figure_count += 1
        file = self.prefix + name.replace("_", "-")
        self.site.figures[file] = style.svg(drawn)
        width, height = (round(96 * inches) for inches in drawn.get_size_inches())
        text = {"file": file, "alt": alt, "number": self.figure_count, "caption": caller()}
        text |= {"width": width, "height": height, "wide": wide, "chart": "<script>" in self.site.figures[file]}
        text |= {"command": {"overview": "make review", "worst": "make review WORST=1"}.get(recording, "")}
        return Markup(self.made.get_template("figure.html.j2").render(text))

    def rows(self, name: str, table: Any, caller: Callable[[], str] = str, **options: Any) -> Markup:
        """Show rows of a table of results: see `tables.rows_of`."""
        traced = isinstance(self.data, Data)
        if traced:
            self.data.reads.clear()
        frame, written = rows_of(self.data, table, **options)
        read = sorted(set(self.data.reads)) if traced else []
        self.table_count += 1
        file = self.prefix + name.replace("_", "-")
        self.site.tables[file] = frame
        rows = [dict(zip(frame, row, strict=True)) for row in frame.astype(object).to_numpy()]  # Traced
        text = {"file": file, "columns": list(frame), "written": written, "rows": rows, "number": self.table_count}
        text |= {"caption": caller(), "origins": ()}
        if traced:
            sources = self.data.sources
            self.site.read.setdefault(self.name, {})[file] = read
            self.site.sources.update({table: sources[table] for table in read if table in sources})
            files = [", ".join(f"{path.name} of {of}" for of, path in sources.get(one, ())) or one for one in read]
            text["origins"] = dict.fromkeys(files)
            text["seeds"] = seeds_in_words(self.data.seeds)
        return Markup(self.made.get_template("table.html.j2").render(text))


def write_files(site: Site, out_dir: Path) -> None:
    """Write pages, figures and tables; remove figures and tables of an earlier run."""
    for folder, suffix in (("figures", "svg"), ("tables", "csv")):
        (out_dir / folder).mkdir(parents=True, exist_ok=True)
        for old in (out_dir / folder).glob(f"*.{suffix}"):
            old.unlink()
    texts = {f"{name}.html": page for name, page in site.pages.items()}
    texts |= {f"figures/{name}.svg": figure for name, figure in site.figures.items()}
    for name, text in texts.items():
        atomic_write(out_dir / name, lambda part, text=text: part.write_text(text, encoding="utf-8"))
    for name, table in site.tables.items():
        write_table(out_dir / "tables" / f"{name}.csv", table.infer_objects())


def write_provenance(site: Site, out_dir: Path, facts: Mapping[str, Any]) -> None:
    """Write provenance.json: `facts`, the tables behind each page's tables, and the md5 of the files behind those.

    A stage's lock names the same md5.
    """
    sources: dict[str, list[dict[str, str]]] = {name: [] for name in sorted(site.sources)}
    for name, listed in sources.items():
        for stage, file in site.sources[name]:
            listed.append({"stage": stage, "file": file.name, "md5": hashlib.md5(file.read_bytes()).hexdigest()})
    write_json(out_dir / "provenance.json", {**facts, "sources": sources, "pages": site.read})


def provenance(cfg: DictConfig) -> dict[str, Any]:
    """Return what every page's numbers depend on: version of the data, profile, seeds, splits, demonstrations.

    Raise InputError if no file names the data's version.
    """
    facts = {"data_md5": data_version(cfg.paths.data), "root_seed": cfg.scenes.root_seed, "profile": cfg.profile}
    facts |= {"seeds": list(cfg.protocol.seeds), "splits": dict(cfg.protocol.splits)}
    return facts | {"main_n_demos": cfg.main_n_demos}
