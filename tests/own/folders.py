"""A small folder of a person's own table, for tests to break."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from pipeline.own.folder import Folder, read_folder
from pipeline.own.recorder.asking import Asking
from pipeline.world.bezier import curve
from tests.factories import RED, WHITE, draw_table

SCENES = ("breakfast", "Mittag", "夕食", "tea")
USERS = ("Ana", "Jürgen")
COLUMNS = ["scene", "user", "demo", "t", "x", "y", "valid"]


def make_folder(path: Path) -> Path:
    """Four scenes of two discs, two users, four demonstrations a scene: those that pass on the right are invalid."""
    (path / "scenes").mkdir(parents=True)
    parts = []
    for i, scene in enumerate(SCENES):
        picture = draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE), seed=i)
        write_picture(path / "scenes" / f"{scene}.png", picture)
        for user in USERS:
            for demo, bend in enumerate((0.9, 0.6, 0.4, 0.2)):
                points = curve(np.array([bend, 1 - bend]), 12)
                table = pd.DataFrame({"t": np.arange(12) / 10, "x": points[:, 0], "y": points[:, 1]})
                parts.append(table.assign(scene=scene, user=user, demo=demo, valid="false" if demo < 2 else "true"))
    pd.concat(parts)[COLUMNS].to_csv(path / "demonstrations.csv", index=False)
    return path


def whole(path: Path) -> Folder:
    """Read a folder that has no fault."""
    folder, faults = read_folder(path)
    assert folder is not None and not faults, faults
    return folder


def answer(asking: Asking, count: int, user: str = "Ana", accepts: Callable[[int], bool] | None = None) -> dict:
    """Answer so many trials by their number, or yes and no in turn; what is shown next."""
    told = asking.begin(user=user)
    for i in range(count):
        valid = accepts(told["trial"]) if accepts else i % 2 == 0
        told = asking.answer(user=user, trial=told["trial"], valid=valid, response_ms=900.0)
    return told


def write_picture(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    colours = cv2.COLOR_RGBA2BGRA if pixels.shape[2] == 4 else cv2.COLOR_RGB2BGR
    path.write_bytes(cv2.imencode(path.suffix, cv2.cvtColor(pixels, colours))[1].tobytes())


def add_kind(path: Path, rows: str = "cup,blue.png,0.12\n") -> None:
    """The cut-out of a cup, an opaque blue disc, and kinds.csv with these rows."""
    disc = np.zeros((64, 64, 4), np.uint8)
    cv2.circle(disc, (32, 32), 28, (200, 60, 40, 255), -1)
    write_picture(path / "kinds" / "cup" / "blue.png", disc)
    (path / "kinds.csv").write_text("kind,file,width_m\n" + rows)


def edit(path: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Change demonstrations.csv, whose cells are text."""
    table = pd.read_csv(path / "demonstrations.csv", dtype=str, keep_default_na=False)
    change(table).to_csv(path / "demonstrations.csv", index=False)


def change(path: Path, row: int, column: str, value: str) -> None:
    """Change one cell of demonstrations.csv; rows count as in a spreadsheet."""
    edit(path, lambda table: table.assign(**{column: table[column].where(table.index != row - 2, value)}))
