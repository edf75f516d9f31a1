"""Start git, DVC, make and Python in a repository's folder, whatever repository the caller's variables name.

Git sets GIT_DIR and others for hooks and `!` aliases. A child that inherits them works on the repository that they
name, not on its folder's. Text is UTF-8, whatever the caller's locale.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import ROOT

# of a clone, whatever the person's configuration says: git's bytes, all files, no hooks, no key
CONFIG = "core.autocrlf=false", "core.excludesFile=/dev/null", "core.hooksPath=/dev/null", "commit.gpgSign=false"
IN_HOOKS = "GIT_QUARANTINE_PATH", "GIT_PROTOCOL_FROM_USER"  # of pushes and submodules: unlisted, they forbid clones


@cache
def _local_variables() -> tuple[str, ...]:
    """Return the variables by which git names one repository, as git lists them, and IN_HOOKS."""
    command = ["git", "rev-parse", "--local-env-vars"]
    try:
        listed = subprocess.run(command, capture_output=True, encoding="utf-8", check=True)
    except FileNotFoundError as error:
        raise InputError("git is missing: apt-get install git") from error
    return *listed.stdout.split(), *IN_HOOKS


def forget_repository() -> None:
    """Remove the variables that name a repository from this process: for commands that git may have started."""
    with reported():
        for name in _local_variables():
            os.environ.pop(name, None)


def environment(env: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return this process's variables without those that name a repository, then with those of `env`."""
    kept = {name: value for name, value in os.environ.items() if name not in _local_variables()}
    return kept | {"PYTHONUTF8": "1"} | dict(env or {})


def run(
    command: Sequence[str], folder: Path, env: Mapping[str, str] | None = None, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command in `folder`, a repository's root, by subprocess.run with these variables changed and `options`.

    Git does not search the folders above: a download may be unpacked in another repository.
    """
    changed = {"GIT_CEILING_DIRECTORIES": str(folder.absolute().parent)} | dict(env or {})
    return subprocess.run(command, cwd=folder, env=environment(changed), encoding="utf-8", errors="replace", **options)


def git(folder: Path, *arguments: str, env: Mapping[str, str] | None = None) -> str:
    """Return what git prints in `folder`, with these variables; raise InputError with its message if it fails."""
    return _said(["git", *arguments], folder, env)


def dvc(folder: Path, *arguments: str) -> str:
    """Return what DVC prints in `folder`; raise InputError with its message if it fails."""
    return _said([sys.executable, "-m", "dvc", *arguments], folder)


def _said(command: list[str], folder: Path, env: Mapping[str, str] | None = None) -> str:
    ended = run(command, folder, env, capture_output=True)
    if ended.returncode:
        message = " ".join((ended.stderr or ended.stdout).split())[-400:]
        raise InputError(f"`{' '.join(command[:3])}` failed: {message}")
    return ended.stdout


@contextmanager
def checked_out(revision: str) -> Iterator[Path]:
    """Yield a temporary clone of the repository at a commit, without data. Raise InputError if git cannot make it."""
    commit = resolve(revision)
    with tempfile.TemporaryDirectory(prefix="audit-") as folder:
        yield make_clone(ROOT, commit, Path(folder) / "clone")


def make_clone(root: Path, commit: str, clone: Path, left_out: Sequence[str] = ()) -> Path:
    """Check out a commit of the repository `root`, but for the folders `left_out`, in `clone`; return that folder."""
    listed = git(root, "rev-list", "--objects", "--no-walk", "--missing=print", commit)
    if lacking := [line[1:] for line in listed.splitlines() if line.startswith("?")]:
        # a filter (`--filter=blob:none`) left these files out, and the clone's `git checkout` would do so, too
        key = git(root, "config", "--name-only", "--get-regexp", r"^remote\..*\.promisor$").split()[0]
        quietly = ["--quiet", "--no-tags", "--no-write-fetch-head", "--filter=blob:none"]
        git(root, "fetch", *quietly, key.removeprefix("remote.").removesuffix(".promisor"), *lacking)
    config = [word for setting in CONFIG for word in ("--config", setting)]
    git(root, "clone", "--quiet", "--shared", "--no-checkout", *config, str(root), str(clone))
    # a shallow repository's clone shares no objects, and has branches alone
    git(clone, "-c", "protocol.version=2", "fetch", "--quiet", str(root), commit)
    if left_out:
        git(clone, "sparse-checkout", "set", "--no-cone", "/*", *(f"!/{folder}/" for folder in left_out))
    git(clone, "checkout", "--quiet", "--detach", commit)
    return clone


def resolve(revision: str) -> str:
    """Return a commit's full hash; raise InputError if git does not know it or refuses to look."""
    found = run(["git", "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"], ROOT, capture_output=True)
    if found.returncode:
        advice = "`git log --oneline` lists what this clone has; if it is shallow, `git fetch --unshallow` brings more"
        why = " ".join(found.stderr.split()) or f"it is unknown: {advice}"
        raise InputError(f"commit {revision!r}: {why}")
    return found.stdout.strip()
