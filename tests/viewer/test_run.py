"""What a recording holds, read back with Rerun's own reader, is what it was given."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.viewer.contents import Run
from pipeline.viewer.demonstrations import POINTS
from pipeline.viewer.digest import digest
from pipeline.viewer.geometry import boundary, footprints, on_map, on_table
from pipeline.viewer.run import write_run
from pipeline.world.bezier import curve
from tests.viewer.example import MARGINS, SIDE, STEPS, a_run, read, read_images, read_maps


@pytest.fixture(scope="module")
def run() -> Run:
    return a_run()


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / f"{run.name}.rrd"
    write_run(path, run)
    return path


def test_images_are_the_scenes(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        (image,) = read_images(recording, f"new_items/scene_{shown.scene:03d}/table/image")
        assert np.array_equal(image, shown.image)
    for shown in run.demonstrations:
        (image,) = read_images(recording, f"training/scene_{shown.scene:03d}/image")
        assert np.array_equal(image, shown.image)


def test_latent_maps_are_exact_with_the_largest_y_on_top(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        for name, values in (("predicted", shown.predicted), ("truth", shown.truth)):
            entity = f"new_items/scene_{shown.scene:03d}/latent/{name}/map"
            assert np.array_equal(read_maps(recording, entity, np.float32), values[None].astype(np.float32))


def test_every_path_of_every_repair_is_there_at_its_step(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        entity = f"new_items/scene_{shown.scene:03d}/table/repair"
        rows = np.array(read(recording, f"{entity}/path", "LineStrips2D:strips"))
        assert rows.shape == (STEPS + 1, len(shown.start), POINTS, 2)
        assert np.allclose(rows.swapaxes(0, 1), on_table(curve(shown.z, POINTS)), atol=1e-4)
        (first,) = read(recording, f"{entity}/first", "LineStrips2D:strips")
        assert np.allclose(first, rows[0])


def test_z_theta_is_there_at_its_step_in_both_maps(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        for name in ("predicted", "truth"):
            entity = f"new_items/scene_{shown.scene:03d}/latent/{name}/repair"
            rows = np.array(read(recording, f"{entity}/z_theta", "Points2D:positions"))
            assert np.allclose(rows.swapaxes(0, 1), on_map(shown.z, SIDE), atol=1e-4)
            (trail,) = read(recording, f"{entity}/trail", "LineStrips2D:strips")
            assert np.allclose(trail, on_map(shown.z, SIDE), atol=1e-4)


def test_p_valid_is_a_series_over_the_steps(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        entity = f"new_items/scene_{shown.scene:03d}/p_valid/repairs"
        assert np.array_equal(np.array(read(recording, entity, "Scalars:scalars")).T, shown.p.astype(float))
        (names,) = read(recording, entity, "SeriesLines:names")
        assert names == [f"start {start}" for start in shown.start]


def test_true_slack_is_a_series_over_the_steps_in_centimetres(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        entity = f"new_items/scene_{shown.scene:03d}/slack/repairs"
        slack = np.array(read(recording, entity, "Scalars:scalars")).T
        assert np.array_equal(slack, 100 * shown.slack)
        assert np.array_equal(slack[:, -1] > 0, shown.ends_valid)


def test_differences_are_kept_to_a_hundredth_under_names_that_say_so(run: Run, recording: Path) -> None:
    ((context,),) = read(recording, "", "AnnotationContext:context")
    value = {entry["class_id"]: float(entry["class_description"]["info"]["label"]) for entry in context}
    for shown in run.repairs:
        (classes,) = read_maps(recording, f"new_items/scene_{shown.scene:03d}/latent/difference/map", np.uint8)
        assert np.abs(np.vectorize(value.get)(classes) - (shown.predicted - shown.truth)).max() <= 0.005 + 1e-6


def test_verdicts_come_with_the_last_step_as_discs_or_crosses(run: Run, recording: Path) -> None:
    for shown in run.repairs:
        entity = f"new_items/scene_{shown.scene:03d}/table/repair"
        good = read(recording, f"{entity}/ends_valid", "Points2D:positions")
        bad = read(recording, f"{entity}/ends_invalid", "LineStrips2D:strips")
        assert sum(map(len, good)) == shown.ends_valid.sum()
        assert sum(map(len, bad)) == (~shown.ends_valid).sum()
        labels = read(recording, f"{entity}/ends_invalid", "LineStrips2D:labels")
        assert [label for row in labels for label in row] == ["still invalid"] * (~shown.ends_valid).sum()


def test_valid_and_invalid_demonstrations_differ_in_entity_thickness_and_mark(run: Run, recording: Path) -> None:
    for shown in run.demonstrations:
        entity, thickness = f"training/scene_{shown.scene:03d}", {}
        assert 0 < shown.valid.sum() < len(shown.valid)
        for verdict, name in ((True, "valid"), (False, "invalid")):
            chosen = np.flatnonzero(shown.valid == verdict)
            (raw,) = read(recording, f"{entity}/{name}/recorded", "LineStrips2D:strips")
            for line, i in zip(raw, chosen, strict=True):
                assert np.allclose(line, on_table(shown.samples[i][:, 1:3]), atol=1e-4)
            (fitted,) = read(recording, f"{entity}/{name}/fitted", "LineStrips2D:strips")
            assert np.allclose(fitted, on_table(curve(shown.z[chosen], POINTS)), atol=1e-4)
            (thickness[name],) = read(recording, f"{entity}/{name}/fitted", "LineStrips2D:radii")
        assert thickness["valid"] > thickness["invalid"]
        assert read(recording, f"{entity}/valid/marks", "Points2D:positions")
        assert read(recording, f"{entity}/invalid/marks", "LineStrips2D:strips")


def test_footprints_are_outlined_and_named(run: Run, recording: Path) -> None:
    entity = "new_items/scene_000/table"
    (strips,) = read(recording, f"{entity}/items", "LineStrips2D:strips")
    for line, (_, outline) in zip(strips, footprints(run.repairs[0].layout), strict=True):
        assert np.allclose(line, on_table(outline), atol=1e-4)
    assert read(recording, f"{entity}/items", "LineStrips2D:labels") == [["bowl", "cutlery"]]
    (edges,) = read(recording, "new_items/scene_000/latent/predicted/boundary", "LineStrips2D:strips")
    assert np.array_equal(edges, boundary(run.repairs[0].truth))


def text(path: Path, entity: str) -> str:
    ((words,),) = read(path, entity, "TextDocument:text")
    return words


def test_a_recording_says_what_it_was_made_from(run: Run, recording: Path) -> None:
    words = text(recording, "about")
    for value in (run.name, run.variant, run.user, str(run.seed), str(run.n_demos), run.profile, run.data):
        assert value in words
    assert "bowl 4.5 cm" in words and "glass" not in words


def test_a_user_without_margins_has_no_repairs(tmp_path: Path) -> None:
    whole = a_run(repairs=0)
    repairs = tuple(replace(r, truth=np.ones_like(r.truth)) for r in whole.repairs)
    path = tmp_path / "aggressive.rrd"
    write_run(path, replace(whole, user="aggressive", margins=dict.fromkeys(MARGINS), repairs=repairs))
    assert "nothing to repair" in text(path, "text/repairs") and "keeps clear of nothing" in text(path, "about")
    assert not read(path, "new_items/scene_000/table/repair/path", "LineStrips2D:strips")


def test_rerun_verifies_the_file_and_it_is_below_a_megabyte(recording: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)]
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert recording.stat().st_size <= 1_000_000


def test_a_blueprint_is_saved_inside(recording: Path) -> None:
    reader = RrdReader(recording)
    assert [entry.recording_id for entry in reader.recordings()] == ["full-careful-s3"]
    assert len(reader.blueprints()) == 1


def test_the_digest_is_of_the_contents(run: Run, recording: Path, tmp_path: Path) -> None:
    again = tmp_path / "elsewhere.rrd"
    write_run(again, run)
    assert digest(again) == digest(recording)
    assert again.read_bytes() != recording.read_bytes()  # why bytes cannot be compared


def nudge(values: np.ndarray) -> np.ndarray:
    """The same values but for the last one, by the least there is."""
    nudged = values.copy()
    nudged.flat[-1] = np.nextafter(nudged.flat[-1], values.dtype.type(2))
    return nudged


@pytest.mark.parametrize("field", ["p", "slack", "predicted", "image", "truth", "ends_valid"])
def test_the_digest_changes_with_any_value(run: Run, recording: Path, tmp_path: Path, field: str) -> None:
    last = run.repairs[-1]
    values = getattr(last, field)
    if values.dtype.kind == "f":
        other = nudge(values)
    else:
        other = values.copy()
        other.flat[-1] = not values.flat[-1] if values.dtype == bool else values.flat[-1] ^ 1
    path = tmp_path / "other.rrd"
    write_run(path, replace(run, repairs=(*run.repairs[:-1], replace(last, **{field: other}))))
    assert digest(path) != digest(recording)
