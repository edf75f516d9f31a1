"""Save a screenshot of a recording without a screen: by Rerun's own viewer, with software rendering.

python -m pipeline.viewer.picture full-careful-s0 run.png
python -m pipeline.viewer.picture full-careful-s0 run.png --tab 3 --timeline intervention --step 2

This needs a Vulkan driver (Debian: apt-get install mesa-vulkan-drivers) and opens no port to other machines. The viewer
keeps its settings in a temporary folder, with usage data turned off.
"""

import argparse
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

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from rerun.experimental import ViewerClient

from pipeline.params import PARAMS, load
from pipeline.runtime.errors import InputError
from pipeline.viewer.review import OVERVIEW, find

START_S, SETTLE_S, PAUSE_S = 60.0, 60.0, 0.3  # limits: start, stable window; screenshot interval
NOTICES_S = 5.0  # time until the viewer's notices disappear


@contextmanager
def viewer() -> Iterator[ViewerClient]:
    """Start a viewer without a window, and close it afterwards; InputError if it does not start, or stops."""
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
            yield _connect(process, f"rerun+http://127.0.0.1:{port}/proxy", log)
        except ConnectionError as error:  # it answers before it looks for a driver
            raise _stopped(log) from error
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)  # the command and the viewer that it starts
            process.wait()


def _connect(process: subprocess.Popen, url: str, log: Path) -> ViewerClient:
    """Return a client of the viewer once it answers."""
    end = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < end:
        try:
            client = ViewerClient.connect(url)
            client.get_state()
            return client
        except Exception:  # any exception of Rerun while the viewer is starting
            time.sleep(PAUSE_S)
    raise _stopped(log)


def _stopped(log: Path) -> InputError:
    """Return the cause in one line; without a driver, Rerun logs pages of a panic."""
    lines = [line.strip() for line in log.read_text(errors="replace").splitlines() if line.strip()]
    if any("adapter" in line for line in lines):
        return InputError("no Vulkan driver: Rerun's viewer needs one (Debian: apt-get install mesa-vulkan-drivers)")
    return InputError(f"Rerun's viewer stopped: {lines[-1] if lines else 'it logged nothing'}")


def select(client: ViewerClient, tab: int, timeline: str, step: int) -> None:
    """Bring one tab of the open recording to the front, at a step of a time line."""
    blueprint = client.get_blueprint("recording").blueprint
    containers = [entry["ContainerBlueprint"] for entry in blueprint.values() if "ContainerBlueprint" in entry]
    (tabs,) = [container for container in containers if container["container_kind"] == "Tabs"]
    if not 0 <= tab < len(tabs["contents"]):
        raise InputError(f"no tab {tab}: expected a number from 0 to {len(tabs['contents']) - 1}")
    tabs["active_tab"] = tabs["contents"][tab]
    client.set_blueprint(blueprint, "recording")
    client.set_time(timeline, sequence=step, play_state="paused")


def settled(client: ViewerClient, view: str | None = None) -> UInt8[Array, "y x 3"]:
    """Return the window, or one view (by id), as RGB once it is stable; InputError if it never is."""
    before, end = None, time.monotonic() + SETTLE_S
    while time.monotonic() < end:
        png = np.frombuffer(client.take_screenshot(view), np.uint8)
        now = np.asarray(cv2.imdecode(png, cv2.IMREAD_COLOR_RGB))
        if before is not None and np.array_equal(now, before):
            return now
        before = now
        time.sleep(PAUSE_S)
    raise InputError(f"the viewer's window still changes after {SETTLE_S:.0f} s")


def draw(path: Path, image: Path, tab: int, timeline: str, step: int) -> None:
    """Write a screenshot of the recording at `path`."""
    if not image.parent.is_dir():
        raise InputError(f"there is no folder {image.parent} to write {image} into: make it first")
    with viewer() as client:
        client.open(str(path.resolve()))
        select(client, tab, timeline, step)
        settled(client)
        time.sleep(NOTICES_S)
        shot = settled(client)
    if not cv2.imwrite(str(image), cv2.cvtColor(shot, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise InputError(f"{image} cannot be written: expected a name that ends in .png")


def _main() -> None:
    about, _, examples = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        "python -m pipeline.viewer.picture", None, about, examples, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("run", help=f"<variant>-<user>-s<seed>, or {OVERVIEW}")
    parser.add_argument("image", type=Path, help="file to write, .png")
    parser.add_argument("--tab", type=int, default=0, help="number of the tab, from 0 (default: 0)")
    parser.add_argument("--timeline", help="time line (default: repair_step; of the overview: scene)")
    parser.add_argument("--step", type=int, help="step of the time line (default: the last repair step; scene 0)")
    args = parser.parse_args()
    cfg = load(PARAMS)
    timeline, step = ("scene", 0) if args.run == OVERVIEW else ("repair_step", cfg.repair.steps)
    if args.timeline not in (None, timeline):
        timeline, step = args.timeline, 0
    step = step if args.step is None else args.step
    draw(
        find(Path(cfg.paths.selection), Path(cfg.paths.record) / "runs", args.run), args.image, args.tab, timeline, step
    )


if __name__ == "__main__":
    try:
        _main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
