"""Check out a commit beside the working tree, so that it can be read without touching anything."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.config.graph import ROOT
from pipeline.runtime.errors import InputError


@contextmanager
def checked_out(revision: str) -> Iterator[Path]:
    """Yield a temporary clone of the repository at a commit; it has no data and no results beyond git's.

    Raise InputError if git does not know the commit.
    """
    commit = resolve(revision)
    with tempfile.TemporaryDirectory(prefix="audit-") as folder:
        yield make_clone(ROOT, commit, Path(folder) / "clone")


def make_clone(root: Path, commit: str, clone: Path, left_out: Sequence[str] = ()) -> Path:
    """Check out a commit of the repository `root`, but for the folders `left_out`, in the new folder `clone`.

    Both share git's objects. Return the folder.
    """
    git(root, "clone", "--quiet", "--shared", "--no-checkout", str(root), str(clone))
    if left_out:
        git(clone, "sparse-checkout", "set", "--no-cone", "/*", *(f"!/{folder}/" for folder in left_out))
    git(clone, "checkout", "--quiet", "--detach", commit)
    return clone


def resolve(revision: str) -> str:
    """Return a commit's full hash; raise InputError if git does not know it."""
    if revision.startswith("-"):
        raise InputError(f"commit {revision!r}: expected a hash, branch or tag")
    try:
        return git(ROOT, "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}").strip()
    except InputError:
        raise InputError(f"commit {revision!r} is unknown: `git log --oneline` lists those of this clone") from None


def git(folder: Path, *arguments: str, env: Mapping[str, str] | None = None) -> str:
    """Return what git prints; raise InputError with its message if it fails."""
    return _run(["git", *arguments], folder, env)


def dvc(folder: Path, *arguments: str) -> str:
    """Return what DVC prints, without analytics; raise InputError with its message if it fails."""
    return _run([sys.executable, "-m", "dvc", *arguments], folder)


def _run(command: list[str], folder: Path, env: Mapping[str, str] | None = None) -> str:
    ended = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    if ended.returncode:
        message = " ".join((ended.stderr or ended.stdout).split())[-400:]
        raise InputError(f"`{' '.join(command[:3])}` failed: {message}")
    return ended.stdout
