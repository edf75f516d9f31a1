"""Light clones of one commit in which jobs run their stages, with the DVC cache of the repository they came from."""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pipeline.audit.revision import git

# What a job runs; pages and locks in studies/ are results, not code.
CODE = ("conf", "pipeline", "studies", "dvc.yaml", "data.dvc", "rendered")
RESULTS = tuple(f":!studies/*/{name}" for name in ("dvc.lock", "index.html", "figures", "tables"))
LEFT_OUT = ("store", "examples", "tests", "bench", "drawing")  # folders that no stage reads
CONFIG = """[core]
    site_cache_dir = {clone}/.dvc/tmp/site
[cache]
    dir = {cache}
    type = "reflink,hardlink,copy"
['remote "store"']
    url = {root}/store
"""


def snapshot(root: Path) -> str:
    """Return the commit to run: HEAD, or one above it with the uncommitted changes and new files of CODE.

    The made commit is on no branch and touches neither index nor working tree. The same changes give the same commit.
    """
    head = git(root, "rev-parse", "HEAD").strip()
    if not git(root, "status", "--porcelain", "--untracked-files=all", "--", *CODE, *RESULTS).strip():
        return head
    date, index = git(root, "log", "-1", "--format=%cI").strip(), root / ".dvc" / "tmp" / f"sweep-index-{os.getpid()}"
    index.parent.mkdir(parents=True, exist_ok=True)
    identity = {f"GIT_{who}_{what}": "sweep" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    env = os.environ | identity | {"GIT_INDEX_FILE": str(index), "GIT_AUTHOR_DATE": date, "GIT_COMMITTER_DATE": date}

    def run(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", root, *arguments], env=env, check=True, capture_output=True, text=True
        ).stdout

    try:
        run("read-tree", "HEAD")
        run("add", "--all", "--", *CODE, *RESULTS)
        return run("commit-tree", run("write-tree").strip(), "-p", head, "-m", "Uncommitted changes of a sweep").strip()
    finally:
        index.unlink(missing_ok=True)


def code_digest(root: Path, commit: str) -> str:
    """Return a digest of everything in a commit that a job runs."""
    listed = git(root, "ls-tree", "-r", commit, "--", *CODE).splitlines()
    results = tuple(f"/{name}" for name in ("dvc.lock", "index.html")), ("/figures/", "/tables/")
    code = [x for x in listed if not (x.endswith(results[0]) or any(part in x for part in results[1]))]
    return hashlib.sha256("\n".join(code).encode()).hexdigest()[:16]


@contextmanager
def borrowed_clone(root: Path, commit: str, cache: Path, pool: Path) -> Iterator[Path]:
    """Yield a clone of `commit` that no other job of the sweep uses, from those in `pool`, or a new one.

    Clones are used again because the fast kernels are compiled, and data is hashed, once in each. After an error the
    clone is deleted.
    """
    pool.mkdir(parents=True, exist_ok=True)
    clone, lock = _take_free(pool)
    try:
        if not (clone / ".dvc" / "config.local").is_file():
            shutil.rmtree(clone, ignore_errors=True)
            _make_clone(root, commit, cache, clone)
        git(clone, "reset", "--quiet", "--hard")  # parameters, graph and locks of the job before
        yield clone
    except BaseException:
        shutil.rmtree(clone, ignore_errors=True)
        raise
    finally:
        lock.release()


def _take_free(pool: Path) -> tuple[Path, FileLock]:
    """Return the folder of the first clone that no other job holds, and its lock, acquired."""
    number = 0
    while True:
        lock = FileLock(pool / f"{number}.lock")
        try:
            lock.acquire(timeout=0)
            return pool / str(number), lock
        except Timeout:
            number += 1


def _make_clone(root: Path, commit: str, cache: Path, clone: Path) -> None:
    """Check out `commit` of the repository `root` in the new folder `clone`; git objects and DVC's cache are shared."""
    git(root, "clone", "--quiet", "--shared", "--no-checkout", str(root), str(clone))
    git(clone, "sparse-checkout", "set", "--no-cone", "/*", *(f"!/{folder}/" for folder in LEFT_OUT))
    git(clone, "checkout", "--quiet", "--detach", commit)
    (clone / ".dvc" / "config.local").write_text(CONFIG.format(clone=clone, cache=cache, root=root))
