"""Open a recording in Rerun's viewer.

python -m pipeline.viewer.review                   all variants and the truth
python -m pipeline.viewer.review full-careful-s0   one run
python -m pipeline.viewer.review --worst           the run whose maps agree least with the truth
python -m pipeline.viewer.review --web             in a browser, served to this machine only
python -m pipeline.viewer.review --check           no window: verify the file and compare its digest
"""

import argparse
import csv
import os
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

from pipeline.params import PARAMS, load
from pipeline.runtime.errors import InputError
from pipeline.viewer.digest import digest

OVERVIEW = "overview"
EXAMPLES = 3  # recordings listed in an error message


def find(folder: Path, run: str) -> Path:
    """Return the recording of `run`, or the overview, in the record stage's `folder`; InputError if there is none."""
    paths = [*sorted((folder / "runs").glob("*.rrd")), folder / f"{OVERVIEW}.rrd"]
    recordings = {path.stem: path for path in paths if path.is_file()}
    known = [name for name in recordings if name != OVERVIEW]
    if not known or (run == OVERVIEW and run not in recordings):
        raise InputError(f"no {'overview' if known else 'recordings'} in {folder}: run `make repro` first")
    if run not in recordings:
        names = ", ".join(known[:: max(1, len(known) // EXAMPLES)][:EXAMPLES])
        raise InputError(
            f"no recording {run!r}: expected <variant>-<user>-s<seed>, one of {len(known)}, such as {names}"
        )
    return recordings[run]


def worst(folder: Path) -> tuple[str, str]:
    """Return the run whose maps agree least with the truth (the first if tied), and a sentence that states this."""
    rows = [row for row in _listed(folder) if row["run"] != OVERVIEW]
    try:
        agreement = {row["run"]: float(row["agreement"]) for row in rows}
    except (TypeError, ValueError):  # truncated, or not a number
        agreement = {}
    if not agreement or not all(0 <= share <= 1 for share in agreement.values()):
        raise InputError(f"{folder / 'recordings.csv'} gives no agreement from 0 to 1 for every run: run `make repro`")
    run = min(agreement, key=agreement.__getitem__)
    return run, (
        f"{run}: its maps agree with the truth on {agreement[run]:.1%} of their cells, "
        f"the least of {len(agreement)} runs"
    )


def check(folder: Path, run: str) -> None:
    """Raise InputError unless Rerun can read the recording and its digest matches recordings.csv."""
    path = find(folder, run)
    verified = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, text=True
    )
    if verified.returncode:
        raise InputError(f"{path} is damaged: delete it and run `make repro`\n{verified.stderr.strip()}")
    expected = {row["run"]: row["sha256"] for row in _listed(folder)}
    contents = digest(path)
    if expected.get(run) != contents:
        raise InputError(
            f"{path} has digest {contents}, recordings.csv says {expected.get(run)}: "
            f"delete {folder} and run `make repro`"
        )


def _listed(folder: Path) -> list[dict[str, str]]:
    """Return the rows of recordings.csv; InputError if it is missing or lacks a column."""
    listed = folder / "recordings.csv"
    if not listed.is_file():
        raise InputError(f"{listed} is missing: run `make repro` first")
    with listed.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or not {"run", "sha256", "agreement"} <= set(rows[0]):
        raise InputError(f"{listed} does not list runs, their digests and agreement: run `make repro` first")
    return rows


def show(path: Path, web: bool = False) -> int:
    """Open Rerun's viewer on the recording, for this machine only, until it is closed; return its exit code."""
    screen = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not (web or screen):
        raise InputError(
            f"no display to open a window on: add --web to look at {path.name} in a browser, --check to verify it, "
            f"or copy {path} to a machine with a display and run `rerun {path.name}` there"
        )
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]
    if web:
        ports = [_free_port() for _ in range(2)]
        command += ["--web-viewer" if screen else "--serve-web", "--web-viewer-port", str(ports[0])]
        command += ["--port", str(ports[1])]
        proxy = quote(f"rerun+http://127.0.0.1:{ports[1]}/proxy", safe="")
        print(f"open http://127.0.0.1:{ports[0]}/?url={proxy} in a browser; Ctrl-C stops", flush=True)
    try:
        return subprocess.run(command).returncode
    except KeyboardInterrupt:
        return 0


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def _main() -> int:
    about, _, examples = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        "python -m pipeline.viewer.review", None, about, examples, formatter_class=argparse.RawTextHelpFormatter
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("run", nargs="?", default=OVERVIEW, help=f"<variant>-<user>-s<seed> (default: {OVERVIEW})")
    which.add_argument("--worst", action="store_true", help="the run whose maps agree least with the truth")
    parser.add_argument("--web", action="store_true", help="serve Rerun's web viewer to this machine")
    parser.add_argument("--check", action="store_true", help="verify the file and compare its digest; no window")
    args = parser.parse_args()
    folder = Path(load(PARAMS).paths.record)
    run = args.run
    if args.worst:
        run, reason = worst(folder)
        print(reason, flush=True)
    if args.check:
        check(folder, run)
        print(f"{run}: readable, and its digest is that of recordings.csv")
        return 0
    return show(find(folder, run), args.web)


if __name__ == "__main__":
    try:
        sys.exit(_main())
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
