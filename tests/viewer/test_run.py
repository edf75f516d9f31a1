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
from tests.viewer.example import SIDE, STEPS, a_run, read, read_maps

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
    for shown in run.repairs:
        scene, accepted = f"scene_{shown.scene:03d}", shown.predicted > 0.5
        assert np.array_equal(read_maps(recording, f"predicted/{scene}")[0], p_classes(shown.predicted))
        outcomes = read_maps(recording, f"outcomes/{scene}")[0].astype(int) - OUTCOME
        assert np.array_equal(np.isin(outcomes, (ACCEPTED, FALSELY_VALID)), accepted)
        assert np.array_equal(np.isin(outcomes, (ACCEPTED, FALSELY_INVALID)), shown.truth)
        assert shown.agreement == np.isin(outcomes, (ACCEPTED, REJECTED)).mean()
        (lines,) = read(recording, f"predicted/{scene}/lines", "LineStrips2D:strips")
        assert np.array_equal(lines[: -len(shown.start)], boundary(shown.truth))
        assert np.allclose(lines[-len(shown.start) :], on_map(shown.z, SIDE), atol=1e-4)


def test_every_repair_is_there_at_its_step(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        scene = f"scene_{shown.scene:03d}"
        paths = np.array(read(recording, f"table/{scene}/paths", "LineStrips2D:strips"))
        assert paths.shape == (STEPS + 1, len(shown.start), POINTS, 2)
        assert np.allclose(paths.swapaxes(0, 1), on_table(curve(shown.z, POINTS)), atol=1e-4)
        (starts,) = read(recording, f"table/{scene}/starts", "LineStrips2D:strips")
        assert np.allclose(starts, paths[0])
        points = np.array(read(recording, f"predicted/{scene}/z_theta", "Points2D:positions"))
        assert np.allclose(points.swapaxes(0, 1), on_map(shown.z, SIDE), atol=1e-4)
        assert np.array_equal(np.array(read(recording, f"p_valid/{scene}", "Scalars:scalars")).T, shown.p.astype(float))
        slack = np.array(read(recording, f"slack/{scene}", "Scalars:scalars")).T
        assert np.array_equal(slack, 100 * shown.slack)
        assert np.array_equal(slack[:, -1] > 0, shown.ends_valid)


def test_the_text_counts_the_ends_that_are_marked_valid_or_not(run: Run, recording: Path) -> None:
    entities = [f"table/scene_{shown.scene:03d}" for shown in run.repairs]
    discs = sum(len(x) for entity in entities for x in read(recording, f"{entity}/valid", "Points2D:positions"))
    crosses = sum(len(x) for entity in entities for x in read(recording, f"{entity}/invalid", "LineStrips2D:strips"))
    assert discs == sum(shown.ends_valid.sum() for shown in run.repairs) and crosses > 0
    accepted = sum(((shown.p[:, -1] > 0.5) & ~shown.ends_valid).sum() for shown in run.repairs)
    ((words,),) = read(recording, "text/repairs", "TextDocument:text")
    assert f"**{discs} of {discs + crosses}** repairs" in words and f"accepts {accepted} that do not" in words


def test_demonstrations_are_drawn_as_fitted_and_as_recorded(run: Run, recording: Path) -> None:
    for shown in run.demonstrations:
        entity, count = f"training/scene_{shown.scene:03d}", len(shown.z)
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
    parts = ({"p": np.nextafter(last.p, np.float32(2))}, {"truth": ~last.truth}, {"ends_valid": ~last.ends_valid})
    changes = [{"repairs": (*others, replace(last, **part))} for part in parts]
    changes += [{"learning": replace(run.learning, by_step={0: last.predicted})}, {"demonstrations": ()}, {"seed": 4}]
    for changed in changes:
        write_run(tmp_path / "other.rrd", replace(run, **changed))
        assert digest(tmp_path / "other.rrd") != digest(recording), changed.keys()
