"""Rerun's own viewer without a window, by software rendering; needs a Vulkan driver (mesa-vulkan-drivers)."""

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

START_S, SETTLE_S, PAUSE_S = 60.0, 60.0, 0.3  # limits: start, stable window; screenshot interval


@contextmanager
def viewer(path: Path) -> Iterator[ViewerClient]:
    """Open a recording in a viewer without a window, and close it afterwards."""
    with tempfile.TemporaryDirectory() as home, socket.socket() as free:
        folders = dict.fromkeys(("HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), home)
        env = os.environ | folders | {"NO_COLOR": "1"}
        command = [sys.executable, "-m", "rerun"]
        subprocess.run([*command, "analytics", "disable"], env=env, check=True, capture_output=True)
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
        free.close()
        log = Path(home) / "log"
        with log.open("wb") as out:
            options = ["--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", port]
            process = subprocess.Popen([*command, *options], env=env, stdout=out, stderr=out, start_new_session=True)
        try:
            client = _connect(process, f"rerun+http://127.0.0.1:{port}/proxy", log)
            client.open(str(path))
            yield client
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
    raise RuntimeError(f"Rerun's viewer did not start: {log.read_text(errors='replace')[-500:]}")


def select(client: ViewerClient, tab: int, timeline: str, step: int) -> None:
    """Bring one tab of the open recording to the front, at a step of a time line."""
    blueprint = client.get_blueprint("recording").blueprint
    containers = [entry["ContainerBlueprint"] for entry in blueprint.values() if "ContainerBlueprint" in entry]
    (tabs,) = [container for container in containers if container["container_kind"] == "Tabs"]
    tabs["active_tab"] = tabs["contents"][tab]
    client.set_blueprint(blueprint, "recording")
    client.set_time(timeline, sequence=step, play_state="paused")


def settled(client: ViewerClient) -> UInt8[Array, "y x 3"]:
    """Return the window as RGB once it is stable; TimeoutError if it never is."""
    before, end = None, time.monotonic() + SETTLE_S
    while time.monotonic() < end:
        png = np.frombuffer(client.take_screenshot(), np.uint8)
        now = np.asarray(cv2.imdecode(png, cv2.IMREAD_COLOR_RGB))
        if before is not None and np.array_equal(now, before):
            return now
        before = now
        time.sleep(PAUSE_S)
    raise TimeoutError(f"the viewer's window still changes after {SETTLE_S:.0f} s")
