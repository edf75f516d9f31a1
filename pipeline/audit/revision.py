"""Check out a commit beside the working tree, so that it can be read without touching anything."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.git import git, run
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT


@contextmanager
def checked_out(revision: str) -> Iterator[Path]:
    """Yield a temporary clone of the repository at a commit; it has no data and no results beyond git's.

    Raise InputError if git does not know the commit, or refuses to work here.
    """
    commit = resolve(revision)
    with tempfile.TemporaryDirectory(prefix="audit-") as folder:
        yield make_clone(ROOT, commit, Path(folder) / "clone")


def make_clone(root: Path, commit: str, clone: Path, left_out: Sequence[str] = ()) -> Path:
    """Check out a commit of the repository `root`, but for the folders `left_out`, in the new folder `clone`.

    Both share git's objects. Return the folder.
    """
    as_committed = ["--config", "core.autocrlf=false"]  # locks name bytes
    git(root, "clone", "--quiet", "--shared", "--no-checkout", *as_committed, str(root), str(clone))
    # a shallow repository's clone shares no objects, and has branches alone
    git(clone, "fetch", "--quiet", "origin", commit)
    if left_out:
        git(clone, "sparse-checkout", "set", "--no-cone", "/*", *(f"!/{folder}/" for folder in left_out))
    git(clone, "checkout", "--quiet", "--detach", commit)
    return clone


def resolve(revision: str) -> str:
    """Return a commit's full hash; raise InputError if git does not know it or refuses to look."""
    if revision.startswith("-"):
        raise InputError(f"commit {revision!r}: expected a hash, branch or tag")
    found = run(["git", "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"], ROOT, capture_output=True)
    if found.returncode:
        why = " ".join(found.stderr.split()) or "it is unknown: `git log --oneline` lists those of this clone"
        raise InputError(f"commit {revision!r}: {why}")
    return found.stdout.strip()
