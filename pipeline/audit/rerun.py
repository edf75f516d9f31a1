"""Run a commit's stages again in its clone, with the packages that it pins."""

import hashlib
import os
import shutil
import sys
from pathlib import Path

import yaml

from pipeline.audit.consistency import read_locks
from pipeline.git import git
from pipeline.git import run as run_in
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT

PINNED = "requirements.lock"
RECORDINGS = "reports/recordings"  # other bytes in each run; recordings.csv has digests of their content

Hashes = dict[tuple[str, str], str]  # stage, path -> md5


def run(clone: Path, stages: list[str], profile: str | None = None) -> Hashes:
    """Run stages, and all that they need, in a clone; all of the paper's if none is named. Commit the results there.

    Uses the running environment if it has the commit's packages, else makes the commit's own. Raise InputError if a
    stage is unknown or fails; its output is on the terminal. Return the hashes of the outputs written.
    """
    known = yaml.safe_load((clone / "dvc.yaml").read_bytes())["stages"]
    if unknown := [name for name in stages if name.partition("@")[0] not in known]:
        raise InputError(f"stage {unknown[0]!r} is unknown: expected some of {', '.join(known)}")
    binaries = Path(sys.executable).parent
    if (clone / PINNED).read_bytes() != (ROOT / PINNED).read_bytes():
        if run_in(["make", "venv"], clone, stdout=sys.stderr).returncode:
            raise InputError("`make venv` failed in a clone of the commit: its output is above")
        binaries = clone / ".venv" / "bin"
    changes = {"PATH": f"{binaries}:{os.environ['PATH']}", "PYTHONPATH": str(clone), "PYTHONHASHSEED": "0"}
    for _, path in outputs(clone):  # those that git keeps
        shutil.rmtree(clone / path) if (clone / path).is_dir() else (clone / path).unlink(missing_ok=True)
    compose = [["python", "-m", "pipeline.params", f"profile={profile}"]] if profile else []
    cache = ["dvc", "cache", "dir", "--quiet", "--local", str(clone / ".dvc/cache")]  # no other, which has results
    pull = ["dvc", "pull", "--quiet", "--remote", "store", "data.dvc"]
    for command in (cache, *compose, pull, ["dvc", "repro", *stages]):
        if run_in(command, clone, changes, stdout=sys.stderr).returncode:
            raise InputError(f"`{' '.join(command)}` failed in a clone of the commit: its output is above")
    ran = {key: md5 for key, md5 in outputs(clone).items() if (clone / key[1]).exists()}
    for path in git(clone, "ls-files", "--deleted").splitlines():  # of stages that were not run
        git(clone, "checkout", "--quiet", "--", path)
    git(clone, "add", "--all")
    author = ["-c", "user.name=audit", "-c", "user.email=audit@localhost"]
    git(clone, *author, "commit", "--quiet", "--allow-empty", "--message", "Run again by the audit")
    return ran


def outputs(clone: Path) -> Hashes:
    """Return the hash of every output of the paper's stages that their lock names, and of the table of recordings."""
    stages = {name: lock for name, lock in read_locks(clone).items() if not name.startswith("studies/")}
    outs = ((name, out) for name, lock in stages.items() for out in lock.get("outs", []))
    hashes = {(name, out["path"]): out["md5"] for name, out in outs if out["path"] != RECORDINGS}
    if (table := clone / RECORDINGS / "recordings.csv").is_file():
        hashes["record", f"{RECORDINGS}/recordings.csv"] = hashlib.md5(table.read_bytes()).hexdigest()
    return hashes
