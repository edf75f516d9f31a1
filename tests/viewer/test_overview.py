"""What the overview holds, read back with Rerun's own reader: every variant beside the truth, the worst scene first."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.legend import label
from pipeline.runtime.errors import InputError
from pipeline.viewer.compared import read_overview, write_comparison
from pipeline.viewer.contents import ACCEPTED, FALSELY_INVALID, FALSELY_VALID, REJECTED, Run
from pipeline.viewer.run import write_overview
from pipeline.viewer.scene import OUTCOME
from tests.viewer.example import read, read_maps, some_runs

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return some_runs()


@pytest.fixture(scope="module")
def recording(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("record") / "overview.rrd"
    write_overview(path, runs)
    return path


def test_maps_and_titles_are_every_variant_s_verdicts_beside_the_truth(runs: list[Run], recording: Path) -> None:
    for run in runs:
        of_user = [other for other in runs if other.user == run.user]
        mean = [np.mean([other.shown[scene].agreement for other in of_user]) for scene in range(len(run.shown))]
        scenes = [run.shown[scene] for scene in np.argsort(mean)]  # the worst first
        truth = np.stack([shown.truth for shown in scenes])
        accepted = np.stack([shown.predicted for shown in scenes]) > 0.5
        outcomes = read_maps(recording, f"{run.user}/{run.variant}")
        assert np.array_equal(np.isin(outcomes, (OUTCOME + ACCEPTED, OUTCOME + FALSELY_VALID)), accepted)
        assert np.array_equal(outcomes <= OUTCOME + ACCEPTED, accepted == truth)
        assert np.array_equal(read_maps(recording, f"{run.user}/truth"), OUTCOME + truth)
        for titles, shown in zip(read(recording, f"{run.user}/titles", "Points2D:labels"), scenes, strict=True):
            assert titles[:2] == [f"New scene {shown.scene}", "Truth"]
            assert f"{label(run.variant)}: {shown.agreement:.0%} right" in titles


def test_two_overviews_show_what_was_right_and_is_wrong_now(runs: list[Run], recording: Path, tmp_path: Path) -> None:
    first, *others = runs
    scene, *rest = first.shown
    wrong = np.where(scene.predicted > 0.5, np.float32(0), np.float32(1))  # every verdict the other way round
    write_overview(tmp_path / "now.rrd", [replace(first, shown=(replace(scene, predicted=wrong), *rest)), *others])
    before, now = read_overview(recording), read_overview(tmp_path / "now.rrd")
    right = (scene.predicted > 0.5) == scene.truth
    assert write_comparison(tmp_path / "compared.rrd", before, now) == right.sum()
    maps = read_maps(tmp_path / "compared.rrd", f"{first.user}/{first.variant}")
    assert np.array_equal(maps[0], OUTCOME + np.where(right, FALSELY_VALID, FALSELY_INVALID))
    assert set(np.unique(maps[1:])) <= {OUTCOME + REJECTED, OUTCOME + ACCEPTED}
    elsewhere = {key: OUTCOME + ((classes - OUTCOME) ^ 1) for key, classes in before.items()}  # other truths
    with pytest.raises(InputError, match="share no model and scene"):  # scenes of one title in another world
        write_comparison(tmp_path / "elsewhere.rrd", before, elsewhere)
