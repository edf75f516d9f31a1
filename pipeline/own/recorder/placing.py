"""The command `ask --real`: what was judged with a composited item is judged again with a real one."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from pipeline.own import files
from pipeline.own.asked import REAL, Sitting, real_trials
from pipeline.own.files import SCENES, Faults
from pipeline.own.folder import Folder
from pipeline.own.frame import rectify
from pipeline.own.recorder.asking import Asking
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

MAX_PICTURE_BYTES = 50_000_000


class Placing(Asking):
    """Second answers to the trials of `ask` that had an item near the path, each about the person's photograph."""

    def __init__(self, folder: Folder, user: str | None, minutes: float) -> None:
        """Open a folder whose users have answered `ask`; raise InputError if none has."""
        super().__init__(folder, user, minutes)
        self.first = {name: self.kept[name] for name in self.users if name in self.kept}
        self.users = [name for name, sitting in self.first.items() if len(real_trials(sitting))]
        if not self.users:
            raise InputError(f"no item was judged yet: python -m pipeline.own ask {folder.path} comes before --real")
        for name in self.users:
            plan = self.files[name]
            self.files[name] = plan.with_name(f"{plan.stem}{REAL}.json")
            self.kept[name] = Sitting.read(plan, self.files[name].with_suffix(".csv"))

    @property
    def more(self) -> list[Route]:
        """Return the address that takes photographs."""

        async def taken(request: Request) -> Response:
            body = bytearray()
            async for chunk in request.stream():
                body += chunk
                if len(body) > MAX_PICTURE_BYTES:
                    raise InputError(f"the picture has more than {MAX_PICTURE_BYTES / 1e6:.0f} MB: send a smaller one")
            number, trial = request.path_params["number"], request.path_params["trial"]
            return JSONResponse(await run_in_threadpool(self.take, number, trial, bytes(body)))

        return [Route("/photographs/{number}/{trial:int}", taken, methods=["POST"])]

    def rows(self, user: str) -> list[int]:
        """Return the trials with a near item that have no second answer, scene by scene: tables are set anew."""
        trials = real_trials(self.first[user])
        return [row for row in trials.sort_values("scene", kind="stable").index if row not in self.kept[user].answers]

    def beside(self, user: str, row: int | None) -> dict[str, Any]:
        """Return what to place and where to send its photograph, until there is one."""
        if row is None:
            return {}
        if self.photograph(user, row).is_file():
            return {"note": "This is your photograph. Do you accept the path?", "taken": True}
        kind, scene = self.kept[user].plan.loc[row, ["condition", "scene"]]
        shown = f"Set the table as this picture of {self.folder.scenes[scene]} shows it"
        note = f"{shown}, with a real {kind} where it has one. Photograph it from where the camera of {SCENES}/ stood, "
        note += "and choose that picture."
        return {"note": note, "photograph": f"/photographs/{self.files[user].stem}/{row}"}

    def photograph(self, user: str, row: int) -> Path:
        """Return where a photograph lies, or will."""
        return self.files[user].with_suffix("") / f"{row}"

    def take(self, number: str, trial: int, content: bytes) -> dict[str, Any]:
        """Store a photograph and return its trial; raise InputError if it is none, or not of the scene's size."""
        user = self.user_of(number, trial)
        file = self.photograph(user, trial)
        file.parent.mkdir(exist_ok=True)
        scene = self.folder.scenes[self.kept[user].plan["scene"].iloc[trial]]
        original = files.scene_files(self.folder.path, Faults())[scene]

        def store(part: Path) -> None:
            part.write_bytes(content)
            pictures = files.read_picture(part, "the photograph"), files.read_picture(original, original.name)
            (rows, columns), (old_rows, old_columns) = (one.shape[:2] for one in pictures)
            if (rows, columns) != (old_rows, old_columns):
                expected = f"expected {old_columns} x {old_rows}, from the same place as {original.name}"
                raise InputError(f"the photograph has {columns} x {rows} pixels: {expected}")

        with self.lock:
            atomic_write(file, store)
            return self.shown(user)

    def drawn(self, user: str, row: Any) -> UInt8[Array, "side side 3"]:
        """Return the rectified photograph of a trial, or the composited table before there is one."""
        file = self.photograph(user, row.Index)
        if not file.is_file():
            return super().drawn(user, row)
        settings = files.read_settings(self.folder.path)
        corners = settings.corners_of(self.folder.scenes[row.scene])
        return rectify(files.read_picture(file, file.name), corners, np.array(settings.size_m))
