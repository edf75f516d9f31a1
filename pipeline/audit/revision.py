"""Check out a commit beside the working tree, so that it can be read without touching anything."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.git import git, run
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT

# of a clone, whatever the person's configuration says: git's bytes, all files, no hooks, no key
CONFIG = "core.autocrlf=false", "core.excludesFile=/dev/null", "core.hooksPath=/dev/null", "commit.gpgSign=false"


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
    _fetch_lacking(root, commit)
    config = [word for setting in CONFIG for word in ("--config", setting)]
    git(root, "clone", "--quiet", "--shared", "--no-checkout", *config, str(root), str(clone))
    # a shallow repository's clone shares no objects, and has branches alone
    git(clone, "-c", "protocol.version=2", "fetch", "--quiet", str(root), commit)
    if left_out:
        git(clone, "sparse-checkout", "set", "--no-cone", "/*", *(f"!/{folder}/" for folder in left_out))
    git(clone, "checkout", "--quiet", "--detach", commit)
    return clone


def _fetch_lacking(root: Path, commit: str) -> None:
    """Fetch the files of a commit that a clone with a filter (`--filter=blob:none`) left out.

    Clones of it cannot: their `git checkout` leaves these files out, too, and ends with 0.
    """
    listed = git(root, "rev-list", "--objects", "--no-walk", "--missing=print", commit)
    if lacking := [line[1:] for line in listed.splitlines() if line.startswith("?")]:
        key = git(root, "config", "--name-only", "--get-regexp", r"^remote\..*\.promisor$").split()[0]
        quietly = ["--quiet", "--no-tags", "--no-write-fetch-head", "--filter=blob:none"]
        git(root, "fetch", *quietly, key.removeprefix("remote.").removesuffix(".promisor"), *lacking)


def resolve(revision: str) -> str:
    """Return a commit's full hash; raise InputError if git does not know it or refuses to look."""
    found = run(["git", "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"], ROOT, capture_output=True)
    if found.returncode:
        advice = "`git log --oneline` lists what this clone has; if it is shallow, `git fetch --unshallow` brings more"
        why = " ".join(found.stderr.split()) or f"it is unknown: {advice}"
        raise InputError(f"commit {revision!r}: {why}")
    return found.stdout.strip()
