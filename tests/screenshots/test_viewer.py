"""Rerun's own viewer, without a screen, shows the recordings: nothing blank, no error, each recording its own."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rerun.experimental import ViewerClient

from pipeline.runtime.places import ROOT
from pipeline.viewer.overview import write_overview
from pipeline.viewer.run import write_run
from pipeline.viewer.scene import INVALID, START, TIMELINES, VALID
from tests.screenshots.window import select, settled, viewer
from tests.viewer.example import STEPS, a_run, some_runs

REPAIRS, INTERVENTIONS = 0, 3  # tabs of a run
MIN_SPREAD, MIN_COLOURS = 20.0, 500  # of a screenshot with contents; a blank one has 0 and 1


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewerClient]:
    """A viewer with a run's recording open, of its own: the viewer keeps a layout for all that it opens."""
    path = tmp_path_factory.mktemp("recordings") / "run.rrd"
    write_run(path, a_run())
    with viewer() as client:
        client.open(str(path))
        yield client


@pytest.fixture(scope="module")
def overview(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewerClient]:
    """A viewer with an overview open."""
    path = tmp_path_factory.mktemp("recordings") / "overview.rrd"
    write_overview(path, some_runs())
    with viewer() as client:
        client.open(str(path))
        yield client


def screenshot(client: ViewerClient) -> np.ndarray:
    """Return the tab in front, without the text beside it and the viewer's notices, if no view reports an error."""
    image = settled(client)
    assert not any(view.reports for view in client.get_state().views)
    return image[80:-60, : int(0.74 * image.shape[1])]


def share(image: np.ndarray, colour: tuple[int, ...]) -> float:
    """Return the share of an image that is nearly of this colour."""
    return float((np.abs(image.astype(int) - colour).max(-1) < 12).mean())


def assert_shows_something(image: np.ndarray) -> None:
    assert image.std() > MIN_SPREAD
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > MIN_COLOURS


def test_a_run_shows_its_scenes_and_its_repairs_move(run: ViewerClient) -> None:
    (recording,) = run.get_state().recordings
    assert {timeline.name for timeline in recording.timelines} == set(TIMELINES)
    select(run, REPAIRS, "repair_step", 0)
    first = screenshot(run)
    select(run, REPAIRS, "repair_step", STEPS)
    last = screenshot(run)
    assert_shows_something(first)
    assert_shows_something(last)
    assert (first != last).any(-1).mean() > 0.001


def test_interventions_show_effects_in_both_colours_and_the_added_item(run: ViewerClient) -> None:
    select(run, INTERVENTIONS, "intervention", 1)
    image = screenshot(run)
    assert_shows_something(image)
    assert share(image, START) > 1e-5
    assert share(image, VALID) > 1e-4 and share(image, INVALID) > 1e-4


def test_the_overview_shows_errors_and_differs_from_a_run(run: ViewerClient, overview: ViewerClient) -> None:
    select(overview, 0, "scene", 1)
    select(run, REPAIRS, "repair_step", 0)
    compared = screenshot(overview)
    assert_shows_something(compared)
    assert share(compared, VALID) > 0.01 and share(compared, INVALID) > 0.01
    assert (screenshot(run) != compared).any(-1).mean() > 0.05


@pytest.mark.parametrize("path", sorted(ROOT.glob("studies/*/recording/*.rrd")), ids=lambda path: path.stem)
def test_a_study_s_recording_shows_something(path: Path) -> None:
    with viewer() as client:
        client.open(str(path))
        client.set_time("time", duration=1.5, play_state="paused")
        assert_shows_something(screenshot(client))
        assert [entry for entry in client.get_logs() if entry.level.upper() == "ERROR"] == []


def test_no_error_is_logged(run: ViewerClient, overview: ViewerClient) -> None:
    for client in (run, overview):
        assert [entry for entry in client.get_logs() if entry.level.upper() == "ERROR"] == []
