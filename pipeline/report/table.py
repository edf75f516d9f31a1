"""A table of short texts, and its forms: csv, Markdown, LaTeX, HTML and a terminal's."""

import csv
import io
from dataclasses import dataclass
from html import escape

_TEX = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "−": r"$-$", "–": "--", "\u00a0": "~", "β": r"$\beta$"}
_TEX |= {"<": r"$<$", ">": r"$>$", "±": r"$\pm$", "≥": r"$\geq$", "→": r"$\to$"}


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
    """A pipe table with its caption above."""
    lines = [t.caption, "", _pipes(t.header), _pipes(["---"] * len(t.header))]
    lines += [_pipes([f"**{c.text}**" if c.bold else c.text for c in row]) for row in t.rows]
    return "\n".join(lines).replace("\u00a0", " ") + "\n"


def _pipes(cells) -> str:
    return "| " + " | ".join(str(c).replace("|", r"\|") for c in cells) + " |"


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
    """A real table: caption, column and row headings in scope; equal row headings are written once."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in t.header)
    lines = [f'<div class="scroll" tabindex="0" role="group" aria-label="{escape(t.name)} table"><table>']
    lines += [f"<caption>{escape(t.caption)}</caption>", f"<thead><tr>{head}</tr></thead>", "<tbody>"]
    before: tuple[Cell, ...] | None = None
    for row in t.rows:
        first = t.labels > 1 and (before is None or before[0] != row[0])
        cells = []
        for column, cell in enumerate(row):
            repeated = column == 0 and t.labels > 1 and not first
            text = f"<strong>{escape(cell.text)}</strong>" if cell.bold else escape(cell.text)
            text = f'<span class="again">{text}</span>' if repeated else text
            cells.append(f'<th scope="row">{text}</th>' if column < t.labels else f"<td>{text}</td>")
        opening = '<tr class="first">' if first and before else "<tr>"
        lines.append(opening + "".join(cells) + "</tr>")
        before = row
    return "\n".join([*lines, "</tbody></table></div>"])


def to_text(t: Table) -> str:
    """For a terminal: aligned columns, bold as *text*."""
    texts = [list(t.header)] + [[f"*{c.text}*" if c.bold else c.text for c in row] for row in t.rows]
    widths = [max(len(row[i]) for row in texts) for i in range(len(t.header))]

    def aligned(row: list[str]) -> str:
        pairs = enumerate(zip(row, widths, strict=True))
        return "  ".join(x.ljust(w) if i < t.labels else x.rjust(w) for i, (x, w) in pairs).rstrip()

    rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
    return "\n".join([t.caption, rule, aligned(texts[0]), rule, *map(aligned, texts[1:]), rule])
