"""Interventions and learning, read back with Rerun's own reader, are what the run was given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.viewer.contents import Run
from pipeline.viewer.digest import digest
from pipeline.viewer.geometry import changed, footprints, on_table, percent
from pipeline.viewer.run import write_run
from pipeline.viewer.scene import TIMELINES
from tests.viewer.example import a_run, read, read_images, read_maps, read_timed


@pytest.fixture(scope="module")
def run() -> Run:
    return a_run()


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / f"{run.name}.rrd"
    write_run(path, run)
    return path


def over(image: np.ndarray, other: np.ndarray) -> np.ndarray:
    """`image` under `other`, which has a fourth channel."""
    return np.where(other[..., 3:] == 255, other[..., :3], image)


def test_what_changed_over_an_image_is_the_other_one() -> None:
    rng = np.random.default_rng(0)
    image, other = rng.integers(0, 2, (2, 100, 100, 3), dtype=np.uint8)
    layer = changed(image, other)
    assert np.array_equal(over(image, layer), other)
    assert set(np.unique(layer[..., 3])) == {0, 255}
    assert not changed(image, image).any()


def test_hundredths_go_from_minus_one_to_one() -> None:
    assert percent(np.array([[-1.0, -0.004, 0.0, 0.006, 1.0]])).tolist() == [[0, 100, 100, 101, 200]]


def test_tables_with_an_added_item_are_exact_and_outline_it(run: Run, recording: Path) -> None:
    (before,) = read_images(recording, "interventions/table/image")
    layers = read_images(recording, "interventions/table/changed", "intervention")
    outlines = read(recording, "interventions/table/added", "LineStrips2D:strips", "intervention")
    assert np.array_equal(before, run.repairs[0].image)
    for done, layer, (outline,) in zip(run.interventions, layers, outlines, strict=True):
        assert np.array_equal(over(before, layer), done.image)
        assert np.allclose(outline, on_table(footprints(done.layout)[-1][1]), atol=1e-4)


def test_maps_after_and_effects_are_exact(run: Run, recording: Path) -> None:
    before = run.repairs[0]
    predicted = np.stack([done.predicted for done in run.interventions])
    truth = np.stack([done.truth for done in run.interventions])

    def maps(name: str, dtype: type) -> np.ndarray:
        return read_maps(recording, f"interventions/{name}/map", dtype, timeline="intervention")

    assert np.array_equal(maps("predicted", np.float16), predicted.astype(np.float16))
    assert np.array_equal(maps("truth", np.float16), truth)
    assert np.array_equal(maps("learned_effect", np.uint8), percent(predicted - before.predicted))
    assert np.array_equal(maps("true_effect", np.uint8), percent(truth - before.truth.astype(float)))


@pytest.mark.parametrize(("way", "timeline"), [("by_n", "demonstrations"), ("by_step", "train_step")])
def test_maps_during_learning_lie_at_their_n_or_step(run: Run, recording: Path, way: str, timeline: str) -> None:
    latent, truth, maps = "new_items/scene_000/latent", run.repairs[0].truth, getattr(run.learning, way)
    predicted = read_maps(recording, f"{latent}/predicted/learning/map", np.float16, timeline=timeline)
    difference = read_maps(recording, f"{latent}/difference/learning/map", np.uint8, timeline=timeline)
    expected = np.stack(list(maps.values()))
    assert np.array_equal(predicted, expected.astype(np.float16))
    assert np.array_equal(difference, percent(expected - truth))
    rows = read_timed(recording, f"{latent}/predicted/learning/map", "Image:buffer", timeline)
    assert [time for time, _ in rows] == list(maps)


def test_other_time_lines_show_the_map_of_the_most_demonstrations(run: Run, recording: Path) -> None:
    for timeline in TIMELINES.keys() - {"demonstrations", "train_step"}:
        shown = read_maps(recording, "new_items/scene_000/latent/predicted/learning/map", np.float16, timeline=timeline)
        assert np.array_equal(shown[-1], run.learning.by_n[9].astype(np.float16))


def test_losses_lie_at_their_step(run: Run, recording: Path) -> None:
    rows = read_timed(recording, "losses", "Scalars:scalars")
    assert [step for step, _ in rows] == run.learning.step.tolist()
    assert np.array_equal(np.array([row for _, row in rows]).T, np.stack(list(run.learning.losses.values())))
    assert read(recording, "losses", "SeriesLines:names") == [list(run.learning.losses)]


def test_every_time_line_shows_the_last_state_of_the_others(run: Run, recording: Path) -> None:
    chunks = RrdReader(recording).stream().to_chunks()
    assert {name for chunk in chunks for name in chunk.timeline_names} == set(TIMELINES)
    for timeline, first in TIMELINES.items():
        rows = read_timed(recording, "interventions/effects", "TextDocument:text", timeline)
        assert len(rows) == len(run.interventions)
        assert timeline == "intervention" or {time for time, _ in rows} == {first}


@pytest.mark.parametrize("part", ["interventions", "learning"])
def test_the_digest_changes_with_any_part(run: Run, recording: Path, tmp_path: Path, part: str) -> None:
    others = {
        "interventions": (*run.interventions[:-1], replace(run.interventions[-1], learned_mean=0.0)),
        "learning": replace(run.learning, by_step={k: m[::-1] for k, m in run.learning.by_step.items()}),
    }
    write_run(tmp_path / "other.rrd", replace(run, **{part: others[part]}))
    assert digest(tmp_path / "other.rrd") != digest(recording)
