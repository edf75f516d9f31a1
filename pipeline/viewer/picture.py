"""Pictures of recordings, made without a screen: Rerun's own viewer, drawing by software if there is no GPU.

python -m pipeline.viewer.picture full-careful-s0 run.png               the first tab, at the last step
python -m pipeline.viewer.picture full-careful-s0 run.png 3 intervention 2   another tab, a step of a time line

It needs a Vulkan driver (Debian: apt-get install mesa-vulkan-drivers), opens no port to other machines, and keeps the
viewer's settings, usage data turned off among them, in a folder of its own.
"""

import io
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from PIL import Image
from rerun.experimental import ViewerClient

from pipeline.params import PARAMS, load
from pipeline.runtime.errors import InputError
from pipeline.viewer.digest import digest
from pipeline.viewer.review import find
from pipeline.viewer.screenshot import Screenshot, write_png

START, SETTLE, PAUSE = (
    60.0,
    60.0,
    0.3,
)  # seconds: to start in; for a picture to come to rest in; between two looks at it


@contextmanager
def viewer() -> Iterator[ViewerClient]:
    """A viewer without a window, closed afterwards; InputError with its last words if it does not start, or dies."""
    with tempfile.TemporaryDirectory() as home, socket.socket() as free:
        folders = dict.fromkeys(("HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), home)
        env = os.environ | folders | {"NO_COLOR": "1"}
        command = [sys.executable, "-m", "rerun"]
        subprocess.run([*command, "analytics", "disable"], env=env, check=True, capture_output=True)
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
        free.close()
        log = Path(home) / "log"
        with log.open("wb") as output:
            options = ["--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", port]
            process = subprocess.Popen(
                [*command, *options], env=env, stdout=output, stderr=output, start_new_session=True
            )
        try:
            yield _connected(process, f"rerun+http://127.0.0.1:{port}/proxy", log)
        except ConnectionError as error:  # it answers before it looks for a driver
            raise _gone(log) from error
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)  # the command and the viewer it starts
            process.wait()


def _connected(process: subprocess.Popen, url: str, log: Path) -> ViewerClient:
    """A client of the viewer once it answers."""
    end = time.monotonic() + START
    while process.poll() is None and time.monotonic() < end:
        try:
            client = ViewerClient.connect(url)
            client.get_state()
            return client
        except Exception:  # whatever Rerun raises while nobody listens yet
            time.sleep(PAUSE)
    raise _gone(log)


def _gone(log: Path) -> InputError:
    return InputError(
        "Rerun's viewer does not run without a screen: is a Vulkan driver there (apt-get install "
        f"mesa-vulkan-drivers)?\n{log.read_text(errors='replace')[-2000:]}"
    )


def select(client: ViewerClient, tab: int, timeline: str, step: int) -> None:
    """Bring one tab of the recording that is open to the front, at a step of a time line."""
    blueprint = client.get_blueprint("recording").blueprint
    containers = [entry["ContainerBlueprint"] for entry in blueprint.values() if "ContainerBlueprint" in entry]
    (tabs,) = [container for container in containers if container["container_kind"] == "Tabs"]
    if not 0 <= tab < len(tabs["contents"]):
        raise InputError(f"no tab {tab}: expected a number from 0 to {len(tabs['contents']) - 1}")
    tabs["active_tab"] = tabs["contents"][tab]
    client.set_blueprint(blueprint, "recording")
    client.set_time(timeline, sequence=step, play_state="paused")


def settled(client: ViewerClient, view: str | None = None) -> UInt8[Array, "y x 3"]:
    """The window, or one view (its id), once two looks at it are the same; InputError if it never rests."""
    before, end = None, time.monotonic() + SETTLE
    while time.monotonic() < end:
        with Image.open(io.BytesIO(client.take_screenshot(view))) as image:
            now = np.asarray(image.convert("RGB"))
        if before is not None and np.array_equal(now, before):
            return now
        before = now
        time.sleep(PAUSE)
    raise InputError(f"the viewer's picture does not come to rest within {SETTLE:.0f} s")


def _main(argv: list[str]) -> None:
    if len(argv) not in (2, 3, 5) or not all(number.isdigit() for number in (*argv[2:3], *argv[4:])):
        raise InputError(f"got {argv}: expected RUN FILE.png, then a tab's number, then a time line and a step")
    run, file, tab, timeline, step = [*argv, *["0", "repair_step", "1000000"][len(argv) - 2 :]]
    folder = Path(file).parent
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder} to write {file} into: make it first")
    path = find(Path(load(PARAMS).paths.record), run)
    with viewer() as client:
        client.open(str(path.resolve()))
        select(client, int(tab), timeline, int(step))
        settled(client)
        time.sleep(5)  # until the viewer's notices are gone
        shot = Image.fromarray(settled(client))
    write_png(Path(file), Screenshot(shot, path.stem, digest(path)))


if __name__ == "__main__":
    try:
        _main(sys.argv[1:])
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
