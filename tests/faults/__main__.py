"""Break runs of the smoke profile on purpose and count how they end: `make test-faults`; Linux, as root.

python -m tests.faults [--kills N] [--seed S] [--only WORD] [--whole DIR] [--out FILE]

A fault must end in a clear message or in the bytes of an unbroken run. Exit status 1 if one does not. --whole names a
finished `tests/smoke.sh DIR` to compare with, and saves making one.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import write_table

ROOT = Path(__file__).parents[2]
REPRO = ["make", "--assume-old=.venv/.ready", "repro"]
STUDY = ["dvc", "repro", "studies/identification/dvc.yaml"]
STAGES = ("scenes", "demos", "train", "irl", "clearance", "evaluate", "repair", "intervene", "record")
PAPER = (*(f"outputs/{stage}" for stage in STAGES), "reports")
RESULTS = ("outputs", "reports", "studies/identification")
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
            for path in [folder / "dvc.lock", *folder.glob("studies/*/dvc.lock"), *folder.glob("reports/**/*.*")]:
                path.unlink()
        if cache:
            shutil.copytree(whole / ".dvc/cache", folder / ".dvc/cache")
        subprocess.run(["dvc", "pull", "--quiet", "data.dvc", "rendered/pictures.dvc"], cwd=folder, check=True)

    def run(self, *command: str, timeout: float = 3600) -> subprocess.CompletedProcess[str]:
        """Return the ended command with what it said."""
        return subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=timeout)

    def differing(self, folders: tuple[str, ...] = RESULTS) -> list[str]:
        """Return the files that differ from the whole run's; of recordings, their digests are compared."""
        return [name for folder in folders for name in _differing(self.whole / folder, self.folder / folder)]

    def judge(self, done: subprocess.CompletedProcess[str], folders: tuple[str, ...] = RESULTS) -> tuple[str, str]:
        """Return how the fault ended, and the sentence or what is wrong."""
        if done.returncode == 0:
            different = self.differing(folders)
            return (WRONG, f"differs: {', '.join(different[:5])}") if different else (SAME, "")
        return said(done)


def said(done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
    """Return the message of a failed command; a traceback or silence is wrong."""
    lines = [line.strip() for line in (done.stderr + done.stdout).splitlines()]
    errors = [line for line in lines if line.lower().startswith(("error", "make: ***"))]
    if "Traceback (most recent call last)" in done.stderr + done.stdout:
        return WRONG, f"traceback: {lines[-1] if lines else ''}"
    return (MESSAGE, errors[0]) if errors else (WRONG, "no message")


def _differing(first: Path, second: Path) -> list[str]:
    def contents(folder: Path) -> dict[str, bytes]:
        files = [path for path in folder.rglob("*") if path.is_file() and path.suffix not in (".rrd", ".lock", ".pyc")]
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}

    before, after = contents(first), contents(second)
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


# Faults. Each takes the whole run, an empty folder, a generator and the number of kills, and returns how it ended, for
# each time that it was injected.

Ends = list[tuple[str, str]]


def _kills(broken: Broken, command: list[str], rng: np.random.Generator, kills: int, folders: tuple[str, ...]) -> Ends:
    """Kill the command with all its children again and again, then let it end."""
    done = 0
    for _ in range(kills):
        process = subprocess.Popen(
            command, cwd=broken.folder, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            process.wait(rng.exponential(MEAN_S) + 0.5)
            break  # it came to its end
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            done += 1
    end = broken.judge(broken.run(*command), folders)
    return [end] * max(done, 1)


def kill_the_paper(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """kill -9 of `make repro`, resumed"""
    return _kills(Broken(whole, folder, results=False, cache=False), REPRO, rng, kills, PAPER)


def kill_a_study(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """kill -9 of a study, resumed"""
    broken = Broken(whole, folder, results=True, cache=False)
    shutil.rmtree(broken.folder / "outputs/studies/identification")
    (broken.folder / "studies/identification/dvc.lock").unlink()
    return _kills(broken, STUDY, rng, -(-kills // 5), ("outputs/studies/identification", "studies/identification"))


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


def _damaged(
    whole: Path, folder: Path, rng: np.random.Generator, find: Callable[[Path], list[Path]], remove: str = ""
) -> Ends:
    """Damage a file of a clone that has results and cache, once cut and once flipped, and run it again."""
    ends = []
    for how in ("cut", "flip"):
        broken = Broken(whole, folder / how, results=True, cache=True)
        candidates = sorted(path for path in find(broken.folder) if path.stat().st_size > 100)
        _damage(candidates[int(rng.integers(len(candidates)))], rng, how)
        if remove:
            shutil.rmtree(broken.folder / remove)
        ends.append(broken.judge(broken.run(*REPRO), PAPER))
    return ends


def damaged_cache(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """damaged file in DVC's cache, its result restored"""
    import yaml

    lock = yaml.safe_load((whole / "dvc.lock").read_text())["stages"]["evaluate"]["outs"]
    names = [out["md5"] for out in lock if "md5" in out]
    return _damaged(
        whole,
        folder,
        rng,
        lambda clone: [p for m in names for p in clone.glob(f".dvc/cache/files/md5/{m[:2]}/{m[2:]}")],
        remove="outputs/evaluate",
    )


def damaged_store(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """damaged file in the store of data, pulled"""
    ends = []
    for how in ("cut", "flip"):
        broken = Broken(whole, folder / how, results=False, cache=False)
        shutil.rmtree(broken.folder / "data")
        shutil.rmtree(broken.folder / ".dvc/cache", ignore_errors=True)
        shutil.rmtree(broken.folder / ".dvc/tmp", ignore_errors=True)
        table = [p for p in broken.folder.glob("store/files/md5/*/*") if p.read_bytes()[:5] == b"name,"]
        _damage((table or sorted(broken.folder.glob("store/files/md5/*/*")))[0], rng, how)
        ends.append(broken.judge(broken.run(*REPRO), PAPER))
    return ends


def damaged_weights(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """damaged weights"""
    return _damaged(whole, folder, rng, lambda clone: list(clone.glob("outputs/*/*/weights/*.safetensors")))


def damaged_data(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """damaged file in data/"""
    return _damaged(whole, folder, rng, lambda clone: [p for p in clone.glob("data/items/*") if p.is_file()])


def two_at_once(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """two `make repro` at once"""
    broken = Broken(whole, folder, results=False, cache=False)
    first = subprocess.Popen(
        REPRO, cwd=broken.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    time.sleep(float(rng.uniform(4, 12)))
    second = broken.run(*REPRO)
    text, _ = first.communicate()
    ended = subprocess.CompletedProcess(REPRO, first.returncode, text, "")
    return [broken.judge(ended, PAPER), broken.judge(second, PAPER)]


def read_only_reports(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """reports/ read-only, then writable again"""
    broken = Broken(whole, folder, results=True, cache=True)
    (broken.folder / "reports/accuracy.html").write_text("edited")
    mount = "mount --bind reports reports && mount -o remount,bind,ro reports && exec " + " ".join(REPRO)
    refused = broken.run("unshare", "--mount", "bash", "-c", mount)
    return [said(refused) if refused.returncode else (WRONG, "wrote"), broken.judge(broken.run(*REPRO))]


def clock_set_back(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """clock set back by three days in the middle"""
    if not shutil.which("faketime"):
        return [("not tested", "faketime is not installed: apt-get install faketime")]
    broken = Broken(whole, folder, results=True, cache=True)
    for name in ("evaluate", "repair"):
        shutil.rmtree(broken.folder / "outputs" / name)
    shutil.rmtree(broken.folder / ".dvc/cache/runs", ignore_errors=True)
    (broken.folder / "reports/index.html").unlink()
    return [broken.judge(broken.run("faketime", "-f", "-3d", *REPRO), PAPER)]


def no_network(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """no network"""
    broken = Broken(whole, folder, results=False, cache=False)
    return [broken.judge(broken.run("unshare", "--net", *REPRO), PAPER)]


def full_disk(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """full disk (a small tmpfs), then room again"""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400m", "tmpfs", str(folder)], check=True)
    try:
        broken = Broken(whole, folder / "clone", results=False, cache=False)
        free = shutil.disk_usage(folder).free
        with (folder / "filler").open("wb") as filler:
            filler.write(bytes(free - int(rng.integers(1_000_000, 4_000_000))))
        refused = broken.run(*REPRO)
        (folder / "filler").unlink()
        return [
            said(refused) if refused.returncode else (WRONG, "it fitted"),
            broken.judge(broken.run(*REPRO), PAPER),
        ]
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def workers_and_folder(whole: Path, folder: Path, rng: np.random.Generator, kills: int) -> Ends:
    """two workers, everything with all studies, in a folder of another name"""
    broken = Broken(whole, folder / "a folder of another name", results=False, cache=False)
    broken.run(sys.executable, "-m", "pipeline.params", "profile=smoke", "workers=2")
    return [broken.judge(broken.run("dvc", "repro", "-P"), ("outputs", "reports", "studies"))]


FAULTS = (
    kill_the_paper, kill_a_study, damaged_cache, damaged_store, damaged_weights, damaged_data, two_at_once,
    read_only_reports, clock_set_back, no_network, full_disk, workers_and_folder,
)  # fmt: skip


def main() -> int:
    """Inject every fault, print how each ended, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--kills", type=int, default=5, help="times that a run is killed")
    parser.add_argument("--seed", type=int, default=0, help="of the moments and places")
    parser.add_argument("--only", default="", help="faults whose name holds this word")
    parser.add_argument("--whole", type=Path, help="a finished smoke run")
    parser.add_argument("--out", type=Path, help="csv to write")
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        whole = (given.whole or Path(temporary) / "whole").absolute()
        if not given.whole:
            subprocess.run(["bash", "tests/smoke.sh", str(whole)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        for fault in (fault for fault in FAULTS if given.only in fault.__name__):
            folder = Path(temporary) / fault.__name__
            ends = fault(whole, folder, np.random.default_rng(given.seed), given.kills)
            shutil.rmtree(folder, ignore_errors=True)
            for (end, message), times in pd.Series(ends).value_counts(sort=False).items():
                text = message.replace(str(folder), "").replace(temporary, "")
                rows.append({"fault": fault.__doc__, "times": times, "end": end, "message": text})
                print(f"{fault.__doc__}: {times} x {end} {text}", flush=True)
    if given.out:
        write_table(given.out, pd.DataFrame(rows))
    return int(any(row["end"] == WRONG for row in rows))


if __name__ == "__main__":
    sys.exit(main())
