"""The command `ask`: trials one at a time, and each answer stored before the next is shown.

`Asking` asks what was planned. `Designing` (ask --design) and `Placing` (ask --real) ask otherwise.
"""

import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from pydantic import FiniteFloat
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from pipeline.causal import experiment
from pipeline.causal.experiment import EXTRA, STICKER, UNCHANGED, due, pairs_within, smallest_settled
from pipeline.own.asked import ANSWERS, ASKED, Sitting, digest, picture, sittings
from pipeline.own.files import KINDS
from pipeline.own.folder import Folder, read_folder
from pipeline.own.frame import CANVAS_PX
from pipeline.own.recorder.serve import BESIDE, parser, posted, serve
from pipeline.own.recorder.storage import as_sent, write_durably
from pipeline.own.trials import has_report, prepare
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import one_thread

SECONDS = 4  # of a judgement, before there is any
LONGEST_MS = 60_000  # of an answer that counts as time at work: people are called away


class Asking:
    """One folder's sittings. Its methods may be called from several threads."""

    suffix = ""  # of the stems of the sittings' files

    def __init__(self, folder: Folder, user: str | None, minutes: float) -> None:
        """Open a folder for one user, or for all with demonstrations; raise InputError for an unknown one."""
        if user is not None and user not in folder.users:
            raise InputError(f"there is no user {user!r}: expected one of {', '.join(folder.users)}, or no --user")
        if taken := sorted({UNCHANGED, STICKER, EXTRA} & folder.cutouts.keys()):
            raise InputError(f"{KINDS}/{taken[0]}: `ask` uses this name: expected another name, in every file")
        self.folder, self.minutes, self.digest = folder, minutes, digest(folder.path)
        self.users = [user] if user else folder.users
        self.lock, self.more = Lock(), list[Route]()  # more: further addresses
        self.files: dict[str, Path] = {}  # of each user's sitting
        self.kept: dict[str, Sitting] = {}
        earlier = sittings(folder.path, self.suffix)
        for file, sitting in earlier.items():
            if sitting.digest == self.digest:
                self.kept[sitting.user], self.files[sitting.user] = sitting, file
        self.apart = sum(sitting.digest != self.digest for sitting in earlier.values())

    @as_sent
    def begin(self, user: str) -> dict[str, Any]:
        """Return a user's next trial, after writing the sitting if it is the first one."""
        if user not in self.users:
            raise InputError(f"there is no user {user!r} here: reload the page")
        sitting = {} if user in self.kept else self.prepared(user)  # takes seconds, in which others may answer
        with self.lock:
            if user not in self.kept:
                if crowded := sitting.get("no_room_for"):
                    print(f"No free place near a path of {user} for: {', '.join(crowded)}", flush=True)
                number = max((int(file.stem[:3]) for file in sittings(self.folder.path, self.suffix)), default=0) + 1
                file = self.folder.path / ASKED / f"{number:03d}{self.suffix}.json"
                write_durably(file, json.dumps(sitting, ensure_ascii=False, indent=1))
                self.files[user], self.kept[user] = file, Sitting.read(file)
            return self.shown(user)

    @as_sent
    def answer(self, user: str, trial: int, valid: bool, response_ms: FiniteFloat) -> dict[str, Any]:
        """Store an answer and return the next trial; InputError if another trial is due: another window answered."""
        with self.lock:
            sitting = self.sitting(user)
            if trial != self.next(user)[0]:
                raise InputError("this was answered in another window: go on with the trial shown now")
            times = [*sitting.response_ms, max(response_ms, 0.0)]
            self.store(user, replace(sitting, answers=sitting.answers | {trial: valid}, response_ms=times))
            return self.shown(user)

    @as_sent
    def undo(self, user: str) -> dict[str, Any]:
        """Remove a user's last answer and return its trial."""
        with self.lock:
            sitting = self.sitting(user)
            if not sitting.answers:
                raise InputError("there is no answer to take back")
            answers = dict(list(sitting.answers.items())[:-1])
            self.store(user, replace(sitting, answers=answers, response_ms=sitting.response_ms[:-1]))
            return self.shown(user)

    def prepared(self, user: str) -> dict[str, Any]:
        """Return a user's new sitting, as its file holds it."""
        return prepare(self.folder, user, f"{self.digest}/{user}")

    def rows(self, user: str) -> list[int]:
        """Return the rows of a user's plan that are to be asked next, in order."""
        return due(self.kept[user].plan, self.kept[user].answers)

    def beside(self, user: str, row: int | None) -> dict[str, Any]:
        """Return what the page shows beside the picture of a row, or in the end."""
        return {}

    def sitting(self, user: str) -> Sitting:
        """Return a user's sitting; raise InputError if it has not begun."""
        if user not in self.kept:
            raise InputError("choose first who judges: reload the page")
        return self.kept[user]

    def store(self, user: str, sitting: Sitting) -> None:
        """Replace the file of a user's answers, then what is remembered."""
        rows = zip(sitting.answers.items(), sitting.response_ms, strict=True)
        lines = [",".join(ANSWERS), *(f"{trial},{valid},{ms:.0f}" for (trial, valid), ms in rows)]
        write_durably(self.files[user].with_suffix(".csv"), "\n".join(lines) + "\n")
        self.kept[user] = sitting

    def shown(self, user: str) -> dict[str, Any]:
        """Return what the page shows: the next trial, or none once the minutes are over or all is asked.

        `Asking` sends points [px] of the path and the address of a picture, which do not tell the condition.
        """
        sitting, (row, left) = self.kept[user], self.next(user)
        told = {"trial": row, "answered": len(sitting.answers), "left_s": round(left), "apart": self.apart}
        if row is not None:
            points = self.folder.frame.to_model(np.array(sitting.paths[sitting.plan["path"].iloc[row]]["points"]))
            told["points"] = ((points * [1, -1] + [0, 1]) * CANVAS_PX).round(1).tolist()
            told["picture"] = f"/trials/{self.files[user].stem}/{row}"
        return told | self.beside(user, row)

    def next(self, user: str) -> tuple[int | None, float]:
        """Return the row that is asked next, if any, and the time that is left [s]."""
        spent = sum(min(ms, LONGEST_MS) for ms in self.kept[user].response_ms) / 1000
        left = max(0.0, 60 * self.minutes - spent)
        rows = self.rows(user) if left > 0 else []
        return (rows[0] if rows else None), left

    def image(self, number: str, row: int) -> bytes:
        """Return the PNG of a row of a sitting's plan; raise InputError if there is none."""
        user = next((user for user, file in self.files.items() if file.stem == number), None)
        if user is None or not 0 <= row < len(self.kept[user].plan):
            raise InputError("there is no such trial: reload the page")
        return png(self.drawn(user, next(self.kept[user].plan.iloc[[row]].itertuples())))

    def drawn(self, user: str, row: Any) -> UInt8[Array, "side side 3"]:
        """Return the picture of a row of a user's plan."""
        return picture(self.folder, row)


def png(pixels: UInt8[Array, "row column 3"]) -> bytes:
    """Return a picture as PNG."""
    return cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1].tobytes()


def routes(asking: Asking) -> list[Route]:
    """Return the addresses under which the page asks."""
    return [
        Route("/", lambda _: FileResponse(BESIDE / "ask.html")),
        Route("/trials/{number}/{row:int}", lambda r: Response(asking.image(**r.path_params), media_type="image/png")),
        Route("/api/overview", lambda _: JSONResponse({"users": asking.users})),
        posted("begin", asking.begin),
        posted("answer", asking.answer),
        posted("undo", asking.undo),
        *asking.more,
    ]


def main(arguments: Sequence[str]) -> int:
    """Serve the page that asks; return 0 after Ctrl-C. Raise InputError for a folder with faults."""
    parse = parser("ask", "Ask people about paths with and without a composited item.")
    parse.add_argument("--user", help="default: the page asks who judges")
    parse.add_argument("--minutes", type=float, default=10.0, help="of judging, in all sittings about this folder")
    other = parse.add_mutually_exclusive_group()
    other.add_argument("--real", action="store_true", help="judge again, with photographs of real items")
    other.add_argument("--design", action="store_true", help="show the tables that tell most about the person's rule")
    parsed = parse.parse_args(arguments)
    if not 0 < parsed.minutes <= 600:
        raise InputError(f"--minutes is {parsed.minutes:g}: expected minutes above 0 and up to 600")
    one_thread()  # as the report, whose detector should find the same
    quoted = shlex.quote(str(parsed.folder))
    folder, faults = read_folder(parsed.folder)
    if folder is None:
        raise InputError(f"{faults[0]} (python -m pipeline.own check {quoted} says all)")
    kind = Asking
    if parsed.design:
        from pipeline.own.recorder.designing import Designing as kind  # which imports this module
    elif parsed.real:
        from pipeline.own.recorder.placing import Placing as kind

    def opened() -> Asking:
        asking = kind(folder, parsed.user, parsed.minutes)  # under the folder's lock: earlier answers are all written
        if asking.apart:
            print(f"The folder has changed since {asking.apart} earlier sittings: their answers are kept apart")
        for line in [] if parsed.design or parsed.real else outlook(folder, quoted, parsed.minutes):
            print(line)
        return asking

    def ended(asking: Asking) -> str:
        count = sum(len(sitting.answers) for sitting in asking.kept.values())
        then = "" if parsed.design else f" Next: python -m pipeline.own {quoted}"
        return f"{folder.path / ASKED} holds {count} of these judgements.{then}"

    return serve(parsed, opened, routes, "Asking about", ended)


def outlook(folder: Folder, quoted: str, minutes: float) -> list[str]:
    """Return what a sitting will not ask, and what its minutes settle; quoted: the folder, as a shell reads it."""
    lines, judgements, count = [], 60 * minutes / SECONDS, len(folder.cutouts)
    if not has_report(folder.path):
        none = "There is no report on the folder as it is"
        lines.append(f"{none}: new sittings ask about no repair, not even after a later report.")
        lines.append(f"To ask about repairs, end this and run first: python -m pipeline.own {quoted}")
    named = {kind for items in folder.told.values() for kind, *_ in items if kind}
    if unasked := sorted(named - set(folder.cutouts)):
        lines.append(f"Without a cut-out in {KINDS}/ these kinds are not asked about: {', '.join(unasked)}")
    if count:
        pairs = min(pairs_within(int(judgements), count), experiment.LOOKS[0])  # then it is asked no more
        ruled_out = f"they rule out effects on more than {smallest_settled(pairs):.0%} of answers, of {count} kinds"
        told = f"where no answer changes, {ruled_out}" if pairs else "too few for a verdict"
        lines.append(f"{minutes:g} minutes are some {judgements:.0f} judgements: {told}")
        needed = next(n for n in range(99) if count * 2 ** (1 - n) < experiment.SPENT[0])  # scenes that all change
        for user, scenes in folder.demos[folder.demos["valid"]].groupby("user")["scene"].nunique().items():
            if scenes < needed:
                lines.append(f"{user} calls paths valid in {scenes} scenes: fewer than {needed} make no effect certain")
    return lines
