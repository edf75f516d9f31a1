"""The command `record`: a page on this machine only, the pictures, and the few requests that change the folder.

What serves it serves `ask`, too.
"""

import argparse
import fcntl
import os
import shlex
import socket
import threading
import webbrowser
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import uvicorn
from pydantic import TypeAdapter, ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

import pipeline.report
from pipeline.legend import INVALID, VALID
from pipeline.own.recorder.storage import Recordings
from pipeline.runtime.errors import InputError

LOOPBACK = "127.0.0.1"
LOCK = ".recorder.lock"  # in the folder; held by the recorder's process, holds its address
BESIDE = Path(__file__).parent
STYLES = BESIDE / "recorder.css", Path(pipeline.report.__path__[0]) / "page.css"  # the latter is the report's own
STATIC = [*STYLES, *BESIDE.glob("*.js"), BESIDE / "icon.svg"]
HEADERS = {  # forbid everything that is not of this server
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
Opened = TypeVar("Opened")  # what a page shows and changes
COLOURS = {"valid": VALID, "invalid": INVALID}
SENT = TypeAdapter(dict[str, Any])  # the arguments of a method of `Recordings`, which checks them


def main(arguments: Sequence[str]) -> int:
    """Serve the recorder's page; return 0 after Ctrl-C. Raise InputError if the folder cannot be recorded into."""
    parsed = parser("record", "Open a page to draw and judge paths.").parse_args(arguments)

    def ended(recordings: Recordings) -> str:
        check = f"python -m pipeline.own check {shlex.quote(str(parsed.folder))}"
        return f"{parsed.folder} holds {len(recordings.recorded())} paths. Next: {check}"

    return serve(parsed, lambda: Recordings(parsed.folder), routes, "Recording into", ended)


def parser(command: str, description: str) -> argparse.ArgumentParser:
    """Return the arguments of every command that serves a page about a folder."""
    made = argparse.ArgumentParser(f"python -m pipeline.own {command}", description=description)
    made.add_argument("folder", type=Path, help="has pictures in FOLDER/scenes; what people say is written beside them")
    made.add_argument("--port", type=int, default=0, help="0, the default, takes any that is free")
    made.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    return made


def serve(
    parsed: argparse.Namespace,
    opened: Callable[[], Opened],
    addresses: Callable[[Opened], Sequence[Route]],
    doing: str,
    ended: Callable[[Opened], str],
) -> int:
    """Serve what is opened under the folder's lock; print the last word after Ctrl-C."""
    folder: Path = parsed.folder
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}: make it, with pictures of the table in {folder}/scenes")
    try:
        listener = socket.create_server((LOOPBACK, parsed.port))
    except (OSError, OverflowError) as error:
        raise InputError(f"port {parsed.port} cannot be used ({error}): choose another, or 0 for any") from error
    with listener, one_recorder(folder) as lock:
        port = listener.getsockname()[1]
        holds, address = opened(), f"http://{LOOPBACK}:{port}/"
        app = application(addresses(holds), {f"{LOOPBACK}:{port}", f"localhost:{port}"})
        os.ftruncate(lock, 0)
        os.pwrite(lock, address.encode(), 0)
        print(f"{doing} {folder}: open {address} (Ctrl-C ends)", flush=True)
        if not parsed.no_browser:
            threading.Timer(0.5, webbrowser.open, [address]).start()
        config = uvicorn.Config(app, log_level="warning", access_log=False, lifespan="off", ws="none")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])
        print(ended(holds))
    return 0


@contextmanager
def one_recorder(folder: Path) -> Iterator[int]:
    """Hold the folder's lock, which ends with this process; yield its file. Raise InputError if another holds it."""
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield lock
    except BlockingIOError as error:
        address = os.read(lock, 100).decode() or "another address"
        raise InputError(f"a recorder has {folder} open already, at {address}: use it, or end it first") from error
    finally:
        os.close(lock)


def routes(recordings: Recordings) -> list[Route]:
    """Return the addresses under which the page records into a folder."""
    return [
        Route("/", lambda _: FileResponse(BESIDE / "page.html")),
        Route("/pictures/{name}", lambda request: FileResponse(recordings.picture(request.path_params["name"]))),
        Route("/api/overview", lambda _: JSONResponse(recordings.overview() | {"colours": COLOURS})),
        Route("/api/scenes/{name}", lambda request: JSONResponse(recordings.scene(request.path_params["name"]))),
        Route("/api/items/{name}", lambda request: JSONResponse(recordings.items(request.path_params["name"]))),
        Route("/api/found/{name}", lambda request: JSONResponse(recordings.found(request.path_params["name"]))),
        posted("propose", recordings.propose),
        posted("items", recordings.place_items),
        posted("paths", recordings.add_path),
        posted("table", recordings.place_table),
        posted("judge", recordings.judge),
        posted("remove", recordings.remove),
    ]


def posted(name: str, store: Callable[..., Any]) -> Route:
    """Return the route of a request that changes something: `store` gets what the page sent, and answers."""

    async def answer(request: Request) -> Response:
        values = SENT.validate_json(await request.body())
        return JSONResponse(await run_in_threadpool(partial(store, **values)) or {})

    return Route(f"/api/{name}", answer, methods=["POST"])


def application(routes: Sequence[Route], hosts: Collection[str]) -> Starlette:
    """Return an application of these routes and the static files, which answers under `hosts` only."""

    async def guard(request: Request, answer: Callable[[Request], Any]) -> Response:
        # a foreign Host betrays DNS rebinding, a foreign Origin another site's script; changes must name their origin
        head, origins = request.headers, {f"http://{host}" for host in hosts}
        known = head.get("host") in hosts and head.get("sec-fetch-site", "none") in ("same-origin", "none")
        if known and (head.get("origin") in origins or (request.method == "GET" and "origin" not in head)):
            response = await answer(request)
        else:
            response = _refused("refused: the recorder answers its own page alone, under the address it printed", 403)
        response.headers.update(HEADERS)
        return response

    unknown = "the recorder does not understand what the page sent: reload the page"
    static = [Route(f"/static/{file.name}", lambda _, file=file: FileResponse(file)) for file in STATIC]
    return Starlette(
        routes=[*routes, *static],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=guard)],
        exception_handlers={
            InputError: lambda _, error: _refused(str(error), 400),
            ValidationError: lambda _, error: _refused(unknown, 400),
            OSError: lambda _, error: _refused(f"not stored: {error}", 500),
        },
    )


def _refused(sentence: str, status: int) -> JSONResponse:
    return JSONResponse({"error": sentence}, status)
