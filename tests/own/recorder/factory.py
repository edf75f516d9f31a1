"""A small folder of slanted pictures, and a recorder on it in a process of its own."""

import http.client
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.runtime.places import ROOT

WIDTH, HEIGHT = 640, 480
CORNERS = [[160, 80], [490, 90], [620, 440], [30, 430]]  # [px]: far left, far right, near right, near left
START, GOAL = (0.08, 0.08), (0.92, 0.92)
DETOUR = [START, (0.2, 0.7), (0.6, 0.8), GOAL]  # [m]


def pixels(points: Float[Array, "n 2"] | list[tuple[float, float]]) -> Float[Array, "n 2"]:
    """Places on the table [m] in the pictures [px], by another route through OpenCV than the recorder's."""
    table = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
    matrix, _ = cv2.findHomography(table, np.array(CORNERS, float))
    return cv2.perspectiveTransform(np.array(points, float)[:, None], matrix)[:, 0]


def samples(points: list[tuple[float, float]] = DETOUR) -> Float[Array, "n 3"]:
    """A path through these places [m] as the page sends it: t [ms], column, row."""
    steps = np.linspace(0, len(points) - 1, 40)
    metres = np.stack([np.interp(steps, range(len(points)), [p[axis] for p in points]) for axis in (0, 1)], axis=-1)
    return np.column_stack([1e6 + 25.0 * np.arange(len(steps)), pixels(metres)])


def picture(seed: int = 0) -> Array:
    colours = np.random.default_rng(seed).integers(60, 200, (2, 3)).tolist()
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    cv2.fillPoly(image, [np.array(CORNERS)], (150, 180, 205))
    for colour, place in zip(colours, pixels([(0.4, 0.5), (0.7, 0.4)]), strict=True):
        cv2.ellipse(image, tuple(int(v) for v in place), (30, 18), 0, 0, 360, colour, -1)
    return image


def make_folder(parent: Path, scenes: tuple[str, ...] = ("first", "second")) -> Path:
    folder = parent / "kitchen"
    (folder / "scenes").mkdir(parents=True)
    for seed, scene in enumerate(scenes):
        cv2.imwrite(str(folder / "scenes" / f"{scene}.png"), picture(seed))
    (folder / "table.yaml").write_text(f"corners: {CORNERS}\n")
    return folder


@dataclass
class Served:
    """A recorder's process and its port."""

    process: subprocess.Popen
    port: int

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> tuple[int, dict]:
        """Status and answer; headers default to those of the recorder's own page."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        content = body if isinstance(body, bytes) else json.dumps(body).encode()
        sent = {"Origin": self.url.rstrip("/")} | {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, None if method == "GET" else content, sent)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        is_json = answer.headers.get_content_type() == "application/json"
        return answer.status, json.loads(text) if is_json else {}


def command(folder: Path, *options: str, verb: str = "record") -> list[str]:
    return [sys.executable, "-m", "pipeline.own", verb, str(folder), "--no-browser", *options]


@contextmanager
def recorder(folder: Path, port: int = 0, verb: str = "record") -> Iterator[Served]:
    words = command(folder, "--port", str(port), verb=verb)
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        lines = iter(process.stdout.readline, "")  # what is said before the address is for people
        found = next(filter(None, (re.search(r"http://127.0.0.1:(\d+)/", line) for line in lines)), None)
        assert found
        yield Served(process, int(found[1]))
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
