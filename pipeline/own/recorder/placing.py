"""The command `ask --real`: what was judged with a composited item is judged again with a real one."""

from base64 import b64decode
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own import files
from pipeline.own.asked import REAL, Sitting, real_trials
from pipeline.own.files import SCENES, Faults
from pipeline.own.folder import Folder
from pipeline.own.frame import rectify
from pipeline.own.pictures import read_picture
from pipeline.own.recorder.asking import Asking
from pipeline.own.recorder.designing import placed
from pipeline.own.recorder.serve import posted
from pipeline.own.recorder.storage import as_sent
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write


class Placing(Asking):
    """Second answers to the trials of `ask` that had an item near the path, each about the person's photograph."""

    def __init__(self, folder: Folder, user: str | None, minutes: float) -> None:
        """Open a folder whose users have answered `ask`; raise InputError if none has."""
        super().__init__(folder, user, minutes)
        self.more.append(posted("photograph", self.take))
        self.first = {name: self.kept[name] for name in self.users if name in self.kept}
        self.users = [name for name, sitting in self.first.items() if len(real_trials(sitting))]
        if not self.users:
            ask = f"python -m pipeline.own ask {quote(str(folder.path))}"
            raise InputError(f"no item was judged yet: {ask} comes before --real")
        plans = {name: self.files[name] for name in self.users}
        self.files = {name: plan.with_name(f"{plan.stem}{REAL}.json") for name, plan in plans.items()}
        self.kept = {name: Sitting.read(plan, self.files[name].with_suffix(".csv")) for name, plan in plans.items()}

    def rows(self, user: str) -> list[int]:
        """Return the trials with a near item that have no second answer, scene by scene: tables are set anew."""
        trials = real_trials(self.first[user])
        return [row for row in trials.sort_values("scene", kind="stable").index if row not in self.kept[user].answers]

    def beside(self, user: str, row: int | None) -> dict[str, Any]:
        """Return what to place and where to send its photograph, until there is one."""
        if row is None:
            return {}
        if (file := self.photograph(user, row)).is_file():
            note = "This is your photograph. Do you accept the path? You may choose another picture."
            return {"note": note, "taken": str(file.stat().st_mtime_ns)}
        (trial,) = self.kept[user].plan.loc[[row]].itertuples()
        note = f"Set the table as the picture shows it: {self.folder.scenes[trial.scene]}, and a real "
        note += f"{placed(self.folder, trial)}. Photograph it from where the camera of {SCENES}/ stood, and choose "
        return {"note": note + "that photograph here.", "wanted": True}

    def photograph(self, user: str, row: int) -> Path:
        """Return where a photograph lies, or will."""
        return self.files[user].with_suffix("") / f"{row}"

    @as_sent
    def take(self, user: str, trial: int, picture: str) -> dict[str, Any]:
        """Store a photograph, a data URL, and return its trial; raise InputError if it cannot be the table's."""
        plan = self.sitting(user).plan
        if not 0 <= trial < len(plan):
            raise InputError("there is no such trial: reload the page")
        original = files.scene_files(self.folder.path, Faults())[self.folder.scenes[plan["scene"].iloc[trial]]]
        rows, columns = read_picture(original, original.name).shape[:2]

        def store(part: Path) -> None:
            part.write_bytes(b64decode(picture.partition(",")[2]))
            size = read_picture(part, "the photograph").shape[:2]
            if size != (rows, columns):
                where = f"expected {columns} x {rows}, from the same place as {original.name}"
                raise InputError(f"the photograph has {size[1]} x {size[0]} pixels: {where}")

        with self.lock:
            atomic_write(self.photograph(user, trial), store)
            return self.shown(user)

    def store(self, user: str, sitting: Sitting) -> None:
        """Store answers as `Asking`; raise InputError for one about a table that was not photographed."""
        if not all(self.photograph(user, trial).is_file() for trial in sitting.answers):
            raise InputError("photograph the table first, and choose the picture")
        super().store(user, sitting)

    def drawn(self, user: str, row: Any) -> UInt8[Array, "side side 3"]:
        """Return the rectified photograph of a trial, or the composited table before there is one."""
        file = self.photograph(user, row.Index)
        if not file.is_file():
            return super().drawn(user, row)
        settings = files.read_settings(self.folder.path)
        corners = settings.corners_of(self.folder.scenes[row.scene])
        return rectify(read_picture(file, file.name), corners, np.array(settings.size_m))
