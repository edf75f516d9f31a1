"""Look at a recording.

python -m pipeline.viewer.review                   every variant beside the truth
python -m pipeline.viewer.review full-careful-s0   one run
python -m pipeline.viewer.review --worst           the run whose latent maps agree least with the truth

Opens Rerun's viewer on it. `--check` opens no window: it has Rerun verify the file and compares its digest
with the one in recordings.csv.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

from pipeline.params import PARAMS, load
from pipeline.runtime.errors import InputError
from pipeline.viewer.digest import digest

OVERVIEW = "overview"
EXAMPLES = 3


def find(folder: Path, run: str) -> Path:
    """The recording of `run`, or the overview, below the record stage's `folder`; InputError if there is none."""
    paths = [*sorted((folder / "runs").glob("*.rrd")), folder / f"{OVERVIEW}.rrd"]
    recordings = {path.stem: path for path in paths if path.is_file()}
    known = [name for name in recordings if name != OVERVIEW]
    if not known or (run == OVERVIEW and run not in recordings):
        raise InputError(f"no {'overview' if known else 'recordings'} in {folder}: run `make repro` first")
    if run not in recordings:
        names = ", ".join(known[:: max(1, len(known) // EXAMPLES)][:EXAMPLES])
        raise InputError(
            f"no recording {run!r}: expected RUN=<variant>-<user>-s<seed>, one of {len(known)}, such as {names}"
        )
    return recordings[run]


def worst(folder: Path) -> tuple[str, str]:
    """The run whose latent maps agree least with the truth, the first of equals, and a sentence that says so."""
    rows = [row for row in _listed(folder) if row["run"] != OVERVIEW]
    try:
        agreement = {row["run"]: float(row["agreement"]) for row in rows}
    except (TypeError, ValueError):  # cut off, or no number
        agreement = {}
    if not agreement or not all(0 <= share <= 1 for share in agreement.values()):
        raise InputError(f"{folder / 'recordings.csv'} gives no agreement from 0 to 1 for every run: run `make repro`")
    run = min(agreement, key=agreement.__getitem__)
    return run, (
        f"{run}: its latent maps agree with the truth in {agreement[run]:.1%} of their cells, "
        f"the least of {len(agreement)} runs"
    )


def check(folder: Path, run: str) -> None:
    """Raise InputError unless Rerun can read the recording and it holds what recordings.csv says."""
    path = find(folder, run)
    verified = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, text=True
    )
    if verified.returncode:
        raise InputError(f"{path} is damaged: delete it and run `make repro`\n{verified.stderr.strip()}")
    expected = {row["run"]: row["sha256"] for row in _listed(folder)}
    found = digest(path)
    if expected.get(run) != found:
        raise InputError(
            f"{path} holds {found}, recordings.csv says {expected.get(run)}: delete {folder} and run `make repro`"
        )


def _listed(folder: Path) -> list[dict[str, str]]:
    """The rows of recordings.csv; InputError if it is missing or an older one."""
    listed = folder / "recordings.csv"
    if not listed.is_file():
        raise InputError(f"{listed} is missing: run `make repro` first")
    with listed.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or not {"run", "sha256", "agreement"} <= set(rows[0]):
        raise InputError(f"{listed} does not list runs, their digests and agreement: run `make repro` first")
    return rows


def show(path: Path) -> int:
    """Open the viewer, for this machine alone, until its window is closed; its exit code."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            f"no display to open a window on: copy {path} to a machine that has one and run `rerun {path.name}` "
            "there, or verify it here with --check"
        )
    return subprocess.run([sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]).returncode


def _main(argv: list[str]) -> int:
    runs = [a for a in argv if a not in ("--check", "--worst")]
    if len(runs) + ("--worst" in argv) > 1 or any(run.startswith("-") for run in runs):
        raise InputError(
            f"got {argv}: expected nothing, one run or the worst, as in `make review`, "
            "`make review RUN=full-careful-s0` or `make review WORST=1`"
        )
    folder = Path(load(PARAMS).paths.record)
    run = runs[0] if runs else OVERVIEW
    if "--worst" in argv:
        run, why = worst(folder)
        print(why, flush=True)
    if "--check" in argv:
        check(folder, run)
        print(f"{run}: readable, and its digest is the one recorded")
        return 0
    return show(find(folder, run))


if __name__ == "__main__":
    try:
        sys.exit(_main(sys.argv[1:]))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
