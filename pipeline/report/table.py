"""A table of short texts, and its forms: csv, Markdown (which a terminal shows as well), LaTeX and HTML."""

import csv
import io
import re
from dataclasses import dataclass
from html import escape
from textwrap import wrap

_TEX = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "−": r"$-$", "–": "--", "\u00a0": "~", "β": r"$\beta$"}
_TEX |= {"\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "~": r"\textasciitilde{}", "^": r"\^{}"}
_TEX |= {"[": "{[}"}  # after \\ it would be read as a length
_TEX |= {"<": r"$<$", ">": r"$>$", "±": r"$\pm$", "≥": r"$\geq$", "→": r"$\to$"}

_SIZES = (  # of letters: how many of a row, two between columns, fit 6.5 in; how many lines fit 9 in under a caption
    (r"\footnotesize", 117, 60),
    (r"\scriptsize", 126, 72),
)
_HEADING = 14  # letters of a heading's line

_FIRST = ' class="first"'  # of a group of rows
_SPREAD = re.compile(r"^([^\[]+) (\[[^\]]+\])$")  # a mean and its quartiles: a crowded row may break between them


@dataclass(frozen=True)
class Cell:
    """One entry; bold stands for the verdict "effect" and for nothing else."""

    text: str
    bold: bool = False


@dataclass(frozen=True)
class Table:
    """`rows` of cells under `header`; the first `labels` columns name the row."""

    name: str
    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    labels: int = 1

    def __post_init__(self):
        if not self.rows:
            raise ValueError(f"table {self.name} has no rows: the stage that should fill it wrote nothing")
        for row in self.rows:
            if len(row) != len(self.header):
                raise ValueError(f"table {self.name}: {len(row)} cells under {len(self.header)} headings")


def table(name: str, caption: str, header: list[str], rows: list[list[str | Cell]], labels: int = 1) -> Table:
    """A table from plain texts, some of them already cells."""
    cells = tuple(tuple(c if isinstance(c, Cell) else Cell(c) for c in row) for row in rows)
    return Table(name, caption, tuple(header), cells, labels)


def to_csv(t: Table) -> str:
    """Comma-separated, bold as *text*: a verdict must not be lost with the typeface."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([heading.replace("\u00a0", " ") for heading in t.header])
    writer.writerows([f"*{c.text}*" if c.bold else c.text.replace("\u00a0", " ") for c in row] for row in t.rows)
    return buffer.getvalue()


def to_markdown(t: Table) -> str:
    """A pipe table under its caption, padded so that a terminal shows it as well."""
    texts = [list(t.header)] + [[f"**{c.text}**" if c.bold else c.text for c in row] for row in t.rows]
    texts = [[x.replace("|", r"\|") for x in row] for row in texts]
    widths = [max(3, *(len(row[i]) for row in texts)) for i in range(len(t.header))]

    def aligned(row: list[str]) -> str:
        pairs = enumerate(zip(row, widths, strict=True))
        return "| " + " | ".join(x.ljust(w) if i < t.labels else x.rjust(w) for i, (x, w) in pairs) + " |"

    marks = ["-" * w if i < t.labels else "-" * (w - 1) + ":" for i, w in enumerate(widths)]
    lines = [t.caption, "", aligned(texts[0]), aligned(marks), *map(aligned, texts[1:])]
    return "\n".join(lines).replace("\u00a0", " ") + "\n"


def to_tex(t: Table) -> str:
    """A booktabs table for a page 6.5 in by 9: cells break their lines where the table would be too wide."""
    sides = "l" * t.labels + "r" * (len(t.header) - t.labels)
    size, (header, *rows) = _fitted(t)
    head = " & ".join(_tex_cell(lines, side, "b") for lines, side in zip(header, sides, strict=True)) + r" \\"
    body = [
        " & ".join(_tex_cell(x, side, "t", c.bold) for x, side, c in zip(lines, sides, row, strict=True)) + r" \\"
        for lines, row in zip(rows, t.rows, strict=True)
    ]
    return "\n".join(
        [
            r"\begin{table}", r"\centering", size, r"\setlength{\tabcolsep}{4pt}",
            rf"\caption{{{_tex(t.caption)}}}", rf"\label{{table:{t.name}}}", rf"\begin{{tabular}}{{@{{}}{sides}@{{}}}}",
            r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}", "",
        ]
    )  # fmt: skip


def _fitted(t: Table) -> tuple[str, list[list[list[str]]]]:
    """The largest letters that fit the page, or the smallest, and every cell's lines in them, the header's first."""
    at_sizes = [(size, _narrowed(t, letters), most) for size, letters, most in _SIZES]
    low_enough = ((size, rows) for size, rows, most in at_sizes if sum(max(map(len, row)) for row in rows) <= most)
    return next(low_enough, at_sizes[-1][:2])


def _narrowed(t: Table, letters: int) -> list[list[list[str]]]:
    """Every cell's lines, broken as little as lets rows of so many letters hold them."""
    attempts = (_broken(t, width) for width in range(letters, 0, -1))
    return next((rows for rows in attempts if _letters(rows) <= letters), _broken(t, 1))


def _broken(t: Table, width: int) -> list[list[list[str]]]:
    header = [_lines(h, min(width, _HEADING)) for h in t.header]
    return [header, *([_lines(c.text, width) for c in row] for row in t.rows)]


def _lines(text: str, width: int) -> list[str]:
    return wrap(text, width, break_long_words=False, break_on_hyphens=False) or [""]


def _letters(rows: list[list[list[str]]]) -> float:
    columns = zip(*rows, strict=True)
    return sum(2 + max(_width(line) for lines in column for line in lines) for column in columns) - 2


def _width(line: str) -> float:
    """In letters: a sign is half as wide again as one."""
    return len(line) + 0.5 * sum(letter in "+−" for letter in line)


def _tex_cell(lines: list[str], side: str, at: str, bold: bool = False) -> str:
    """Lines aligned at their left or right `side`, level with the row `at` their top or bottom line."""
    texts = [rf"\textbf{{{_tex(x)}}}" if bold else _tex(x) for x in lines]
    if len(texts) == 1:
        return texts[0]
    return rf"\begin{{tabular}}[{at}]{{@{{}}{side}@{{}}}}" + r" \\ ".join(texts) + r"\end{tabular}"


def _tex(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in text)


def to_html(t: Table) -> str:
    """A real table: caption, column and row headings in scope; a repeated first heading is muted.

    Roles and labels are spelled out, since a narrow page may show the rows as blocks (templates/page.css).
    """
    kinds = ["" if i < t.labels else ' class="value"' for i in range(len(t.header))]
    head = "".join(
        f'<th scope="col" role="columnheader"{k}>{escape(h)}</th>' for h, k in zip(t.header, kinds, strict=True)
    )
    name = escape(t.name.replace("_", " "))
    lines = [f'<div class="scroll" tabindex="0" role="group" aria-label="Table: {name}"><table role="table">']
    lines.append(f"<caption><span>{escape(t.caption)}</span></caption>")
    lines += [f'<thead role="rowgroup"><tr role="row">{head}</tr></thead>', '<tbody role="rowgroup">']
    before: tuple[Cell, ...] | None = None
    for row in t.rows:
        first = t.labels > 1 and (before is None or before[0] != row[0])
        cells = "".join(_html_cell(t, i, c, repeated=t.labels > 1 and not first) for i, c in enumerate(row))
        lines.append(f'<tr role="row"{_FIRST if first and before else ""}>{cells}</tr>')
        before = row
    return "\n".join([*lines, "</tbody></table></div>"])


def _html_cell(t: Table, column: int, cell: Cell, repeated: bool) -> str:
    text = f"<strong>{escape(cell.text)}</strong>" if cell.bold else escape(cell.text)
    if column >= t.labels:
        text = _SPREAD.sub(r"<span>\1</span> <span>\2</span>", text)
        return f'<td role="cell" data-label="{escape(t.header[column])}">{text}</td>'
    text = f'<span class="again">{text}</span>' if repeated and column == 0 else text
    return f'<th scope="row" role="rowheader">{text}</th>'
