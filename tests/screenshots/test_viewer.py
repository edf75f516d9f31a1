"""Rerun's own viewer, without a screen, shows the recordings: nothing blank, no error, each recording its own."""

from collections.abc import Iterator

import numpy as np
import pytest
from rerun.experimental import ViewerClient

from pipeline.viewer.run import TIMELINES, write_overview, write_run
from tests.screenshots.window import select, settled, viewer
from tests.viewer.example import STEPS, a_run, some_runs

REPAIRS = 0  # tab of a run
MIN_SPREAD, MIN_COLOURS = 20.0, 500  # of a screenshot with contents; a blank one has 0 and 1


@pytest.fixture(scope="module")
def clients(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ViewerClient, ViewerClient]]:
    """A viewer with a run's recording open, and one with an overview: the viewer keeps a layout for all it opens."""
    folder = tmp_path_factory.mktemp("recordings")
    write_run(folder / "run.rrd", a_run())
    write_overview(folder / "overview.rrd", some_runs())
    with viewer(folder / "run.rrd") as run, viewer(folder / "overview.rrd") as overview:
        yield run, overview


def screenshot(client: ViewerClient) -> np.ndarray:
    """Return the tab in front, without the text beside it and the viewer's notices, if it shows something, no error."""
    image = settled(client)
    assert not any(view.reports for view in client.get_state().views)
    assert [entry for entry in client.get_logs() if entry.level.upper() == "ERROR"] == []
    image = image[80:-60, : int(0.74 * image.shape[1])]
    assert image.std() > MIN_SPREAD and len(np.unique(image.reshape(-1, 3), axis=0)) > MIN_COLOURS
    return image


def test_a_run_shows_its_scenes_its_repairs_move_and_the_overview_differs(clients) -> None:
    run, overview = clients
    (recording,) = run.get_state().recordings
    assert {timeline.name for timeline in recording.timelines} == set(TIMELINES)
    select(run, REPAIRS, "repair_step", 0)
    first = screenshot(run)
    select(run, REPAIRS, "repair_step", STEPS)
    last = screenshot(run)
    assert (first != last).any(-1).mean() > 0.001
    select(overview, 0, "scene", 1)
    compared = screenshot(overview)
    assert (last != compared).any(-1).mean() > 0.05
