"""Join all pages into one file to mail, without a link out of it: `python -m pipeline.report.site` or `make site`."""

import argparse
import base64
import mimetypes
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

REPORTS, STUDIES, OUT = Path("reports"), Path("studies"), Path("site.html")
CURRENT = ' aria-current="page"'


def join(reports: Path, studies: Path) -> str:
    """Return the pages of both folders as one page: figures, tables and styles inside, links between pages within.

    Raise InputError if there is no page, or if a page names a file that does not exist.
    """
    files = [*sorted(reports.glob("*.html"), key=lambda path: path.stem != "index"), *sorted(studies.glob("*/*.html"))]
    if not files or files[0].stem != "index":
        raise InputError(f"{reports / 'index.html'} is missing: run `make repro` first")
    ids = {file: file.stem if file.parent == reports else f"study-{file.parent.name}" for file in files}
    bodies = {file: re.split(r"</?body>", file.read_text())[1] for file in files}
    nav = re.search(r'<nav class="pages".*?</nav>', bodies[files[0]], re.DOTALL)
    head = files[0].read_text().partition("<body>")[0]
    style = f"<style>\n{(reports / 'page.css').read_text()}</style>"
    parts = [
        re.sub(r'<link rel="stylesheet"[^>]*>', lambda _: style, head),
        '<body>\n<a class="skip" href="#main">Skip to the content</a>\n',
        _linked(nav[0].replace(CURRENT, "") if nav else "", files[0], ids),
        '\n<main id="main" tabindex="-1">\n',
        *(_article(bodies[file], file, ids) for file in files),
        "</main>\n</body>\n</html>\n",
    ]
    return "".join(parts)


def _article(body: str, file: Path, ids: Mapping[Path, str]) -> str:
    """Return a page as an article of the joined one: without its navigation, with ids of its own."""
    own = ids[file]
    body = re.sub(r'<a class="skip".*?</a>|<nav class="pages".*?</nav>', "", body, flags=re.DOTALL)
    body = body.replace('<main id="main" tabindex="-1"', "<div").replace("</main>", "</div>")
    body = body.replace(' loading="lazy"', "").replace('"On this page"', f'"On the page {own}"')
    body = re.sub(r'\b(id|aria-labelledby|aria-describedby)="([^"]+)"', rf'\1="{own}-\2"', body)
    return f'<article id="{own}">\n{_linked(body, file, ids)}</article>\n'


def _linked(text: str, file: Path, ids: Mapping[Path, str]) -> str:
    """Return a page's text with its links turned into links within the joined page, or into the files' contents."""

    def inside(link: re.Match) -> str:
        attribute, target, anchor = link[1], link[2], (link[3] or "").replace("#", "-")
        path = Path(os.path.normpath(file.parent / target)) if target else file
        if target.startswith("data:"):
            return link[0]
        if path in ids:
            return f'{attribute}="#{ids[path]}{anchor}"'
        if not path.is_file():
            raise InputError(f"{file} names {target}, which is missing: run its stage again")
        kind = mimetypes.guess_type(path.name)[0] or "text/plain"
        download = f' download="{path.name}"' if attribute == "href" else ""
        return f'{attribute}="data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"{download}'

    return re.sub(r'\b(href|src|data)="([^"#]*)(#[^"]*)?"', lambda m: inside(m) if m[2] or m[3] else m[0], text)


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.site", description=__doc__).parse_args()
    try:
        atomic_write(OUT, lambda part: part.write_text(join(REPORTS, STUDIES)))
    except InputError as error:
        sys.exit(f"error: {error}")
    print(f"{OUT}: {OUT.stat().st_size / 2**20:.1f} MiB")
