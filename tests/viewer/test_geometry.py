"""The views agree with the world about where items are."""

from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

from pipeline.viewer.scene import boundary, footprints, log_table_edges, map_image, on_map, on_table, recording_at
from pipeline.world.bezier import lattice
from pipeline.world.layout import SYMBOLS, point_segment_distance
from tests.viewer.example import a_layout


def test_pixels_and_cells_lie_where_the_world_says() -> None:
    row, column, side = 30, 12, 7
    point = np.array([(column + 0.5) / 100, 1 - (row + 0.5) / 100])  # of the images, in metres
    assert np.allclose(on_table(point), [column + 0.5, row + 0.5])
    values = np.arange(side * side).reshape(side, side)
    column, row = np.floor(on_map(lattice(side), side)).astype(int).T
    assert np.array_equal(map_image(values)[row, column], values.ravel())
    assert np.allclose(on_map(lattice(side), side) % 1, 0.5)


@pytest.mark.parametrize("variable", ["RERUN=off", "RERUN=0", "_RERUN_TEST_FORCE_SAVE=elsewhere"])
def test_a_recording_is_written_whatever_the_environment_tells_rerun(
    variable: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(*variable.split("="))
    with recording_at(tmp_path / "some.rrd", "some", rrb.Blueprint()) as recording:
        log_table_edges(recording, "some", [(0, 1)])
    assert [path.name for path in tmp_path.iterdir()] == ["some.rrd"]


def test_an_outline_is_closed_and_one_radius_from_the_items_segment() -> None:
    layout = a_layout()
    for slot, (symbol, outline) in enumerate(footprints(layout)):
        a, b = layout.ends[0, slot]
        distance = point_segment_distance(outline, a[None], b[None])
        assert symbol == SYMBOLS[layout.symbol[0, slot]]
        assert np.allclose(distance, layout.radius[0, slot])
        assert np.allclose(outline[0], outline[-1])


def test_the_boundary_runs_between_cells_that_differ() -> None:
    truth = np.zeros((3, 3), dtype=bool)
    truth[0, 2] = True  # least y, largest x: the bottom right cell of the image
    edges = {tuple(map(tuple, edge)) for edge in boundary(truth).tolist()}
    assert edges == {((2, 2), (2, 3)), ((2, 2), (3, 2))}
    assert len(boundary(np.ones((3, 3), dtype=bool))) == 0
