"""The recorder's web application: a page, the pictures, and the few requests that change the folder."""

from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

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

BESIDE = Path(__file__).parent
STATIC = {name: BESIDE / name for name in ("recorder.css", "recorder.js", "canvas.js", "tools.js", "icon.svg")}
STATIC["page.css"] = Path(pipeline.report.__path__[0]) / "page.css"  # the report's own style
MAX_UPLOAD_BYTES = 25_000_000  # of one picture; a phone's has some 5 MB
MAX_REQUEST_BYTES = 4_000_000  # of a path: half an hour at 60 samples a second
HEADERS = {  # forbid everything that is not of this server
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
SENT = TypeAdapter(dict[str, Any])  # the arguments of a method of `Recordings`, which checks them


class TooLarge(Exception):
    """More data came than a request may carry."""


def build(recordings: Recordings, hosts: Collection[str]) -> Starlette:
    """Return the application that records into a folder and answers under `hosts`, such as `127.0.0.1:8000`, only."""

    def static(request: Request) -> Response:
        file = STATIC.get(request.path_params["name"])
        return FileResponse(file) if file else Response(status_code=404)

    def overview(_: Request) -> Response:
        drawn = {"colours": {"valid": VALID, "invalid": INVALID}, "max_upload_bytes": MAX_UPLOAD_BYTES}
        return JSONResponse(recordings.overview() | drawn)

    def posted(name: str, store: Callable[..., Any], status: int) -> Route:
        async def answer(request: Request) -> Response:
            values = SENT.validate_json(await body_of(request, MAX_REQUEST_BYTES))
            return JSONResponse(await run_in_threadpool(partial(store, **values)) or {}, status)

        return Route(f"/api/{name}", answer, methods=["POST"])

    async def add_picture(request: Request) -> Response:
        content = await body_of(request, MAX_UPLOAD_BYTES)
        name = await run_in_threadpool(recordings.import_picture, request.query_params.get("name", ""), content)
        return JSONResponse({"scene": name}, 201)

    async def guard(request: Request, answer: Callable[[Request], Any]) -> Response:
        """Answer the recorder's own page alone.

        A foreign Host betrays DNS rebinding, a foreign Origin another site's script. Requests that change something
        must name their origin.
        """
        origins = {f"http://{host}" for host in hosts} | ({None} if request.method in ("GET", "HEAD") else set())
        if request.headers.get("host") not in hosts:
            response = _refused("refused: the recorder answers only under the address that it printed", 403)
        elif request.headers.get("origin") not in origins:
            response = _refused("refused: the request comes from another page than the recorder's", 403)
        elif request.headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            response = _refused("refused: the request comes from another site", 403)
        else:
            response = await answer(request)
        response.headers.update(HEADERS)
        return response

    return Starlette(
        routes=[
            Route("/", lambda _: FileResponse(BESIDE / "page.html")),
            Route("/static/{name}", static),
            Route("/pictures/{name}", lambda request: FileResponse(recordings.picture(request.path_params["name"]))),
            Route("/api/overview", overview),
            Route("/api/scenes/{name}", lambda request: JSONResponse(recordings.scene(request.path_params["name"]))),
            posted("paths", recordings.add_path, 201),
            posted("items", recordings.add_item, 201),
            posted("table", recordings.place_table, 200),
            posted("remove", recordings.remove, 200),
            Route("/api/pictures", add_picture, methods=["POST"]),
        ],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=guard)],
        exception_handlers={
            InputError: lambda _, error: _refused(str(error), 400),
            TooLarge: lambda _, error: _refused(str(error), 413),
            ValidationError: lambda _, error: _refused(
                "the recorder does not understand what the page sent: reload the page", 400
            ),
            OSError: lambda _, error: _refused(f"not stored: {error}", 500),
        },
    )


async def body_of(request: Request, limit: int) -> bytes:
    """Return a request's body; raise TooLarge as soon as it is longer than `limit` bytes."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limit:
            raise TooLarge(f"more than {limit / 1e6:.0f} MB were sent: choose a smaller file")
    return bytes(body)


def _refused(sentence: str, status: int) -> JSONResponse:
    return JSONResponse({"error": sentence}, status)
