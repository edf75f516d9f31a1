"""What the recorder writes: metres, whole files, nothing that a person did not draw."""

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.own.folder import read_folder
from pipeline.own.recorder.storage import Recordings
from pipeline.runtime.errors import InputError
from tests.own.recorder.factory import (
    CORNERS,
    GOAL,
    HEIGHT,
    START,
    WIDTH,
    make_folder,
    picture,
    pixels,
    samples,
)


@pytest.fixture
def recordings(tmp_path: Path) -> Recordings:
    return Recordings(make_folder(tmp_path))


def stored(recordings: Recordings, name: str = "demonstrations.csv") -> pd.DataFrame:
    return pd.read_csv(recordings.folder / name, dtype={"user": str, "demo": str})


def test_the_report_reads_what_the_recorder_wrote(tmp_path: Path):
    recordings = Recordings(make_folder(tmp_path, ("a", "b", "c", "d")))
    for scene in "abcd":
        for valid in (True, False):
            recordings.add_path(scene, "Zoë", valid, samples())
    recordings.add_item("a", "bowl", pixels([(0.4, 0.5), (0.47, 0.5)]))
    folder, faults = read_folder(recordings.folder)
    assert faults == [] and folder is not None
    assert len(folder.demos) == 8
    assert folder.items is not None and folder.items["radius_m"].tolist() == pytest.approx([0.07], abs=1e-3)


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        ([START, (0.8, 0.8)], "ends 17 cm from the goal"),
        ([(0.2, 0.08), GOAL], "begins 12 cm from the start"),
        ([START, (-0.7, 0.5), GOAL], "far off the table"),
    ],
)
def test_a_path_that_leads_elsewhere_is_refused_and_nothing_is_written(recordings: Recordings, points, sentence):
    with pytest.raises(InputError, match=sentence):
        recordings.add_path("first", "Zoë", True, samples(points))
    assert not (recordings.folder / "demonstrations.csv").exists()


def test_a_path_that_is_sent_again_is_stored_once(recordings: Recordings):
    first = recordings.add_path("first", "Zoë", True, samples())
    assert recordings.add_path("first", "Zoë", True, samples()) == first
    assert stored(recordings)["demo"].nunique() == 1


def test_rows_and_columns_that_a_person_wrote_stay(recordings: Recordings):
    file = recordings.folder / "demonstrations.csv"
    file.write_text("z,scene,user,demo,t,x,y,valid\n.1,first,robot,run A,0,.08,.08,true\n")
    recordings.add_path("second", "Zoë", False, samples())
    lines = file.read_text().splitlines()
    assert lines[:2] == ["z,scene,user,demo,t,x,y,valid", ".1,first,robot,run A,0,.08,.08,true"]
    assert lines[2].startswith(",second,Zoë,1,0.000,0.0800,0.0800,false")


def test_threads_that_store_at_once_lose_nothing(recordings: Recordings):
    paths = [samples([START, (0.3, 0.3 + 0.01 * i), GOAL]) for i in range(24)]
    with ThreadPoolExecutor(8) as pool:
        done = list(pool.map(lambda path: recordings.add_path("first", "Zoë", True, path)["demo"], paths))
    assert sorted(map(int, done)) == list(range(1, 25))
    assert stored(recordings).groupby("demo").size().tolist() == [40] * 24


def test_undo_removes_the_path_that_was_seen_and_no_other_of_its_name(recordings: Recordings):
    seen = recordings.add_path("first", "Zoë", True, samples())
    recordings.remove_path(seen["id"])
    other = recordings.add_path("first", "Zoë", False, samples())
    assert other["demo"] == seen["demo"]
    with pytest.raises(InputError, match="removed already"):
        recordings.remove_path(seen["id"])
    assert not stored(recordings)["valid"].any()


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "@a", "  ", "a\x07b", "x" * 61])
def test_names_that_a_spreadsheet_would_run_are_refused(recordings: Recordings, name: str):
    with pytest.raises(InputError):
        recordings.add_path("first", name, True, samples())


def test_a_round_and_a_long_item_become_capsules(recordings: Recordings):
    recordings.add_item("first", "plate", pixels([(0.4, 0.5), (0.4, 0.62)]))
    recordings.add_item("first", "fork", pixels([(0.5, 0.2), (0.7, 0.4), (0.6, 0.3 + 0.02 * math.sqrt(2))]))
    plate, fork = stored(recordings, "items.csv").to_dict("records")
    assert plate["radius_m"] == pytest.approx(0.12, abs=1e-3) and plate["half_length_m"] == 0
    assert fork["angle_deg"] == pytest.approx(45, abs=0.5)
    assert fork["radius_m"] == pytest.approx(0.02, abs=1e-3)
    assert fork["half_length_m"] == pytest.approx(math.hypot(0.1, 0.1) - 0.02, abs=1e-3)
    recordings.remove_item(recordings.scene("first")["items"][0]["id"])
    assert stored(recordings, "items.csv")["kind"].tolist() == ["fork"]


def test_corners_that_cross_are_refused_and_table_yaml_stays(recordings: Recordings):
    before = (recordings.folder / "table.yaml").read_text()
    crossed = np.array([CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]], float)
    with pytest.raises(InputError, match="convex"):
        recordings.place_table("first", True, crossed, 1.0, START, GOAL)
    assert (recordings.folder / "table.yaml").read_text() == before


def test_corners_of_one_picture_leave_those_of_the_others(recordings: Recordings):
    moved = np.array(CORNERS, float) + 5
    recordings.place_table("second", False, moved, 0.8, (0.1, 0.1), (0.7, 0.7))
    content = yaml.safe_load((recordings.folder / "table.yaml").read_text())
    assert content["corners"] == {"first": CORNERS, "second": moved.tolist()}
    assert content["side_m"] == 0.8 and content["goal"] == [0.7, 0.7]


def test_a_camera_that_is_turned_upright_by_exif_gives_the_size_as_shown(recordings: Recordings):
    _, jpeg = cv2.imencode(".jpg", picture())
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    turned = jpeg.tobytes()[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg.tobytes()[2:]
    scene = recordings.import_picture("turned.jpeg", turned)
    assert recordings._size(scene) == (HEIGHT, WIDTH)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.png", b"no picture", "cannot be read"),
        ("a.png", cv2.imencode(".png", picture())[1].tobytes()[:900], "truncated"),
        ("a.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\1\0\0\0\1\0\0\x08\x02\0\0\0", "megapixels"),
        ("first.png", cv2.imencode(".png", picture())[1].tobytes(), "already"),
        ("..", b"", "no letter"),
    ],
)
def test_a_file_that_is_no_new_picture_leaves_no_trace(recordings: Recordings, name, content, sentence):
    before = sorted(recordings.folder.rglob("*"))
    with pytest.raises(InputError, match=sentence):
        recordings.import_picture(name, content)
    assert sorted(recordings.folder.rglob("*")) == before


def test_an_imported_picture_stays_in_the_folder_whatever_its_name(recordings: Recordings):
    content = cv2.imencode(".png", picture())[1].tobytes()
    assert recordings.import_picture("../../Küche <b>.png", content) == "Küche_b"
    assert (recordings.folder / "scenes" / "Küche_b.png").read_bytes() == content


@pytest.mark.parametrize("name", ["demonstrations.csv", "items.csv", "table.yaml", "scenes/third.png"])
def test_a_link_out_of_the_folder_is_refused(tmp_path: Path, name: str):
    folder = make_folder(tmp_path)
    (tmp_path / "outside").write_text("")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(tmp_path / "outside")
    with pytest.raises(InputError, match="link out of the folder"):
        Recordings(folder)
