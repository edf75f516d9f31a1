"""Open a recording in Rerun's viewer.

python -m pipeline.viewer.review                   all variants and the truth
python -m pipeline.viewer.review full-careful-s0   one run
python -m pipeline.viewer.review --worst           the run with the lowest accuracy
python -m pipeline.viewer.review --web             in a browser, served to this machine only
python -m pipeline.viewer.review --check           no window: verify the file and compare its digest
"""

import argparse
import os
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

import pandas as pd

from pipeline.artifacts.files import read_table
from pipeline.launch import load
from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import PARAMS
from pipeline.viewer.digest import digest

OVERVIEW, EXAMPLES = "overview", 5  # EXAMPLES: recordings listed in an error message
COLUMNS = ["run", "sha256", "accuracy"]  # of recordings.csv


def recordings(kept: Path, runs: Path) -> dict[str, Path]:
    """Return the recordings there are by name: those kept in git, or better those of stage record (`runs`)."""
    return {path.stem: path for folder in (kept, runs) for path in sorted(folder.glob("*.rrd"))}


def find(kept: Path, runs: Path, run: str) -> Path:
    """Return the recording of `run`, or the overview; InputError if there is none."""
    here = recordings(kept, runs)
    if run not in here:
        names = ", ".join(list(here)[:EXAMPLES]) or "none"
        known = f"no recording {run!r} here, but {names}: expected <variant>-<user>-s<seed>"
        raise InputError(f"{known}; git keeps few of them, `make repro` writes all")
    return here[run]


def worst(kept: Path, runs: Path) -> tuple[str, str]:
    """Return the run with the lowest accuracy of those there are, and a sentence that states this."""
    table = read_table(kept / "recordings.csv", COLUMNS).set_index("run")
    here = table.index.isin(recordings(kept, runs).keys() - {OVERVIEW})
    accuracy = pd.to_numeric(table["accuracy"][here], errors="coerce")
    if accuracy.empty or not accuracy.between(0, 1).all():
        raise InputError(f"{kept / 'recordings.csv'} gives no accuracy from 0 to 1 for every run: run `make repro`")
    run = str(accuracy.idxmin())
    return run, f"{run}: accuracy {accuracy[run]:.1%}, the lowest of the {len(accuracy)} recordings here"


def check(kept: Path, runs: Path, run: str) -> None:
    """Raise InputError unless Rerun can read the recording and its digest matches recordings.csv."""
    path = find(kept, runs, run)
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    verified = subprocess.run(verify, capture_output=True, encoding="utf-8", errors="replace")
    if verified.returncode:
        raise InputError(f"{path} is damaged: delete it and run `make repro`\n{verified.stderr.strip()}")
    expected = read_table(kept / "recordings.csv", COLUMNS).set_index("run")["sha256"].get(run)
    contents = digest(path)
    if expected != contents:
        says = f"{path} has digest {contents}, recordings.csv says {expected}"
        raise InputError(f"{says}: delete it and run `make repro`")


def show(path: Path, web: bool = False) -> int:
    """Open Rerun's viewer on the recording, for this machine only, until it is closed; return its exit code."""
    screen = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not (web or screen):
        here = f"add --web to look at {path.name} in a browser, --check to verify it"
        there = f"copy {path} to a machine with a display and run `rerun {path.name}` there"
        raise InputError(f"no display to open a window on: {here}, or {there}")
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]
    if web:
        with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as other:
            page, port = one.getsockname()[1], other.getsockname()[1]  # two free ports
        command += ["--web-viewer" if screen else "--serve-web", "--web-viewer-port", f"{page}", "--port", f"{port}"]
        proxy = quote(f"rerun+http://127.0.0.1:{port}/proxy", safe="")
        print(f"open http://127.0.0.1:{page}/?url={proxy} in a browser; Ctrl-C stops", flush=True)
    try:
        return subprocess.run(command).returncode
    except KeyboardInterrupt:
        return 0


def _main() -> int:
    about, _, examples = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser("python -m pipeline.viewer.review", None, about, examples)
    parser.formatter_class = argparse.RawTextHelpFormatter
    which = parser.add_mutually_exclusive_group()
    which.add_argument("run", nargs="?", default=OVERVIEW, help=f"<variant>-<user>-s<seed> (default: {OVERVIEW})")
    which.add_argument("--worst", action="store_true", help="the run with the lowest accuracy")
    parser.add_argument("--web", action="store_true", help="serve Rerun's web viewer to this machine")
    parser.add_argument("--check", action="store_true", help="verify the file and compare its digest; no window")
    args = parser.parse_args()
    run, paths = args.run, load(PARAMS).paths
    folders = Path(paths.selection), Path(paths.record) / "runs"
    if args.worst:
        run, reason = worst(*folders)
        print(reason, flush=True)
    if args.check:
        check(*folders, run)
        print(f"{run}: readable, and its digest is that of recordings.csv")
        return 0
    return show(find(*folders, run), args.web)


if __name__ == "__main__":
    with reported():
        sys.exit(_main())
