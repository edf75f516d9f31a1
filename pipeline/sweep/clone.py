"""Light clones of one commit in which jobs run their stages, with the DVC cache of the repository they came from."""

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from filelock import FileLock, Timeout

from pipeline.audit.revision import make_clone
from pipeline.git import git

# What a job runs; pages and locks in studies/ are results, not code. A pathspec with a * matches files, not folders.
CODE = ["conf", "pipeline", "studies", "dvc.yaml", "data.dvc", "rendered", "making"]
CODE += [
    ":!studies/dvc.lock",
    *(f":!studies/*/{name}" for name in ("dvc.lock", "index.html", "provenance.json", "figures/*", "tables/*")),
]
EMPTY_TREE = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"  # git's name of a tree without files
LEFT_OUT = ("store", "examples", "tests", "bench")  # folders that no stage reads
CONFIG = """[core]
    site_cache_dir = "{clone}/.dvc/tmp/site"
[cache]
    dir = "{cache}"
    type = "reflink,hardlink,copy"
['remote "store"']
    url = "{root}/store"
"""


def snapshot(root: Path) -> str:
    """Return the commit to run: HEAD, or one above it with the uncommitted changes and new files of CODE.

    The made commit is on no branch and touches neither index nor working tree. The same changes give the same commit.
    """
    head = git(root, "rev-parse", "HEAD").strip()
    if not git(root, "status", "--porcelain", "--untracked-files=all", "--", *CODE):
        return head
    date = git(root, "log", "-1", "--format=%cI").strip()
    env = {f"GIT_{who}_{what}": "sweep" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    with TemporaryDirectory() as folder:
        env |= {"GIT_INDEX_FILE": f"{folder}/index", "GIT_AUTHOR_DATE": date, "GIT_COMMITTER_DATE": date}
        git(root, "read-tree", "HEAD", env=env)
        git(root, "add", "--all", "--", *CODE, env=env)
        tree = git(root, "write-tree", env=env).strip()
        return git(root, "commit-tree", tree, "-p", head, "-m", "Uncommitted changes of a sweep", env=env).strip()


def code_digest(root: Path, commit: str) -> str:
    """Return a digest of everything in a commit that a job runs."""
    return hashlib.sha256(git(root, "diff-tree", "-r", EMPTY_TREE, commit, "--", *CODE).encode()).hexdigest()[:16]


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
            make_clone(root, commit, clone, LEFT_OUT)
            (clone / ".dvc" / "config.local").write_text(CONFIG.format(clone=clone, cache=cache, root=root))
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
