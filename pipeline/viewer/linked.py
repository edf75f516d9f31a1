"""Serve the pages to this machine with links from numbers and figures to recordings; their files stay as they are."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from html import escape, unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from pipeline.viewer.run import INTERVENTION, REPAIR
from pipeline.world.layout import SYMBOLS

SERVED = "reports", "studies"  # folders with pages
OTHER_NAMES = {"source": "variant", "change": "symbol"}  # of columns of Table 2
NUMBER = re.compile(r'(<(?:td class="number"|data value="[^"]*") title="([^"]*)"[^>]*>)(.*?)(</(?:td|data)>)')
Place = tuple[str, str, int]  # a recording, a time line and a step on it


def place(runs: Sequence[Mapping[str, Any]], facts: Mapping[str, str]) -> Place | None:
    """Return where a number is seen: in the least accurate run of its variant, user and seed; None without one.

    runs: `run`, variant, user, seed, accuracy, and the worst scenes with their last steps. The step is that of the
    number's scene, if it is among these, else that of its added item, else that of the worst scene.
    """
    named = {"variant", "user", "seed"} & facts.keys()
    alike = [run for run in runs if named and all(str(run[name]) == facts[name] for name in named)]
    with_scene = [run for run in alike if facts.get("scene", "") in map(str, run["scenes"])]
    if not alike:
        return None
    run = min(with_scene or alike, key=lambda run: run["accuracy"])
    steps = dict(zip(map(str, run["scenes"]), run["steps"], strict=True))
    if not with_scene and facts.get("symbol") in SYMBOLS:
        return run["run"], INTERVENTION, SYMBOLS.index(facts["symbol"])
    return run["run"], REPAIR, int(steps[facts["scene"]] if with_scene else next(iter(steps.values()), 0))


def linked(page: str, address: Callable[[Mapping[str, str]], str | None], figures: Mapping[str, str]) -> str:
    """Return a page whose numbers are links to `address` of what selects them, where there is one.

    figures: the address of the recording that a command opens, by the command that a figure names.
    """

    def link(number: re.Match[str]) -> str:
        pairs = unescape(number[2]).partition(": ")[2].partition(";")[0].split(", ")
        named = (pair.partition(" ") for pair in pairs)
        to = address({OTHER_NAMES.get(name, name): value for name, _, value in named})
        return f'{number[1]}<a href="{escape(to)}">{number[3]}</a>{number[4]}' if to else number[0]

    page = NUMBER.sub(link, page)
    for command, to in figures.items():
        page = page.replace(f"<code>{command}</code>", f'<a href="{escape(to)}">{command}</a>')
    return page


class _Pages(SimpleHTTPRequestHandler):
    def __init__(self, change: Callable[[str], str], *args: Any, **options: Any):
        self.change = change
        super().__init__(*args, **options)

    def do_GET(self) -> None:
        path = Path(self.translate_path(self.path))
        folder = path.relative_to(self.directory).parts[:1]
        if not (folder and folder[0] in SERVED and path.is_file()):
            self.send_error(404)
        elif path.suffix != ".html":
            super().do_GET()
        else:
            content = self.change(path.read_text(encoding="utf-8")).encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        pass


@contextmanager
def served(root: Path, change: Callable[[str], str]) -> Iterator[str]:
    """Serve the pages in `root` to this machine, each changed so; yield their address."""
    handler = partial(_Pages, change, directory=str(root.resolve()))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
