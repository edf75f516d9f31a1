"""What the overview holds, read back with Rerun's own reader: every variant beside the truth."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.viewer.contents import FALSELY_INVALID, FALSELY_VALID, RIGHT, Run
from pipeline.viewer.digest import digest
from pipeline.viewer.geometry import footprints, on_table
from pipeline.viewer.overview import write_overview
from tests.viewer.example import read, read_images, read_maps, some_runs


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return some_runs()


@pytest.fixture(scope="module")
def recording(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("record") / "overview.rrd"
    write_overview(path, runs)
    return path


def test_maps_and_errors_of_every_user_and_variant_are_exact(runs: list[Run], recording: Path) -> None:
    for run in runs:
        predicted = np.stack([shown.predicted for shown in run.repairs])
        truth = np.stack([shown.truth for shown in run.repairs])
        assert np.array_equal(read_maps(recording, f"{run.user}/predicted/{run.variant}/map", np.float32), predicted)
        assert np.array_equal(read_maps(recording, f"{run.user}/truth/map", np.float32), truth)
        errors = read_maps(recording, f"{run.user}/errors/{run.variant}/map", np.uint8)
        assert np.array_equal(errors == RIGHT, (predicted > 0.5) == truth)
        assert np.array_equal(errors == FALSELY_VALID, (predicted > 0.5) & ~truth)
        assert np.array_equal(errors == FALSELY_INVALID, (predicted <= 0.5) & truth)
        assert run.agreement == pytest.approx((errors == RIGHT).mean())


def test_tables_are_the_scenes_with_their_footprints(runs: list[Run], recording: Path) -> None:
    for user in ("careful", "normal"):
        images = read_images(recording, f"{user}/table/image")
        strips = read(recording, f"{user}/table/items", "LineStrips2D:strips")
        for shown, image, outlines in zip(runs[0].repairs, images, strips, strict=True):
            assert np.array_equal(image, shown.image)
            for line, (_, outline) in zip(outlines, footprints(shown.layout), strict=True):
                assert np.allclose(line, on_table(outline), atol=1e-4)


def test_an_empty_layer_clears_that_of_the_scene_before(runs: list[Run], recording: Path) -> None:
    """A scene without room to keep clear and without a boundary says so, or the last scene's would be shown."""
    for entity in ("normal/table/kept_clear", "normal/truth/boundary"):
        assert read(recording, entity, "LineStrips2D:strips") == [[]] * len(runs[0].repairs)


def test_the_text_gives_every_variants_agreement_by_user(runs: list[Run], recording: Path) -> None:
    ((text,),) = read(recording, "text/overview", "TextDocument:text")
    prose, _, table = text.partition("| variant | careful | normal |")
    assert len(prose.split()) <= 120
    for careful, normal in (runs[:2], runs[2:]):
        assert f"| {careful.variant} | {careful.agreement:.0%} | {normal.agreement:.0%} |" in table


def test_rerun_verifies_the_file_with_its_blueprint(recording: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)]
    assert subprocess.run(command, capture_output=True).returncode == 0
    reader = RrdReader(recording)
    assert [entry.recording_id for entry in reader.recordings()] == ["overview"]
    assert len(reader.blueprints()) == 1


def test_six_variants_stay_below_a_megabyte(runs: list[Run], tmp_path: Path) -> None:
    six = [replace(run, variant=f"{run.variant}_{i}") for i in range(3) for run in runs]
    write_overview(tmp_path / "overview.rrd", six)
    assert (tmp_path / "overview.rrd").stat().st_size <= 1_000_000


def test_the_digest_is_of_the_contents(runs: list[Run], recording: Path, tmp_path: Path) -> None:
    again, other = tmp_path / "again.rrd", tmp_path / "other.rrd"
    write_overview(again, runs)
    assert digest(again) == digest(recording)
    last = runs[-1].repairs[-1]
    changed = replace(last, predicted=1 - last.predicted)
    write_overview(other, [*runs[:-1], replace(runs[-1], repairs=(*runs[-1].repairs[:-1], changed))])
    assert digest(other) != digest(recording)
