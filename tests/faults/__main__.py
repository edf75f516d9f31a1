"""Break runs of the smoke profile on purpose and count how they end: `make test-faults`; Linux, as root.

python -m tests.faults [--kills N] [--seed S] [--only WORD] [--whole DIR]

A fault must end in a clear message or in the bytes of an unbroken run. Exit status 1 if one does not. --whole names a
finished `tests/smoke/run.sh DIR` to compare with and saves making one.
"""

import argparse
import itertools
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.git import dvc, forget_repository

ROOT = Path(__file__).parents[2]
REPRO = ["make", "--assume-old=.venv/.ready", "repro"]
STAGES = ("scenes", "demos", "train", "irl", "clearance", "evaluate", "repair", "intervene", "record")
PAPER = (*(f"outputs/{stage}" for stage in STAGES), "reports")
VARY = (".rrd", ".lock", ".pyc")  # or hold hashes of recordings, whose digests are compared
SAME, MESSAGE, WRONG = "correct result", "clear message", "WRONG"
MEAN_S = float(os.environ.get("MEAN_S", "8"))  # between kills: most stages of the smoke profile last as long


class Broken:
    """A clone of the finished run `whole` for one fault, as if no stage had run; `run` runs a command in it."""

    def __init__(self, whole: Path, folder: Path):
        """Clone, without results and without DVC's cache."""
        self.whole, self.folder = whole, folder
        subprocess.run(["git", "clone", "--quiet", str(whole), str(folder)], check=True)
        for path in [folder / "dvc.lock", *folder.glob("studies/**/dvc.lock"), *folder.glob("reports/**/*.*")]:
            path.unlink()
        dvc(folder, "pull", "--quiet", "--remote", "store", "data.dvc", "rendered/pictures.dvc")
        self.place = {"cwd": folder, "env": os.environ | {"PYTHONPATH": str(folder)}}  # Python finds the clone's code

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Return the ended command with what it said."""
        return subprocess.run(command, **self.place, capture_output=True, text=True, timeout=3600)

    def judge(self, done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
        """Return how the fault ended, and the sentence or what is wrong: files that differ from the whole run's."""
        if done.returncode:
            return said(done)
        different = [name for folder in PAPER for name in _differing(self.whole / folder, self.folder / folder)]
        return (WRONG, f"differs: {', '.join(different[:5])}") if different else (SAME, "")

    def is_killed(self, rng: np.random.Generator) -> bool:
        """Start the run and kill it after a random time; return False if it came to its end before."""
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        process = subprocess.Popen(REPRO, **self.place, **silent)
        try:
            process.wait(rng.exponential(MEAN_S) + 0.5)
            return False
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return True


def said(done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
    """Return the message of a failed command; a traceback or silence is wrong."""
    lines = [line.strip() for line in (done.stderr + done.stdout).splitlines()]
    errors = [line for line in lines if line.lower().startswith("error")]
    if "Traceback (most recent call last)" in done.stderr + done.stdout:
        return WRONG, f"traceback: {lines[-1] if lines else ''}"
    return (MESSAGE, errors[0]) if errors else (WRONG, "no message")


def _differing(first: Path, second: Path) -> list[str]:
    def contents(folder: Path) -> dict[str, bytes]:
        files = [path for path in folder.rglob("*") if path.is_file() and path.suffix not in VARY]
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}

    before, after = contents(first), contents(second)
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


class Fault(NamedTuple):
    """What a fault is injected into: the whole run, an empty folder for its clones, and how often a run is killed."""

    whole: Path
    folder: Path
    rng: np.random.Generator
    kills: int

    def broken(self, name: str = "clone") -> Broken:
        """Return a new clone of the whole run."""
        return Broken(self.whole, self.folder / name)


Ends = list[tuple[str, str]]  # how a fault ended, for each time that it was injected


def _damage(path: Path, rng: np.random.Generator, how: str) -> None:
    """Cut a file short or flip one of its bits, whatever its mode is; a link to it elsewhere stays as it was."""
    content = bytearray(path.read_bytes())
    place = int(rng.integers(len(content) // 4, len(content)))
    if how == "cut":
        content = content[:place]
    else:
        content[place] ^= 1 << int(rng.integers(8))
    path.unlink()
    path.write_bytes(content)


def kill_the_paper(fault: Fault) -> Ends:
    """kill -9 of `make repro` and all its children, resumed"""
    ends: Ends = []
    while len(ends) < fault.kills:  # a run is killed and resumed until it ends; each kill ends as that run
        broken, killed = fault.broken(str(len(ends))), 0
        while len(ends) + killed < fault.kills and broken.is_killed(fault.rng):
            killed += 1
        ends += [broken.judge(broken.run(*REPRO))] * killed
        shutil.rmtree(broken.folder)
    return ends


def damaged_store(fault: Fault) -> Ends:
    """damaged file in the store of data, pulled"""
    ends = []
    for how, suffix in itertools.product(("cut", "flip"), (".csv", ".png")):
        broken = fault.broken(how + suffix)
        names = sorted(broken.folder.glob(f"data/**/*{suffix}"))
        content = names[int(fault.rng.integers(len(names)))].read_bytes()
        for folder in ("data", ".dvc/cache", ".dvc/tmp"):
            shutil.rmtree(broken.folder / folder, ignore_errors=True)
        (stored,) = [p for p in broken.folder.glob("store/files/md5/*/*") if p.read_bytes() == content]
        _damage(stored, fault.rng, how)
        ends.append(broken.judge(broken.run(*REPRO)))
    return ends


def two_at_once(fault: Fault) -> Ends:
    """two `make repro` at once"""
    broken = fault.broken()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    first = subprocess.Popen(REPRO, cwd=broken.folder, **pipes, start_new_session=True)
    time.sleep(float(fault.rng.uniform(4, 12)))
    second = broken.run(*REPRO)
    text, _ = first.communicate()
    ended = subprocess.CompletedProcess(REPRO, first.returncode, text, "")
    return [broken.judge(ended), broken.judge(second)]


def no_network(fault: Fault) -> Ends:
    """no network"""
    broken = fault.broken()
    return [broken.judge(broken.run("unshare", "--net", *REPRO))]


def full_disk(fault: Fault) -> Ends:
    """full disk (a small tmpfs), then room again"""
    fault.folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400m", "tmpfs", fault.folder], check=True)
    try:
        broken = fault.broken()
        free, filler = shutil.disk_usage(fault.folder).free, fault.folder / "filler"
        filler.write_bytes(bytes(free - int(fault.rng.integers(1_000_000, 4_000_000))))
        refused = broken.run(*REPRO)
        filler.unlink()
        first = said(refused) if refused.returncode else (WRONG, "it fitted")
        return [first, broken.judge(broken.run(*REPRO))]
    finally:
        subprocess.run(["umount", "--lazy", fault.folder], check=True)


FAULTS = (kill_the_paper, damaged_store, two_at_once, no_network, full_disk)


def main() -> int:
    """Inject every fault and print how each ended."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--kills", type=int, default=5, help="times that a run is killed")
    parser.add_argument("--seed", type=int, default=0, help="of the moments and places")
    parser.add_argument("--only", default="", help="faults whose name holds this word")
    parser.add_argument("--whole", type=Path, help="a finished smoke run")
    given = parser.parse_args()
    wrong = False
    with tempfile.TemporaryDirectory() as temporary:
        whole = (given.whole or Path(temporary) / "whole").absolute()
        if not given.whole:
            subprocess.run(["bash", "tests/smoke/run.sh", str(whole)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        for fault in (fault for fault in FAULTS if given.only in fault.__name__):
            folder = Path(temporary) / fault.__name__
            ends = fault(Fault(whole, folder, np.random.default_rng(given.seed), given.kills))
            shutil.rmtree(folder, ignore_errors=True)
            for (end, message), times in Counter(ends).items():
                print(f"{fault.__doc__} | {times} | {end} | {message.replace(str(folder), '')}", flush=True)
            wrong |= any(end == WRONG for end, _ in ends)
    return int(wrong)


if __name__ == "__main__":
    forget_repository()
    sys.exit(main())
