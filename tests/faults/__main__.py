"""Break runs of the smoke profile on purpose and count how they end: `make test-faults`; Linux, as root.

python -m tests.faults [--kills N] [--only WORD] [--whole DIR] [--out FILE]

A fault must end in a clear message or in the bytes of an unbroken run. Exit status 1 if one does not. --whole names a
finished `tests/smoke/run.sh DIR` to compare with and saves making one. --out writes the table as csv.
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
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import yaml

from pipeline.artifacts.files import write_table
from pipeline.git import dvc, environment, forget_repository, run
from pipeline.runtime.places import ROOT
from tests.sweep.running import SMALL

REPRO = ["make", "--assume-old=.venv/.ready", "repro"]
STUDY = ["dvc", "repro", "studies/dvc.yaml:page@users"]
SWEEP = [sys.executable, "-m", "pipeline.sweep"]
SWEPT = ["--multirun", "--folder", "swept", *SMALL, "evaluate.bins=5,10", "hydra.launcher.n_jobs=2"]
STAGES = ("scenes", "demos", "train", "irl", "clearance", "evaluate", "repair", "intervene", "record")
PAPER = (*(f"outputs/{stage}" for stage in STAGES), "reports")
RESULTS = ("outputs", "reports", "studies/users")
SAME, MESSAGE, WRONG = "correct result", "clear message", "WRONG"
MEAN_S = 8.0  # between kills: most stages of the smoke profile last as long


class Broken:
    """A clone of the finished run `whole` for one fault; `run` runs a command in it."""

    def __init__(self, whole: Path, folder: Path, *, results: bool, cache: bool):
        """Clone; with its results, or else as if no stage had run; with DVC's cache or without."""
        self.whole, self.folder = whole, folder
        subprocess.run(["git", "clone", "--quiet", str(whole), str(folder)], check=True)
        if results:
            shutil.copytree(whole / "outputs", folder / "outputs", dirs_exist_ok=True)
        else:
            for path in [folder / "dvc.lock", *folder.glob("studies/**/dvc.lock"), *folder.glob("reports/**/*.*")]:
                path.unlink()
        if cache:
            shutil.copytree(whole / ".dvc/cache", folder / ".dvc/cache")
        dvc(folder, "pull", "--quiet", "--remote", "store", "data.dvc", "rendered/pictures.dvc")

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Return the ended command with what it said."""
        return run(command, self.folder, {"PYTHONPATH": str(self.folder)}, capture_output=True, timeout=3600)

    def judge(self, done: subprocess.CompletedProcess[str], folders: tuple[str, ...] = RESULTS) -> tuple[str, str]:
        """Return how the fault ended, and the sentence or what is wrong: files that differ from the whole run's."""
        if done.returncode:
            return said(done)
        different = [name for folder in folders for name in _differing(self.whole / folder, self.folder / folder)]
        return (WRONG, f"differs: {', '.join(different[:5])}") if different else (SAME, "")


def said(done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
    """Return the message of a failed command; a traceback or silence is wrong."""
    lines = [line.strip() for line in (done.stderr + done.stdout).splitlines()]
    errors = [line for line in lines if line.lower().startswith("error")]
    if "Traceback (most recent call last)" in done.stderr + done.stdout:
        return WRONG, f"traceback: {lines[-1] if lines else ''}"
    return (MESSAGE, errors[0]) if errors else (WRONG, f"status {done.returncode}, no error: {' / '.join(lines[-3:])}")


def _differing(first: Path, second: Path) -> list[str]:
    def contents(folder: Path) -> dict[str, bytes]:
        files = [path for path in folder.rglob("*") if path.is_file() and not _varies(path)]
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}

    before, after = contents(first), contents(second)
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def _varies(path: Path) -> bool:
    """Whether a file holds hashes of recordings, whose digests are compared, durations, or which stages ran."""
    dated = (path.parent / "sweep.json").is_file() and path.suffix != ".parquet"
    return dated or path.name in ("job.json", "log.txt", "processors.json") or path.suffix in (".rrd", ".lock", ".pyc")


class Fault(NamedTuple):
    """What a fault is injected into: the whole run, an empty folder for its clones, and how often a run is killed."""

    whole: Path
    folder: Path
    rng: np.random.Generator
    kills: int

    def broken(self, name: str = "clone", *, results: bool, cache: bool) -> Broken:
        """Return a new clone of the whole run."""
        return Broken(self.whole, self.folder / name, results=results, cache=cache)

    def killed(self, make: Callable[[str], Broken], command: Callable[[Path], list[str]], folders: tuple) -> "Ends":
        """Kill a command with all its children, resume it until it ends, and begin anew, until `kills` are done.

        Each kill ends as the run that it hit.
        """
        ends: Ends = []
        for clone in itertools.count():
            broken, killed = make(str(clone)), 0
            while len(ends) + killed < self.kills and _is_killed(broken, command(broken.folder), self.rng):
                killed += 1
            if killed:
                ends += [broken.judge(broken.run(*command(broken.folder)), folders)] * killed
            shutil.rmtree(broken.folder)
            if len(ends) >= self.kills:
                break
        return ends


Ends = list[tuple[str, str]]  # how a fault ended, for each time that it was injected


def _is_killed(broken: Broken, command: list[str], rng: np.random.Generator) -> bool:
    """Start a command and kill it after a random time; return False if it came to its end before."""
    place = {"cwd": broken.folder, "env": environment({"PYTHONPATH": str(broken.folder)}), "start_new_session": True}
    process = subprocess.Popen(command, **place, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        process.wait(rng.exponential(MEAN_S) + 0.5)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True


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
    """kill -9 of `make repro`, resumed"""
    return fault.killed(lambda name: fault.broken(name, results=False, cache=False), lambda _: REPRO, PAPER)


def kill_a_study(fault: Fault) -> Ends:
    """kill -9 of a study, resumed"""

    def make(name: str) -> Broken:
        broken = fault.broken(name, results=True, cache=False)
        shutil.rmtree(broken.folder / "outputs/studies/users")
        (broken.folder / "studies/users/dvc.lock").unlink()
        return broken

    return fault.killed(make, lambda _: STUDY, ("outputs/studies/users", "studies/users"))


def kill_a_sweep(fault: Fault) -> Ends:
    """kill -9 of a sweep, resumed"""
    reference = fault.broken("reference", results=False, cache=False)
    reference.run(*SWEEP, *SWEPT).check_returncode()

    def command(clone: Path) -> list[str]:
        return [*SWEEP, *(["--resume", "swept"] if (clone / "swept/sweep.json").is_file() else SWEPT)]

    against = fault._replace(whole=reference.folder)
    return against.killed(lambda name: against.broken(name, results=False, cache=False), command, ("swept",))


def damaged_cache(fault: Fault) -> Ends:
    """damaged file in DVC's cache, its result restored"""
    outs = yaml.safe_load((fault.whole / "dvc.lock").read_text())["stages"]["evaluate"]["outs"]
    paths = [f".dvc/cache/files/md5/{out['md5'][:2]}/{out['md5'][2:]}" for out in outs if "md5" in out]
    ends = []
    for how in ("cut", "flip"):
        broken = fault.broken(how, results=True, cache=True)
        cached = sorted(file for path in paths if (file := broken.folder / path).stat().st_size > 100)
        _damage(cached[int(fault.rng.integers(len(cached)))], fault.rng, how)
        shutil.rmtree(broken.folder / "outputs/evaluate")
        ends.append(broken.judge(broken.run(*REPRO), PAPER))
    return ends


def damaged_store(fault: Fault) -> Ends:
    """damaged file in the store of data, pulled"""
    ends = []
    for how, suffix in itertools.product(("cut", "flip"), (".csv", ".png")):
        broken = fault.broken(how + suffix, results=False, cache=False)
        names = sorted(broken.folder.glob(f"data/**/*{suffix}"))
        content = names[int(fault.rng.integers(len(names)))].read_bytes()
        for folder in ("data", ".dvc/cache", ".dvc/tmp"):
            shutil.rmtree(broken.folder / folder, ignore_errors=True)
        (stored,) = [p for p in broken.folder.glob("store/files/md5/*/*") if p.read_bytes() == content]
        _damage(stored, fault.rng, how)
        ends.append(broken.judge(broken.run(*REPRO), PAPER))
    return ends


def two_at_once(fault: Fault) -> Ends:
    """two `make repro` at once"""
    broken = fault.broken(results=False, cache=False)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    first = subprocess.Popen(REPRO, cwd=broken.folder, **pipes, start_new_session=True)
    time.sleep(float(fault.rng.uniform(4, 12)))
    second = broken.run(*REPRO)
    text, _ = first.communicate()
    ended = subprocess.CompletedProcess(REPRO, first.returncode, text, "")
    return [broken.judge(ended, PAPER), broken.judge(second, PAPER)]


def no_network(fault: Fault) -> Ends:
    """no network"""
    broken = fault.broken(results=False, cache=False)
    return [broken.judge(broken.run("unshare", "--net", *REPRO), PAPER)]


def full_disk(fault: Fault) -> Ends:
    """full disk (a small tmpfs), then room again"""
    fault.folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400m", "tmpfs", fault.folder], check=True)
    try:
        broken = fault.broken(results=False, cache=False)
        free, filler = shutil.disk_usage(fault.folder).free, fault.folder / "filler"
        filler.write_bytes(bytes(free - int(fault.rng.integers(1_000_000, 4_000_000))))
        refused = broken.run(*REPRO)
        filler.unlink()
        first = said(refused) if refused.returncode else (WRONG, "it fitted")
        return [first, broken.judge(broken.run(*REPRO), PAPER)]
    finally:
        subprocess.run(["umount", "--lazy", fault.folder], check=True)


FAULTS = (
    kill_the_paper, kill_a_study, kill_a_sweep, damaged_cache, damaged_store, two_at_once, no_network, full_disk,
)  # fmt: skip


def main() -> int:
    """Inject every fault, print how each ended, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--kills", type=int, default=5, help="times that a run is killed")
    parser.add_argument("--only", default="", help="faults whose name holds this word")
    parser.add_argument("--whole", type=Path, help="a finished smoke run")
    parser.add_argument("--out", type=Path, help="csv to write")
    given = parser.parse_args()
    table = pd.DataFrame()
    with tempfile.TemporaryDirectory() as temporary:
        whole = (given.whole or Path(temporary) / "whole").absolute()
        if not given.whole:
            subprocess.run(["bash", "tests/smoke/run.sh", str(whole)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        for fault in (fault for fault in FAULTS if given.only in fault.__name__):
            folder = Path(temporary) / fault.__name__
            ends = fault(Fault(whole, folder, np.random.default_rng(0), given.kills))
            shutil.rmtree(folder, ignore_errors=True)
            rows = pd.DataFrame(ends, columns=["end", "message"]).assign(fault=fault.__doc__)
            for name in (str(folder), temporary):
                rows["message"] = rows["message"].str.replace(name, "", regex=False)
            counts = rows.value_counts(["fault", "end", "message"], sort=False).reset_index(name="times")
            print(counts.to_string(index=False, header=False), flush=True)
            table = pd.concat([table, counts[["fault", "times", "end", "message"]]], ignore_index=True)
            if given.out:
                write_table(given.out, table)
    return int((table["end"] == WRONG).any())


if __name__ == "__main__":
    forget_repository()
    sys.exit(main())
