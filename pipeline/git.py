"""Start git, DVC, make and Python in a repository's folder, whatever repository the caller's variables name.

Git sets GIT_DIR and others for hooks and `!` aliases. A child that inherits them works on the repository that they
name, not on its folder's. Text is UTF-8, whatever the caller's locale.
"""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.runtime.errors import InputError, reported

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
    """Run a command in `folder`, the root of a repository, with these variables changed; return it when it has ended.

    Git does not search the folders above: a download may be unpacked in another repository. `options`: of
    subprocess.run.
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
