"""Commands that git starts, as a hook or an alias, leave the person's repository as it is; clones have git's bytes."""

import hashlib
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.git import environment, forget_repository, git, make_clone, run
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.sweep.job import snapshot
from tests.sweep.running import clone_of_working_tree

# of a person: commits are signed, csv files ignored, hooks shared by all repositories, remotes named otherwise
PERSONAL = """[commit]\ngpgSign = true\n[core]\nexcludesFile = {0}/ignored\nhooksPath = {0}/hooks
[clone]\ndefaultRemoteName = up\n[protocol]\nversion = 0\n"""
MINE = ("-c", "user.name=me", "-c", "user.email=me@localhost")
SWEEP = f"{sys.executable} -m pipeline.sweep --multirun profile=smoke scenes.layout.clear_of_ends=0.9 --stages scenes"


@pytest.fixture(scope="module")
def person(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person's repository: a branch of the working tree, changes and new files of it too."""
    root = clone_of_working_tree(tmp_path_factory.mktemp("person") / "repository")
    git(root, "checkout", "--quiet", "-b", "mine")
    git(root, "config", "--unset", "core.hooksPath")  # hooks of a clone are off; a person's are not
    return root


@pytest.fixture
def personal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ignored").write_text("*.csv\n")
    (tmp_path / "config").write_text(PERSONAL.format(tmp_path))
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", str(tmp_path / "config"))


def worktree(person: Path, folder: Path) -> Path:
    git(person, "worktree", "add", "--quiet", str(folder / "tree"), "-b", folder.name)
    return folder / "tree"


def submodule(person: Path, folder: Path) -> Path:
    git(person, "clone", "--quiet", "--shared", str(person), str(folder / "above/sub"))
    git(folder / "above", "init", "--quiet")
    git(folder / "above", "submodule", "--quiet", "add", "./sub")
    git(folder / "above", "submodule", "--quiet", "absorbgitdirs")
    return folder / "above/sub"


def by_hook(tree: Path, script: Path) -> str:
    """What the script says as a pre-commit hook, which then refuses the commit."""
    hook = Path(git(tree, "rev-parse", "--path-format=absolute", "--git-path", "hooks").strip()) / "pre-commit"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text(f"#!/bin/sh\nenv | grep -q GIT_INDEX_FILE && sh {shlex.quote(str(script))}\nexit 1\n")
    hook.chmod(0o755)
    return run(["git", *MINE, "commit", "--allow-empty", "-m", "x"], tree, capture_output=True).stderr


def by_alias(tree: Path, script: Path) -> str:
    alias = f'alias.try=!test -n "$GIT_DIR" && sh {shlex.quote(str(script))} >&2'
    return run(["git", "-c", alias, "try"], tree, capture_output=True).stderr


def state(root: Path) -> list[str]:
    """What names a working tree's every byte, and what git knows."""
    config = Path(git(root, "rev-parse", "--path-format=absolute", "--git-common-dir").strip()) / "config"
    asked = (["symbolic-ref", "HEAD"], ["for-each-ref"], ["ls-files", "--stage"], ["status", "--porcelain"])
    return [config.read_text(), *(git(root, *question) for question in asked)]


@pytest.mark.slow
@pytest.mark.usefixtures("personal")
@pytest.mark.parametrize(
    ("place", "start", "command", "ends"),
    [
        (worktree, by_hook, f"{sys.executable} -m pipeline.audit HEAD --rerun nothing", "'nothing' is unknown"),
        (submodule, by_alias, "bash tests/smoke/run.sh {0}/smoke", "stopped: {0}/smoke"),
        (worktree, by_hook, f"{SWEEP} --folder {{0}}/swept; cat {{0}}/swept/jobs/*/log.txt", "no room for"),
    ],
)
def test_hooks_and_aliases_leave_the_person_s_repository_as_it_is(place, start, command, ends, person, tmp_path: Path):
    """The audit's clone has no such stage; the smoke run stops at its first dvc, the sweep's job where no item fits."""
    tree = place(person, tmp_path)
    stub = tmp_path / "bin/dvc"
    stub.parent.mkdir()
    stub.write_text("#!/bin/sh\necho stopped: $PWD >&2\nexit 1\n")
    stub.chmod(0o755)
    script = tmp_path / "script"
    script.write_text(f"PATH={stub.parent}:$PATH {command.format(tmp_path)} 2>&1")
    before = state(person), state(tree)
    said = start(tree, script)
    assert (state(person), state(tree)) == before
    assert ends.format(tmp_path) in said, said


def test_children_work_on_their_folder_whatever_repository_variables_name(tmp_path: Path, monkeypatch):
    for name in ("mine", "theirs"):
        git(tmp_path, "init", "--quiet", "--initial-branch", name, name)
    for name, value in {"GIT_DIR": ".git", "GIT_WORK_TREE": ".", "GIT_INDEX_FILE": ".git/index"}.items():
        monkeypatch.setenv(name, str(tmp_path / "theirs" / value))
    monkeypatch.setenv("GIT_AUTHOR_NAME", "me")
    monkeypatch.setenv("GIT_QUARANTINE_PATH", str(tmp_path))  # of a hook of a push
    monkeypatch.setenv("GIT_PROTOCOL_FROM_USER", "0")  # of a hook of `git submodule update`
    git(tmp_path, "clone", "--quiet", "mine", "clone")
    assert git(tmp_path / "mine", "symbolic-ref", "--short", "HEAD") == "mine\n"
    assert environment({"GIT_PREFIX": "x"}).keys() >= {"GIT_AUTHOR_NAME", "GIT_PREFIX"}
    assert not {"GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"} & environment().keys()
    forget_repository()
    said = subprocess.run(["git", "symbolic-ref", "HEAD"], cwd=tmp_path / "mine", capture_output=True, text=True)
    assert said.stdout == "refs/heads/mine\n"


def test_git_says_itself_that_a_folder_is_no_repository_though_it_lies_in_one(tmp_path: Path):
    git(tmp_path, "init", "--quiet")
    (tmp_path / "download").mkdir()
    with pytest.raises(InputError, match="not a git repository"):
        git(tmp_path / "download", "rev-parse", "--git-dir")


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A repository of two commits, of which others may be cloned."""
    git(tmp_path, "init", "--quiet", "whole")
    for text in ("1", "2"):
        (tmp_path / "whole/file").write_text(text)
        git(tmp_path / "whole", "add", "file")
        git(tmp_path / "whole", *MINE, "commit", "--quiet", "--message", text)
    git(tmp_path / "whole", "config", "uploadpack.allowFilter", "true")
    git(tmp_path / "whole", "config", "uploadpack.allowAnySHA1InWant", "true")
    return tmp_path / "whole"


def test_an_old_commit_of_a_clone_without_old_files_is_whole(tmp_path: Path, whole: Path):
    git(tmp_path, "clone", "--quiet", "--filter=blob:none", f"file://{whole}", "partial")
    before = state(tmp_path / "partial")
    clone = make_clone(tmp_path / "partial", git(whole, "rev-parse", "HEAD~1").strip(), tmp_path / "clone")
    assert (clone / "file").read_text() == "1" and state(tmp_path / "partial") == before


def test_in_a_clone_no_hook_of_the_person_s_runs_and_no_key_and_no_file_is_missed(tmp_path, whole: Path, request):
    request.getfixturevalue("personal")
    (tmp_path / "hooks").mkdir()
    for name in ("post-checkout", "pre-commit"):
        (tmp_path / "hooks" / name).write_text("#!/bin/sh\nexit 1\n")
        (tmp_path / "hooks" / name).chmod(0o755)
    clone = make_clone(whole, git(whole, "rev-parse", "HEAD~1").strip(), tmp_path / "clone")
    (clone / "a.csv").write_text("")
    git(clone, "add", "--all")
    git(clone, *MINE, "commit", "--quiet", "--message", "x")
    assert git(clone, "ls-files").split() == ["a.csv", "file"]


def test_a_clone_of_a_shallow_repository_has_uncommitted_changes_too(tmp_path: Path, whole: Path):
    git(tmp_path, "clone", "--quiet", "--depth=1", f"file://{tmp_path}/whole", "shallow")
    (tmp_path / "shallow/file").write_text("3")
    clone = make_clone(tmp_path / "shallow", snapshot(tmp_path / "shallow"), tmp_path / "clone")
    assert (clone / "file").read_text() == "3"


def test_a_hook_of_commit_all_may_start_a_sweep_and_the_index_stays_as_it_is(whole: Path):
    (whole / "file").write_text("3")
    (whole / ".git/index.lock").touch()  # git holds it
    before = (whole / ".git/index").read_bytes()
    assert git(whole, "show", f"{snapshot(whole)}:file") == "3"
    assert (whole / ".git/index").read_bytes() == before


def test_text_is_utf_8_whatever_the_locale_and_what_a_terminal_lacks_is_replaced(tmp_path: Path):
    code = "import pipeline.git as g, pathlib; g.forget_repository(); print(g.git(pathlib.Path('.'), 'show', 'HEAD:e'))"
    git(tmp_path, "init", "--quiet")
    (tmp_path / "e").write_text("ü 盤", encoding="utf-8")
    git(tmp_path, "add", ".")
    git(tmp_path, *MINE, "commit", "--quiet", "--message", "x")
    latin = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C", "PYTHONPATH": str(ROOT)}
    ended = run([sys.executable, "-c", code], tmp_path, latin, capture_output=True)
    assert ended.stdout == "? ?\n", ended.stderr


def test_a_machine_without_git_is_told_so(tmp_path: Path):
    code = "import pipeline.git as g; g.forget_repository()"
    ended = run([sys.executable, "-c", code], ROOT, {"PATH": str(tmp_path)}, capture_output=True)
    assert (ended.returncode, ended.stderr) == (2, "error: git is missing: apt-get install git\n")


@pytest.mark.slow
def test_a_clone_has_git_s_bytes_where_git_is_told_to_change_line_ends(person: Path, tmp_path: Path):
    git(tmp_path, "clone", "--quiet", "--shared", "--config", "core.autocrlf=true", str(person), "clone")
    listed = [line.split("\t") for line in git(tmp_path / "clone", "ls-files", "--stage").splitlines()]
    changed = []
    for entry, name in listed:
        content = (tmp_path / "clone" / name).read_bytes()
        blob = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()
        changed += [name] if blob != entry.split()[1] else []
    assert len(listed) > 500 and not changed
    git(tmp_path / "clone", "add", "--renormalize", ".")
    assert git(tmp_path / "clone", "status", "--porcelain") == ""
