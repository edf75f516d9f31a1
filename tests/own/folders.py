"""A small folder of a person's own table, for tests to break."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from pipeline.world.bezier import curve
from tests.factories import RED, WHITE, draw_table

SCENES = ("breakfast", "Mittag", "夕食", "tea")
USERS = ("Ana", "Jürgen")
COLUMNS = ["scene", "user", "demo", "t", "x", "y", "valid"]


def make_folder(path: Path) -> Path:
    """Four scenes of two discs, two users, four demonstrations a scene: those that pass on the right are invalid."""
    (path / "scenes").mkdir(parents=True)
    for i, scene in enumerate(SCENES):
        write_picture(
            path / "scenes" / f"{scene}.png", draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE), seed=i)
        )
    parts = []
    for scene in SCENES:
        for user in USERS:
            for demo, bend in enumerate((0.9, 0.6, 0.4, 0.2)):
                points = curve(np.array([bend, 1 - bend]), 12)
                table = pd.DataFrame({"t": np.arange(12) / 10, "x": points[:, 0], "y": points[:, 1]})
                parts.append(table.assign(scene=scene, user=user, demo=demo, valid="false" if demo < 2 else "true"))
    pd.concat(parts)[COLUMNS].to_csv(path / "demonstrations.csv", index=False)
    return path


def write_picture(path: Path, pixels: np.ndarray) -> None:
    path.write_bytes(cv2.imencode(path.suffix, cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1].tobytes())


def write_cutout(path: Path, colour: tuple[int, int, int] = (40, 60, 200)) -> None:
    """An opaque disc on a transparent ground, BGR."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.zeros((64, 64, 4), np.uint8)
    cv2.circle(pixels, (32, 32), 28, (*colour, 255), -1)
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def demonstrations(path: Path) -> pd.DataFrame:
    """The csv as text."""
    return pd.read_csv(path / "demonstrations.csv", dtype=str, keep_default_na=False)


def change(path: Path, row: int, column: str, value: str) -> None:
    """Change one cell of demonstrations.csv; rows count as in a spreadsheet."""
    table = demonstrations(path)
    table.loc[row - 2, column] = value
    table.to_csv(path / "demonstrations.csv", index=False)
