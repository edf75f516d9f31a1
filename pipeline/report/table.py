"""A table of short texts, and its forms: csv, Markdown (which a terminal shows as well), LaTeX and HTML."""

import csv
import io
import re
from dataclasses import dataclass
from html import escape

_TEX = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "−": r"$-$", "–": "--", "\u00a0": "~", "β": r"$\beta$"}
_TEX |= {"<": r"$<$", ">": r"$>$", "±": r"$\pm$", "≥": r"$\geq$", "→": r"$\to$"}

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
    writer.writerow(t.header)
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
    """A booktabs table."""
    columns = "l" * t.labels + "r" * (len(t.header) - t.labels)
    body = [
        " & ".join(rf"\textbf{{{_tex(c.text)}}}" if c.bold else _tex(c.text) for c in row) + r" \\" for row in t.rows
    ]
    return "\n".join(
        [
            r"\begin{table}", rf"\caption{{{_tex(t.caption)}}}", rf"\label{{table:{t.name}}}",
            rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule",
            " & ".join(_tex(h) for h in t.header) + r" \\", r"\midrule", *body,
            r"\bottomrule", r"\end{tabular}", r"\end{table}", "",
        ]
    )  # fmt: skip


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
