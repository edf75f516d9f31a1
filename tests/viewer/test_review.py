"""A recording is opened or verified, or an error says what to do."""

from pathlib import Path

import pytest

from pipeline.runtime.errors import InputError
from pipeline.viewer.digest import digest
from pipeline.viewer.review import check, find, show, worst
from pipeline.viewer.run import write_run
from tests.viewer.example import a_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("record")
    (folder / "runs").mkdir()
    run = a_run(repairs=1)
    write_run(folder / "runs" / f"{run.name}.rrd", run)
    contents = digest(folder / "runs" / f"{run.name}.rrd")
    (folder / "recordings.csv").write_text(f"run,sha256,agreement\n{run.name},{contents},0.5\n")
    return folder


def test_a_recording_that_holds_what_was_written_passes(folder: Path) -> None:
    check(folder, "full-careful-s3")


def test_an_unknown_run_is_answered_with_examples(folder: Path) -> None:
    with pytest.raises(InputError, match=r"'full-careful-s99'.*such as full-careful-s3"):
        find(folder, "full-careful-s99")


def test_without_recordings_the_error_names_make_repro(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="run `make repro` first"):
        find(tmp_path, "full-careful-s0")


def test_the_overview_is_found_beside_the_runs(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no overview in .*run `make repro` first"):
        find(folder, "overview")
    (tmp_path / "runs").symlink_to(folder / "runs")
    (tmp_path / "overview.rrd").touch()
    assert find(tmp_path, "overview") == tmp_path / "overview.rrd"


def test_the_worst_run_is_the_one_that_agrees_least(tmp_path: Path) -> None:
    rows = [
        "run,sha256,agreement",
        "full-careful-s0,a,0.61",
        "full-normal-s1,b,0.425",
        "ae-careful-s0,c,1",
        "overview,d,",
    ]
    (tmp_path / "recordings.csv").write_text("\n".join(rows) + "\n")
    run, why = worst(tmp_path)
    assert run == "full-normal-s1"
    assert "42.5%" in why and "of 3 runs" in why


@pytest.mark.parametrize("text", [None, "", "run,sha256\nfull-careful-s0,a\n"])
def test_without_agreements_there_is_no_worst(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "recordings.csv").write_text(text)
    with pytest.raises(InputError, match=r"recordings.csv .*run `make repro` first"):
        worst(tmp_path)


@pytest.mark.parametrize("row", ["full-careful-s0,a", "full-careful-s0,a,half", "full-careful-s0,a,nan", "overview,d,"])
def test_an_agreement_that_is_no_share_is_refused(tmp_path: Path, row: str) -> None:
    (tmp_path / "recordings.csv").write_text(f"run,sha256,agreement\n{row}\n")
    with pytest.raises(InputError, match="no agreement from 0 to 1"):
        worst(tmp_path)


def test_other_contents_than_those_listed_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").symlink_to(folder / "runs")
    (tmp_path / "recordings.csv").write_text("run,sha256,agreement\nfull-careful-s3,0123,0.5\n")
    with pytest.raises(InputError, match="says 0123"):
        check(tmp_path, "full-careful-s3")


def test_a_truncated_file_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    whole = (folder / "runs" / "full-careful-s3.rrd").read_bytes()
    (tmp_path / "runs" / "full-careful-s3.rrd").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "recordings.csv").write_text((folder / "recordings.csv").read_text())
    with pytest.raises(InputError, match="make repro"):
        check(tmp_path, "full-careful-s3")


def test_without_a_display_the_error_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match="no display"):
        show(find(folder, "full-careful-s3"))
