"""Run a commit's stages again in its clone, with the packages that it pins, and compare every output with its lock."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import yaml

from pipeline.audit.revision import git
from pipeline.config.graph import ROOT
from pipeline.runtime.errors import InputError

PINNED = "requirements.lock"
PULL = ("dvc", "pull", "--quiet", "--allow-missing")
RECORDINGS = ("outputs/record/runs", "reports/recordings")  # hold times; recordings.csv has digests of their content


class Output(NamedTuple):
    """One output of a stage that was run again."""

    stage: str
    path: str
    identical: bool  # the same bytes as when the lock was written


def rerun(clone: Path, stages: list[str]) -> list[Output]:
    """Run stages of a commit again in its clone, and compare their outputs with those that its lock names."""
    before = _outputs(clone)
    ran = run(clone, stages)
    after = _outputs(clone)
    return [Output(*key, before.get(key) == after[key]) for key in ran]


def run_both(first: Path, second: Path, stages: list[str], profile: str) -> list[Output]:
    """Run stages at a profile in two clones, and compare their outputs."""
    run(first, stages, profile)
    ran = run(second, stages, profile)
    before, after = _outputs(first), _outputs(second)
    return [Output(*key, before.get(key) == after[key]) for key in ran]


def run(clone: Path, stages: list[str], profile: str = "") -> list[tuple[str, str]]:
    """Run stages, and all that they need, in a clone; all of the paper's if none is named. Commit the results there.

    Uses the running environment if it has the commit's packages, else makes the commit's own. Raise InputError if a
    stage is unknown or fails; its output is on the terminal. Return the outputs written, by stage and path.
    """
    known = yaml.safe_load((clone / "dvc.yaml").read_text())["stages"]
    if unknown := [name for name in stages if name.partition("@")[0] not in known]:
        raise InputError(f"stage {unknown[0]!r} is unknown: expected some of {', '.join(known)}")
    environment = _environment(clone)
    for _, path in _outputs(clone):  # those that git keeps
        shutil.rmtree(clone / path) if (clone / path).is_dir() else (clone / path).unlink(missing_ok=True)
    compose = [["python", "-m", "pipeline.params", f"profile={profile}"]] if profile else []
    for command in (*compose, [*PULL, "data.dvc"], ["dvc", "repro", *stages]):
        if subprocess.run(command, cwd=clone, env=environment, stdout=sys.stderr).returncode:
            raise InputError(f"`{' '.join(command)}` failed in a clone of the commit: its output is above")
    ran = [key for key in _outputs(clone) if (clone / key[1]).exists()]
    kept = [path for path in git(clone, "ls-files", "--deleted").splitlines() if path]
    for path in kept:  # of stages that were not run
        git(clone, "checkout", "--quiet", "--", path)
    git(clone, "add", "--all")
    author = ["-c", "user.name=audit", "-c", "user.email=audit@localhost"]
    git(clone, *author, "commit", "--quiet", "--allow-empty", "--message", "Run again by the audit")
    return ran


def _environment(clone: Path) -> dict[str, str]:
    """Return the environment variables under which a clone's stages find their packages and the clone's own code."""
    binaries = Path(sys.executable).parent
    if (clone / PINNED).read_text() != (ROOT / PINNED).read_text():
        subprocess.run(["make", "venv"], cwd=clone, check=True, stdout=sys.stderr)
        binaries = clone / ".venv" / "bin"
    return os.environ | {"PATH": f"{binaries}:{os.environ['PATH']}", "PYTHONPATH": str(clone), "PYTHONHASHSEED": "0"}


def _outputs(clone: Path) -> dict[tuple[str, str], str]:
    """Return the hash of every output of the paper's stages, by stage and path."""
    stages = yaml.safe_load((clone / "dvc.lock").read_text())["stages"]
    outputs = {(name, out["path"]): out["md5"] for name, stage in stages.items() for out in stage.get("outs", [])}
    return {key: md5 for key, md5 in outputs.items() if key[1] not in RECORDINGS}
