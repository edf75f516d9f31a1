"""A recording is opened or verified, or an error says what to do."""

import re
import subprocess
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from pipeline.git import git
from pipeline.runtime.errors import InputError
from pipeline.viewer.catalog import RUNS, SCENES, catalog
from pipeline.viewer.digest import digest, worst_scenes
from pipeline.viewer.linked import place, served
from pipeline.viewer.review import (
    REVIEWED,
    are_of_this_commit,
    check,
    find,
    linked_to,
    note,
    recordings,
    reviews,
    worst,
)
from pipeline.viewer.run import layout, write_run
from tests.viewer.example import a_run

PAGE = """<td class="number" title="t, c: source full, user careful; seeds 0–9">1</td><code>make review WORST=1</code>
<data value="2" title="t, c: variant ae, user careful" data-source="">2</data>"""
LAYOUT = {RUNS: layout(2)}
NONE = Path("no such folder")  # of recordings by the stage


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone: git keeps one run of two."""
    kept = tmp_path_factory.mktemp("kept")
    run = a_run(repairs=1)
    path = kept / f"{run.name}.rrd"
    write_run(path, run)
    rows = ["run,sha256,accuracy", f"{run.name},{digest(path)},0.5", "ae-normal-s0,0123,0.4"]
    (kept / "recordings.csv").write_text("\n".join(rows))
    return kept


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One of Zoë's, in which the test runs."""
    monkeypatch.chdir(tmp_path)
    for arguments in (("init", "--quiet"), ("config", "user.name", "Zoë"), ("config", "user.email", "zoe@localhost")):
        git(tmp_path, *arguments)
    return tmp_path


def test_a_clone_opens_what_git_keeps_and_the_stage_s_files_once_there_are_any(kept: Path, tmp_path: Path) -> None:
    assert find(kept, tmp_path, "full-careful-s3") == kept / "full-careful-s3.rrd"
    (tmp_path / "recordings.csv").write_text("of another commit")
    assert not are_of_this_commit(kept, tmp_path)
    (tmp_path / "recordings.csv").write_bytes((kept / "recordings.csv").read_bytes())
    assert are_of_this_commit(kept, tmp_path)
    (tmp_path / "full-careful-s3.rrd").touch()
    assert find(kept, tmp_path, "full-careful-s3") == tmp_path / "full-careful-s3.rrd"
    with pytest.raises(InputError, match=r"no recording 'ae-normal-s0' here, but full-careful-s3: .* `make repro`"):
        find(kept, tmp_path, "ae-normal-s0")


def test_the_worst_run_is_the_least_accurate_of_those_there_are(kept: Path, tmp_path: Path) -> None:
    run, why = worst(kept, NONE)
    assert run == "full-careful-s3" and "accuracy 50.0%, the lowest of the 1 recordings" in why
    with pytest.raises(InputError, match=r"recordings.csv is missing: run `make repro`"):
        worst(tmp_path, NONE)
    for share in ("", "half", "nan", "1.2"):
        (tmp_path / "recordings.csv").write_text(f"run,sha256,accuracy\nfull-careful-s3,a,{share}\n")
        with pytest.raises(InputError, match="no accuracy from 0 to 1"):
            worst(tmp_path, kept)


def test_damaged_files_and_other_contents_than_those_listed_are_refused(kept: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings.csv").write_text("run,sha256,accuracy\nfull-careful-s3,abcd,0.5\n")
    with pytest.raises(InputError, match="says abcd"):
        check(tmp_path, kept, "full-careful-s3")
    whole = (kept / "full-careful-s3.rrd").read_bytes()
    (tmp_path / "full-careful-s3.rrd").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="is damaged"):
        check(kept, tmp_path, "full-careful-s3")


def test_the_catalog_has_every_run_with_its_facts_and_links_to_its_worst_scenes(kept: Path, repository: Path) -> None:
    note(kept, NONE, "full-careful-s3", "right", None, "")
    note(kept, NONE, "full-careful-s3", "wrong", 1, 'through the "glass", twice')
    assert git(repository, "log", "--format=%s %an").splitlines()[0] == "Review of full-careful-s3: wrong Zoë"
    assert git(repository, "status", "--porcelain") == ""
    (repository / "ae-normal-s0.rrd").write_text("no recording")
    broken = {"ae-normal-s0": repository / "ae-normal-s0.rrd"}
    with (
        pytest.raises(InputError, match="no recording of a run can be read"),
        catalog(broken, LAYOUT, reviews(kept), ""),
    ):
        pass
    files = recordings(kept, NONE) | broken
    before = files["full-careful-s3"].read_bytes()
    with catalog(files, LAYOUT, reviews(kept), "abc") as client:
        (run,) = client.get_dataset(RUNS).segment_table().to_pandas().to_dict("records")
        scenes = client.get_table(SCENES).reader().to_pandas().set_index("scene")
        page = linked_to(client, 80, PAGE)
    facts = {"run:accuracy": 0.5, "run:unsafe_repairs": 7, "review:commit": "abc", "review:verdict": "right"}
    assert {name: run[f"property:{name}"][0] for name in facts} == facts
    assert scenes.loc[1, ["verdict", "note"]].tolist() == ["wrong", 'through the "glass", twice']
    assert scenes["verdict"].isna().sum() == 2
    assert str(scenes.loc[1, "link"]).endswith("segment_id=full-careful-s3#when=repair_step@62")
    assert files["full-careful-s3"].read_bytes() == before
    assert page.count("<a href=") == 2 and page.count("segment_id%3Dfull-careful-s3%23when%3Drepair_step") == 2
    REVIEWED.write_text(REVIEWED.read_text().replace(digest(files["full-careful-s3"]), "of other contents"))
    assert reviews(kept).empty


def test_a_note_that_cannot_be_kept_leaves_the_file_as_it_was(kept: Path, repository: Path) -> None:
    with pytest.raises(InputError, match=r"scene 9 is none of the worst of full-careful-s3: .* \[0, 1, 2\]"):
        note(kept, NONE, "full-careful-s3", "wrong", 9, "")
    note(kept, NONE, "full-careful-s3", "wrong", 1, "")
    (hook := repository / ".git/hooks/pre-commit").write_text("#!/bin/sh\nexit 1\n")
    hook.chmod(0o755)
    row = REVIEWED.read_text().splitlines()[1]
    cases = {"": "commit", "<<<<<<< HEAD\n": "marks", f"{row},more\n": "marks", row.replace("wrong", "bad"): "bad"}
    for added, message in cases.items():
        REVIEWED.write_text(before := REVIEWED.read_text().splitlines()[0] + f"\n{row}\n{added}")
        with pytest.raises(InputError, match=message):
            note(kept, NONE, "full-careful-s3", "right", None, "")
        assert REVIEWED.read_text() == before
        REVIEWED.write_text(before.removesuffix(added))
    assert git(repository, "status", "--porcelain") == ""


def test_a_note_in_a_merge_leaves_what_the_merge_staged_and_other_contents_get_none(
    kept: Path, repository: Path
) -> None:
    (repository / "recordings.csv").write_text("run,sha256,accuracy\nfull-careful-s3,abcd,0.5\n")
    with pytest.raises(InputError, match="says abcd"):
        note(repository, kept, "full-careful-s3", "right", None, "")
    note(kept, NONE, "full-careful-s3", "right", None, "both")
    first = git(repository, "rev-parse", "HEAD").strip()
    for branch in ("theirs", "ours"):
        git(repository, "checkout", "--quiet", "-b", branch, first)
        (repository / "text").write_text(branch)
        git(repository, "add", "text")
        git(repository, "commit", "--quiet", "--message", branch)
        if branch == "theirs":
            note(kept, NONE, "full-careful-s3", "wrong", None, branch)
    with pytest.raises(InputError):
        git(repository, "merge", "theirs")
    merged = git(repository, "ls-files", "--stage")
    with pytest.raises(InputError, match="merge"):
        note(kept, NONE, "full-careful-s3", "right", None, "ours")
    assert git(repository, "ls-files", "--stage") == merged and "reviewed.csv" in merged


def test_the_command_of_the_guide_names_a_worst_scene_of_a_recording_in_git_and_keeps_its_note() -> None:
    root = Path(__file__).parents[2]
    run, scene = re.search(r"make reviewed RUN=(\S+) SCENE=(\d+)", (root / "docs/review.md").read_text()).groups()  # pyright: ignore
    assert int(scene) in worst_scenes(root / f"reports/recordings/{run}.rrd")
    (rule,) = re.findall(r"^override export NOTE.*$", (root / "Makefile").read_text(), re.MULTILINE)
    said = subprocess.run(
        ["make", "--silent", "--file=-", "NOTE=5 $HOME"],
        input=f'NOTE ?=\n{rule}\nall:\n\t@echo "$$NOTE"\n', text=True, capture_output=True, check=True,
    ).stdout  # fmt: skip
    assert said == "5 $HOME\n"


def test_a_number_is_seen_in_the_least_accurate_run_at_its_scene_or_its_added_item() -> None:
    run = {"variant": "full", "user": "careful", "seed": 0, "run": "a", "accuracy": 0.5, "scenes": [7], "steps": [30]}
    runs = [run, run | {"run": "b", "seed": 1, "accuracy": 0.4, "scenes": [9], "steps": [31]}]
    full = {"variant": "full", "user": "careful"}
    assert place(runs, full) == ("b", "repair_step", 31)
    for named in ({"seed": "0"}, {"scene": "7"}):
        assert place(runs, full | named) == ("a", "repair_step", 30)
    assert place(runs, full | {"symbol": "glass"}) == ("b", "intervention", 3)
    assert place(runs, {"variant": "truth"}) is None and place(runs, {"split": "new_items"}) is None


def test_pages_alone_are_served(tmp_path: Path) -> None:
    for name in ("reports/a.html", "reports/page.css", ".git/config"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("é")
    with served(tmp_path, lambda page: page * 2) as address:
        assert urlopen(f"{address}/reports/a.html").read().decode() == "éé"
        assert urlopen(f"{address}/reports/page.css").read().decode() == "é"
        for name in (".git/config", "reports/../.git/config", "reports/", ""):
            with pytest.raises(HTTPError, match="404"):
                urlopen(f"{address}/{name}")
