"""A recording is opened or verified, or an error says what to do."""

from pathlib import Path

import pytest

from pipeline.launch import load
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import PARAMS, ROOT
from pipeline.viewer.digest import digest
from pipeline.viewer.review import check, find, folders_of, show, worst
from pipeline.viewer.run import write_run
from tests.viewer.example import a_run

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


def test_a_clone_opens_what_git_keeps_and_the_stage_s_files_once_there_are_any(kept: Path, tmp_path: Path) -> None:
    assert find(kept, tmp_path, "full-careful-s3") == kept / "full-careful-s3.rrd"
    (tmp_path / "full-careful-s3.rrd").touch()
    assert find(kept, tmp_path, "full-careful-s3") == tmp_path / "full-careful-s3.rrd"


@pytest.mark.parametrize(
    ("run", "message"),
    [
        ("ae-normal-s0", "git does not keep ae-normal-s0: run `make repro` first, or open one of full-careful-s3"),
        ("full-careful-s99", "no recording 'full-careful-s99'.*such as full-careful-s3"),
    ],
)
def test_a_run_that_is_not_there_is_answered_with_what_to_do(kept: Path, run: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        find(kept, NONE, run)


def test_the_worst_run_is_the_least_accurate_of_those_there_are(kept: Path) -> None:
    run, why = worst(kept, NONE)
    assert run == "full-careful-s3" and "accuracy 50.0%, the lowest of the 1 recordings" in why


@pytest.mark.parametrize("content", [None, b"", b"run,sha256\nfull-careful-s0,a\n", b"run,sha256,accuracy\n\x80,a,1\n"])
def test_without_a_list_there_is_no_worst(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "recordings.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"recordings.csv .*run `make repro` first"):
        worst(tmp_path, NONE)


@pytest.mark.parametrize("share", ["", "half", "nan", "1.2"])
def test_an_accuracy_that_is_no_share_is_refused(kept: Path, tmp_path: Path, share: str) -> None:
    (tmp_path / "recordings.csv").write_text(f"run,sha256,accuracy\nfull-careful-s3,a,{share}\n")
    with pytest.raises(InputError, match="no accuracy from 0 to 1"):
        worst(tmp_path, kept)


def test_damaged_files_and_other_contents_than_those_listed_are_refused(kept: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings.csv").write_text("run,sha256,accuracy\nfull-careful-s3,0123,0.5\n")
    with pytest.raises(InputError, match="says 0123"):
        check(tmp_path, kept, "full-careful-s3")
    whole = (kept / "full-careful-s3.rrd").read_bytes()
    (tmp_path / "full-careful-s3.rrd").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="is damaged"):
        check(kept, tmp_path, "full-careful-s3")


def test_without_a_display_the_error_says_so(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match="no display"):
        show(kept / "full-careful-s3.rrd")


@pytest.mark.slow
def test_git_keeps_at_most_two_and_a_half_megabytes_of_readable_recordings() -> None:
    """What a clone opens: the overview and the worst run of each first variant."""
    cfg, folder = load(ROOT / PARAMS), ROOT / "reports" / "recordings"
    kept = sorted(folder.glob("*.rrd"))
    assert len(kept) == 1 + len(cfg.record.first)
    assert sum(path.stat().st_size for path in kept) <= 2_500_000
    for path in kept:
        check(folder, NONE, path.stem)


STUDIES = sorted(ROOT.glob("studies/*/recording"))


@pytest.mark.parametrize("folder", STUDIES, ids=lambda folder: folder.parent.name)
def test_a_study_s_recording_is_called_as_the_study_and_small(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    study = folder.parent.name
    assert folders_of(study)[0].resolve() == folder and folders_of("overview")[0] != folders_of(study)[0]
    check(*folders_of(study), study)
    assert find(*folders_of(study), study).stat().st_size <= 2_000_000
