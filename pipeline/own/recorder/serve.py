"""The command `record`: one recorder a folder, on this machine only, until Ctrl-C."""

import argparse
import fcntl
import os
import socket
import threading
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.own.csv_files import DEMONSTRATIONS
from pipeline.runtime.errors import InputError

LOOPBACK = "127.0.0.1"
LOCK = ".recorder.lock"  # in the folder; held by the recorder's process, holds its address


def main(arguments: Sequence[str]) -> int:
    """Serve the recorder's page as the command line says, and hold the folder's lock meanwhile; return 0 after Ctrl-C.

    Raise InputError if the folder cannot be recorded into, another recorder has it, or a package is missing.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.own record",
        description="Open a page in which people draw paths over the pictures of a folder and say which are valid.",
    )
    parser.add_argument("folder", type=Path, help="has pictures in FOLDER/scenes; recordings are written beside them")
    parser.add_argument("--port", type=int, default=0, help="0, the default, takes any that is free")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    parsed = parser.parse_args(arguments)
    folder: Path = parsed.folder
    try:
        import uvicorn

        from pipeline.own.recorder.app import build
        from pipeline.own.recorder.storage import Recordings
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise InputError(f"the recorder needs {error.name}: pip install 'causal-specifications[record]'") from error
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}: make it, with pictures of the table in {folder}/scenes")
    with one_recorder(folder) as lock, _listening(parsed.port) as listener:
        recordings = Recordings(folder)
        port = listener.getsockname()[1]
        address = f"http://{LOOPBACK}:{port}/"
        os.ftruncate(lock, 0)
        os.pwrite(lock, address.encode(), 0)
        print(f"Recording into {folder}: open {address} (Ctrl-C ends)", flush=True)
        if not parsed.no_browser:
            threading.Timer(0.5, webbrowser.open, [address]).start()
        app = build(recordings, {f"{LOOPBACK}:{port}", f"localhost:{port}"})
        config = uvicorn.Config(app, log_level="warning", access_log=False, lifespan="off", ws="none")
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listener])
        paths = len(recordings.recorded(DEMONSTRATIONS))
        print(f"{folder} holds {paths} paths. Next: python -m pipeline.own check {folder}")
    return 0


@contextmanager
def one_recorder(folder: Path) -> Iterator[int]:
    """Hold the folder's lock, which the system releases however this process ends; yield its file descriptor.

    Raise InputError if another recorder holds it.
    """
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            address = os.read(lock, 100).decode() or "another address"
            raise InputError(f"a recorder has {folder} open already, at {address}: use it, or end it first") from error
        yield lock
    finally:
        os.close(lock)


def _listening(port: int) -> socket.socket:
    """Return a socket on the loopback device; raise InputError if the port is taken."""
    try:
        return socket.create_server((LOOPBACK, port))
    except (OSError, OverflowError) as error:
        raise InputError(f"port {port} cannot be used ({error}): choose another, or 0 for any") from error
