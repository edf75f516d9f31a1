"""Look at one recording: python -m pipeline.recording.review full-careful-s0 [--check]

Opens Rerun's viewer on it. `--check` opens no window: it has Rerun verify the file and compares its digest
with the one in recordings.csv.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

from pipeline.params import PARAMS, InputError, load
from pipeline.recording.digest import digest

EXAMPLES = 3


def find(folder: Path, run: str) -> Path:
    """The recording of `run` below the record stage's `folder`; InputError if there is none."""
    known = sorted(path.stem for path in (folder / "runs").glob("*.rrd"))
    if not known:
        raise InputError(f"no recordings in {folder / 'runs'}: run `make repro` first")
    if run not in known:
        names = ", ".join(known[:: max(1, len(known) // EXAMPLES)][:EXAMPLES])
        raise InputError(
            f"no recording {run!r}: expected RUN=<variant>-<user>-s<seed>, one of {len(known)}, such as {names}"
        )
    return folder / "runs" / f"{run}.rrd"


def check(folder: Path, run: str) -> None:
    """Raise InputError unless Rerun can read the recording and it holds what recordings.csv says."""
    path = find(folder, run)
    verified = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, text=True
    )
    if verified.returncode:
        raise InputError(f"{path} is damaged: delete it and run `make repro`\n{verified.stderr.strip()}")
    listed = folder / "recordings.csv"
    if not listed.is_file():
        raise InputError(f"{listed} is missing: run `make repro` first")
    with listed.open(newline="") as file:
        expected = {row["run"]: row["sha256"] for row in csv.DictReader(file)}
    found = digest(path)
    if expected.get(run) != found:
        raise InputError(
            f"{path} holds {found}, {listed} says {expected.get(run)}: delete {folder} and run `make repro`"
        )


def show(path: Path) -> int:
    """Open the viewer, for this machine alone, until its window is closed; its exit code."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            f"no display to open a window on: copy {path} to a machine that has one and run `rerun {path.name}` "
            "there, or verify it here with --check"
        )
    return subprocess.run([sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]).returncode


def _main(argv: list[str]) -> int:
    runs = [a for a in argv if a != "--check"]
    if len(runs) != 1 or runs[0].startswith("-"):
        raise InputError(f"got {runs}: expected one recording's name, as in `make review RUN=full-careful-s0`")
    folder = Path(load(PARAMS).paths.record)
    if "--check" in argv:
        check(folder, runs[0])
        print(f"{runs[0]}: readable, and its digest is the one recorded")
        return 0
    return show(find(folder, runs[0]))


if __name__ == "__main__":
    try:
        sys.exit(_main(sys.argv[1:]))
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
