"""The recorder's web application: a page, the pictures, and the few requests that change the folder."""

from collections.abc import Collection
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

import pipeline.report
from pipeline.legend import INVALID, VALID
from pipeline.own.recorder.guard import Guard, TooLarge, body_of
from pipeline.own.recorder.storage import Recordings
from pipeline.runtime.errors import InputError

BESIDE = Path(__file__).parent
STATIC = {name: BESIDE / name for name in ("recorder.css", "recorder.js", "canvas.js", "tools.js", "icon.svg")}
STATIC["page.css"] = Path(pipeline.report.__path__[0]) / "page.css"  # the report's own style
MAX_UPLOAD_BYTES = 25_000_000  # of one picture; a phone's has some 5 MB
MAX_REQUEST_BYTES = 4_000_000  # of a path: half an hour at 60 samples a second
Point = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
Sample = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]


class Sent(BaseModel):
    """Validate what a page sends."""

    model_config = ConfigDict(extra="forbid", strict=True)


class SentPath(Sent):
    """Hold a drawn path: samples of t [ms], column and row [px]."""

    scene: str
    user: str
    valid: bool
    samples: list[Sample] = Field(min_length=1, max_length=100_000)


class SentItem(Sent):
    """Hold an item: centre and rim, or both ends and a side [px]."""

    scene: str
    kind: str
    points: list[Point] = Field(min_length=2, max_length=3)


class SentTable(Sent):
    """Hold the table: corners [px] in one scene or everywhere, or null to leave them; lengths in metres."""

    scene: str
    everywhere: bool
    corners: Annotated[list[Point], Field(min_length=4, max_length=4)] | None
    side_m: FiniteFloat
    start: Point
    goal: Point


class Removal(Sent):
    """Name what to remove: a path or an item, by its id."""

    what: Literal["path", "item"]
    id: str


def build(recordings: Recordings, hosts: Collection[str]) -> Starlette:
    """Return the application that records into a folder and answers under `hosts` only."""

    async def page(_: Request) -> Response:
        return FileResponse(BESIDE / "page.html")

    async def static(request: Request) -> Response:
        file = STATIC.get(request.path_params["name"])
        return FileResponse(file) if file else Response(status_code=404)

    async def overview(_: Request) -> Response:
        drawn = {"colours": {"valid": VALID, "invalid": INVALID}, "max_upload_bytes": MAX_UPLOAD_BYTES}
        return JSONResponse(await run_in_threadpool(recordings.overview) | drawn)

    async def scene(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(recordings.scene, request.path_params["name"]))

    async def picture(request: Request) -> Response:
        return FileResponse(await run_in_threadpool(recordings.picture, request.path_params["name"]))

    async def add_path(request: Request) -> Response:
        sent = SentPath.model_validate_json(await body_of(request, MAX_REQUEST_BYTES))
        samples = np.array(sent.samples, float)
        stored = await run_in_threadpool(recordings.add_path, sent.scene, sent.user, sent.valid, samples)
        return JSONResponse(stored, 201)

    async def add_item(request: Request) -> Response:
        sent = SentItem.model_validate_json(await body_of(request, MAX_REQUEST_BYTES))
        await run_in_threadpool(recordings.add_item, sent.scene, sent.kind, np.array(sent.points, float))
        return JSONResponse({}, 201)

    async def place_table(request: Request) -> Response:
        sent = SentTable.model_validate_json(await body_of(request, MAX_REQUEST_BYTES))
        values = sent.model_dump() | {"corners": None if sent.corners is None else np.array(sent.corners, float)}
        await run_in_threadpool(partial(recordings.place_table, **values))
        return JSONResponse({})

    async def remove(request: Request) -> Response:
        sent = Removal.model_validate_json(await body_of(request, MAX_REQUEST_BYTES))
        action = recordings.remove_path if sent.what == "path" else recordings.remove_item
        await run_in_threadpool(action, sent.id)
        return JSONResponse({})

    async def add_picture(request: Request) -> Response:
        content = await body_of(request, MAX_UPLOAD_BYTES)
        name = await run_in_threadpool(recordings.import_picture, request.query_params.get("name", ""), content)
        return JSONResponse({"scene": name}, 201)

    return Starlette(
        routes=[
            Route("/", page),
            Route("/static/{name}", static),
            Route("/pictures/{name}", picture),
            Route("/api/overview", overview),
            Route("/api/scenes/{name}", scene),
            Route("/api/paths", add_path, methods=["POST"]),
            Route("/api/items", add_item, methods=["POST"]),
            Route("/api/table", place_table, methods=["POST"]),
            Route("/api/remove", remove, methods=["POST"]),
            Route("/api/pictures", add_picture, methods=["POST"]),
        ],
        middleware=[Middleware(Guard, hosts=hosts)],
        exception_handlers={
            InputError: lambda _, error: _refused(str(error), 400),
            TooLarge: lambda _, error: _refused(str(error), 413),
            ValidationError: lambda _, error: _refused("the page sent what the recorder does not know: reload it", 400),
            OSError: lambda _, error: _refused(f"not stored: {error}", 500),
        },
    )


def _refused(sentence: str, status: int) -> JSONResponse:
    return JSONResponse({"error": sentence}, status)
