"""Show an audit, written in Markdown, in a terminal or as a page."""

import re
from importlib import resources

from markdown_it import MarkdownIt
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, TableElement
from rich.table import Table

MIN_WIDTH = 110  # columns, where the output is no terminal


def in_terminal(markdown: str) -> None:
    """Print with tables, as wide as the terminal."""
    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, MIN_WIDTH)
    console.print(_Folded(markdown))


class _FoldedTable(TableElement):
    """A table that breaks long names over lines, where rich's own cuts them off."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for part in super().__rich_console__(console, options):
            if isinstance(part, Table):
                for column in part.columns:
                    column.overflow = "fold"
            yield part


class _Folded(Markdown):
    elements = Markdown.elements | {"table_open": _FoldedTable}


def as_page(markdown: str) -> str:
    """Return a page in one file, in the report's style; markup in the text is escaped."""
    body = MarkdownIt("js-default").render(markdown)
    body = body.replace("<table>", '<div class="table"><table>').replace("</table>", "</table></div>")
    title = re.sub("<.*?>", "", body.partition("</h1>")[0])
    style = resources.files("pipeline.report").joinpath("page.css").read_text()
    return PAGE.format(title=title, style=style, body=body)


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{style}.table {{ overflow-x: auto; }}</style>
</head>
<body>
<div class="page"><main class="content" id="main">
{body}</main></div>
</body>
</html>
"""
