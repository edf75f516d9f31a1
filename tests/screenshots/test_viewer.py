"""Rerun's own viewer, without a screen, shows the recordings: nothing blank, no error, each recording its own."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from rerun.experimental import ViewerClient

from pipeline.runtime.errors import InputError
from pipeline.viewer.overview import write_overview
from pipeline.viewer.picture import draw, select, settled, viewer
from pipeline.viewer.run import write_run
from pipeline.viewer.scene import INVALID, START, TIMELINES, VALID
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


def test_no_error_is_logged(run: ViewerClient, overview: ViewerClient) -> None:
    for client in (run, overview):
        assert [entry for entry in client.get_logs() if entry.level.upper() == "ERROR"] == []


def test_a_tab_that_is_not_there_is_refused(run: ViewerClient) -> None:
    with pytest.raises(InputError, match="no tab 99: expected a number from 0 to 6"):
        select(run, 99, "repair_step", 0)


def test_without_a_driver_the_error_is_one_line_that_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The viewer answers before it loads a driver, and has stopped by the time it should open a file."""
    for variable in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(variable, str(tmp_path / "nothing.json"))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    write_run(tmp_path / "run.rrd", a_run())
    with (
        pytest.raises(InputError, match=r"^no Vulkan driver: .*mesa-vulkan-drivers\)$"),
        viewer() as client,
    ):
        client.open(str(tmp_path / "run.rrd"))


def test_an_image_file_is_drawn_of_a_recording(tmp_path: Path) -> None:
    write_run(tmp_path / "run.rrd", a_run())
    draw(tmp_path / "run.rrd", tmp_path / "run.png", REPAIRS, "repair_step", STEPS)
    image = cv2.imread(str(tmp_path / "run.png"))
    assert image is not None
    assert_shows_something(image)
    with pytest.raises(InputError, match="there is no folder"):
        draw(tmp_path / "run.rrd", tmp_path / "none" / "run.png", REPAIRS, "repair_step", STEPS)
