"""What a run's recording holds, read back with Rerun's own reader, is what it was given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.viewer.contents import ACCEPTED, FALSELY_INVALID, FALSELY_VALID, REJECTED, Run
from pipeline.viewer.digest import digest
from pipeline.viewer.run import EVERY, POINTS, write_run
from pipeline.viewer.scene import OUTCOME, boundary, on_map, on_table, p_classes
from pipeline.world.bezier import curve
from tests.viewer.example import SIDE, STEPS, a_run, read, read_maps, read_timed

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run() -> Run:
    return a_run()


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / f"{run.name}.rrd"
    write_run(path, run)
    return path


def test_maps_are_the_models_and_the_truth_s_with_the_largest_y_on_top(run: Run, recording: Path) -> None:
    maps = [read_maps(recording, entity, timeline="repair_step") for entity in ("predicted", "outcomes")]
    lines = read(recording, "predicted/lines", "LineStrips2D:strips", "repair_step")
    for shown, predicted, outcomes, drawn in zip(run.repairs, *maps, lines, strict=True):
        accepted, outcomes = shown.predicted > 0.5, outcomes.astype(int) - OUTCOME
        assert np.array_equal(predicted, p_classes(shown.predicted))
        assert np.array_equal(np.isin(outcomes, (ACCEPTED, FALSELY_VALID)), accepted)
        assert np.array_equal(np.isin(outcomes, (ACCEPTED, FALSELY_INVALID)), shown.truth)
        assert shown.agreement == np.isin(outcomes, (ACCEPTED, REJECTED)).mean()
        assert np.array_equal(drawn[: -len(shown.start)], boundary(shown.truth))
        assert np.allclose(drawn[-len(shown.start) :], on_map(shown.z, SIDE), atol=1e-4)


def test_every_repair_is_there_at_its_step_one_worst_scene_after_another(run: Run, recording: Path) -> None:
    paths = dict(read_timed(recording, "table/paths", "LineStrips2D:strips", "repair_step"))
    points = dict(read_timed(recording, "predicted/z_theta", "Points2D:positions", "repair_step"))
    series = {name: dict(read_timed(recording, name, "Scalars:scalars")) for name in ("log_odds", "slack")}
    for rank, shown in enumerate(run.repairs):
        steps = range(run.first_step(rank), run.first_step(rank) + STEPS + 1)
        drawn = np.array([paths[step] for step in steps])
        assert drawn.shape == (STEPS + 1, len(shown.start), POINTS, 2)
        assert np.allclose(drawn.swapaxes(0, 1), on_table(curve(shown.z, POINTS)), atol=1e-4)
        assert np.allclose(np.swapaxes([points[step] for step in steps], 0, 1), on_map(shown.z, SIDE), atol=1e-4)
        log_odds, slack = (np.array([values[step] for step in steps]).T for values in series.values())
        assert np.array_equal(log_odds, shown.log_odds) and np.array_equal(slack, 100 * shown.slack)
        assert np.array_equal(slack[:, -1] > 0, shown.ends_valid)
        assert rank == 0 or np.isnan(series["slack"][steps[0] - 1]).all()


def test_marks_of_one_scene_end_with_it(run: Run, recording: Path) -> None:
    marks = [("valid", "Points2D:positions"), ("invalid", "LineStrips2D:strips")]
    drawn = [dict(read_timed(recording, f"table/{mark}", name, "repair_step")) for mark, name in marks]
    cleared = [dict(read_timed(recording, f"table/{m}", "Clear:is_recursive", "repair_step")) for m, _ in marks]
    for rank, shown in enumerate(run.repairs):
        last = run.first_step(rank) + STEPS
        counts = [len(by_step[last] or ()) if last in by_step else 0 for by_step in drawn]
        assert counts == [shown.ends_valid.sum(), (~shown.ends_valid).sum()]
        assert all(run.first_step(rank) in by_step for by_step in cleared)


def test_a_recording_carries_its_facts_and_its_effects_as_numbers(run: Run, recording: Path) -> None:
    facts = {"variant": "full", "user": "careful", "seed": 3, "n_demos": 9, "data_version": "0123456789ab"}
    for name, value in (facts | dict(run.facts)).items():
        assert read(recording, "__properties/run", name) == [[value]]
    assert read(recording, "__properties/worst", "scene") == [[shown.scene for shown in run.repairs]]
    (last,) = read(recording, "__properties/worst", "step")
    assert last == [run.first_step(rank) + STEPS for rank in range(len(run.repairs))]
    effects = read(recording, "effects/scene", "Scalars:scalars")
    assert effects == [[done.learned, done.true] for done in run.interventions]


def test_demonstrations_are_drawn_as_fitted_and_as_recorded(run: Run, recording: Path) -> None:
    for column, shown in enumerate(run.demonstrations):
        entity, count = f"training/{column}", len(shown.z)
        (lines,) = read(recording, f"{entity}/paths", "LineStrips2D:strips")
        (radii,) = read(recording, f"{entity}/paths", "LineStrips2D:radii")
        assert np.allclose(lines[:count], on_table(curve(shown.z, POINTS)), atol=1e-4)
        for line, samples in zip(lines[count:], shown.samples, strict=True):
            assert np.allclose(line, on_table(samples[::EVERY, 1:3]), atol=1e-4)
        assert min(np.array(radii[:count])[shown.valid]) > max(np.array(radii[:count])[~shown.valid])
        (discs,) = read(recording, f"{entity}/valid", "Points2D:positions")
        (crosses,) = read(recording, f"{entity}/invalid", "LineStrips2D:strips")
        assert (len(discs), len(crosses)) == (shown.valid.sum(), (~shown.valid).sum())


def test_the_digest_changes_with_any_part(run: Run, recording: Path, tmp_path: Path) -> None:
    *others, last = run.repairs
    parts = ({"log_odds": np.nextafter(last.log_odds, 99)}, {"truth": ~last.truth}, {"ends_valid": ~last.ends_valid})
    changes = [{"repairs": (*others, replace(last, **part))} for part in parts]
    changes += [{"learning": replace(run.learning, by_step={0: last.predicted})}, {"demonstrations": ()}, {"seed": 4}]
    for changed in changes:
        write_run(tmp_path / "other.rrd", replace(run, **changed))
        assert digest(tmp_path / "other.rrd") != digest(recording), changed.keys()
