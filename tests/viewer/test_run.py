"""What a run's recording holds, read back with Rerun's own reader, is what it was given."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.viewer.contents import ACCEPTED, FALSELY_INVALID, FALSELY_VALID, REJECTED, Run
from pipeline.viewer.demonstrations import EVERY, POINTS
from pipeline.viewer.digest import digest
from pipeline.viewer.geometry import boundary, footprints, on_map, on_table
from pipeline.viewer.run import write_run
from pipeline.viewer.scene import INVALID, OUTCOME, TIMELINES, VALID, classes, effect_classes, p_classes
from pipeline.world.bezier import P_F, P_INIT, curve
from tests.viewer.example import MARGINS, SIDE, STEPS, a_run, read, read_images, read_maps, read_timed

pytestmark = pytest.mark.slow
TABS = ("repairs", "interventions", "learning", "training")


@pytest.fixture(scope="module")
def run() -> Run:
    return a_run()


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / f"{run.name}.rrd"
    write_run(path, run)
    return path


def text(path: Path, entity: str) -> str:
    ((words,),) = read(path, entity, "TextDocument:text")
    return words


def test_every_class_of_a_map_is_named_by_its_value() -> None:
    label = {number: name for number, name, _ in classes()}
    values = np.array([[0.0, 0.124, 1.0]])
    assert [label[i] for i in p_classes(values)[0]] == ["0.00", "0.12", "1.00"]
    assert [label[i] for i in effect_classes(values - 0.5)[0]] == ["-0.50", "-0.38", "+0.50"]
    colour = {name: rgb for _, name, rgb in classes()}
    assert colour["invalid, called valid"] == INVALID == (0xD5, 0x5E, 0x00)
    assert colour["valid, called invalid"] == VALID == (0x00, 0x72, 0xB2)
    assert (colour["-1.00"], colour["+1.00"]) == (INVALID, VALID)  # effects have the colours of paths
    assert sorted(label) == list(range(206))  # one byte each


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


def test_a_table_is_the_scene_with_start_goal_and_items_named(run: Run, recording: Path) -> None:
    (image,) = read_images(recording, "table/scene_000/image")
    assert np.abs(image.astype(int) - run.repairs[0].image).mean() < 8  # noise is the hardest image for a JPEG
    (outlines,) = read(recording, "table/scene_000/outlines", "LineStrips2D:strips")
    for line, (_, outline) in zip(outlines, footprints(run.repairs[0].layout), strict=False):  # margins follow
        assert np.allclose(line, on_table(outline), atol=1e-4)
    assert len(outlines) == 4  # two items, and their margins
    assert read(recording, "table/scene_000/names", "Points2D:labels") == [["start", "goal", "bowl", "cutlery"]]
    (marks,) = read(recording, "table/scene_000/names", "Points2D:positions")
    assert np.allclose(marks[:2], on_table(np.stack([P_INIT, P_F])))


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
    discs, crosses = 0, 0
    for shown in run.repairs:
        scene = f"table/scene_{shown.scene:03d}"
        discs += sum(map(len, read(recording, f"{scene}/valid", "Points2D:positions")))
        crosses += sum(map(len, read(recording, f"{scene}/invalid", "LineStrips2D:strips")))
    assert discs == sum(shown.ends_valid.sum() for shown in run.repairs) and crosses > 0
    accepted = sum(((shown.p[:, -1] > 0.5) & ~shown.ends_valid).sum() for shown in run.repairs)
    words = text(recording, "text/repairs")
    assert f"**{discs} of {discs + crosses}** repairs" in words and f"accepts {accepted} that do not" in words


def test_interventions_are_the_runs_and_name_question_and_user(run: Run, recording: Path) -> None:
    before, done = run.repairs[0], run.interventions
    expected = {
        "predicted": p_classes(np.stack([x.predicted for x in done])),
        "truth": p_classes(np.stack([x.truth for x in done])),
        "learned_effect": effect_classes(np.stack([x.predicted - before.predicted for x in done])),
        "true_effect": effect_classes(np.stack([x.truth - before.truth.astype(float) for x in done])),
    }
    for name, values in expected.items():
        assert np.array_equal(read_maps(recording, f"interventions/{name}", timeline="intervention"), values)
    outlines = read(recording, "interventions/table/added", "LineStrips2D:strips", "intervention")
    pages = read(recording, "interventions/effects", "TextDocument:text", "intervention")
    for x, (outline,), (page,) in zip(done, outlines, pages, strict=True):
        assert np.allclose(outline, on_table(footprints(x.layout)[-1][1]), atol=1e-4)
        assert f"`add_{x.symbol}`, careful user" in page
        assert f"| **{x.symbol}** | {x.learned_mean:+.3f} | {x.true_mean:+.3f} |" in page


@pytest.mark.parametrize(("way", "timeline"), [("by_n", "demonstrations"), ("by_step", "train_step")])
def test_maps_during_learning_lie_at_their_n_or_step(run: Run, recording: Path, way: str, timeline: str) -> None:
    maps = getattr(run.learning, way)
    expected = np.stack(list(maps.values()))
    assert np.array_equal(read_maps(recording, "predicted/learning", timeline=timeline), p_classes(expected))
    right = read_maps(recording, "outcomes/learning", timeline=timeline) <= OUTCOME + ACCEPTED
    assert np.array_equal(right, (expected > 0.5) == run.repairs[0].truth)
    rows = read_timed(recording, "predicted/learning/map", "SegmentationImage:buffer", timeline)
    assert [time for time, _ in rows] == list(maps)


def test_losses_lie_at_their_step(run: Run, recording: Path) -> None:
    rows = read_timed(recording, "losses", "Scalars:scalars")
    assert [step for step, _ in rows] == run.learning.step.tolist()
    assert np.array_equal(np.array([row for _, row in rows]).T, np.stack(list(run.learning.losses.values())))
    assert read(recording, "losses", "SeriesLines:names") == [list(run.learning.losses)]


def test_no_tab_is_empty_on_another_tab_s_time_line(run: Run, recording: Path) -> None:
    for timeline, first in TIMELINES.items():
        rows = read_timed(recording, "interventions/effects", "TextDocument:text", timeline)
        assert len(rows) == len(run.interventions)
        assert timeline == "intervention" or {time for time, _ in rows} == {first}
        if timeline not in ("demonstrations", "train_step"):
            shown = read_maps(recording, "predicted/learning", timeline=timeline)[-1]
            assert np.array_equal(shown, p_classes(run.learning.by_n[9]))


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


def test_a_tab_s_text_has_at_most_120_words_and_names_model_user_and_seed(recording: Path) -> None:
    for tab in TABS:
        words = text(recording, f"text/{tab}")
        assert len(words.split()) <= 120
        assert "Paper’s model, careful user, seed 3" in words


def test_a_recording_carries_its_parameters_and_its_data_version(run: Run, recording: Path) -> None:
    words = text(recording, "about")
    sources = (run.variant, run.user, run.seed, run.n_demos, run.profile, run.data, run.root_seed, run.parameters)
    for value in (run.name, *sources, "bowl 4.5 cm", f"pipeline.viewer.review {run.name} --check"):
        assert str(value) in words
    assert "glass" not in words  # this user has no margin for it


def test_a_user_without_margins_has_no_repairs(tmp_path: Path) -> None:
    whole = a_run(repairs=0)
    repairs = tuple(replace(r, truth=np.ones_like(r.truth)) for r in whole.repairs)
    path = tmp_path / "aggressive.rrd"
    write_run(path, replace(whole, user="aggressive", margins=dict.fromkeys(MARGINS), repairs=repairs))
    assert "nothing to repair" in text(path, "text/repairs") and "keeps clear of nothing" in text(path, "about")
    assert not read(path, "table/scene_000/paths", "LineStrips2D:strips")


def test_rerun_verifies_the_file_with_its_blueprint(run: Run, recording: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)]
    assert subprocess.run(command, capture_output=True).returncode == 0
    reader = RrdReader(recording)
    assert [entry.recording_id for entry in reader.recordings()] == [run.name]
    assert len(reader.blueprints()) == 1


def test_the_digest_is_of_the_contents(run: Run, recording: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.rrd"
    write_run(again, run)
    assert digest(again) == digest(recording)
    assert again.read_bytes() != recording.read_bytes()  # why bytes cannot be compared


def test_the_digest_changes_with_any_part(run: Run, recording: Path, tmp_path: Path) -> None:
    *others, last = run.repairs
    parts = {
        "p": np.nextafter(last.p, np.float32(2)),
        "truth": ~last.truth,
        "ends_valid": ~last.ends_valid,
        "start": (),
    }
    changes = [{"repairs": (*others, replace(last, **{name: value}))} for name, value in parts.items()]
    changes += [{"learning": replace(run.learning, by_step={0: last.predicted})}, {"demonstrations": ()}, {"seed": 4}]
    for changed in changes:
        write_run(tmp_path / "other.rrd", replace(run, **changed))
        assert digest(tmp_path / "other.rrd") != digest(recording), changed.keys()
