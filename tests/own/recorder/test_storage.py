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
    DETOUR,
    GOAL,
    HEIGHT,
    START,
    WIDTH,
    make_folder,
    picture,
    pixels,
    samples,
)

PNG = cv2.imencode(".png", picture())[1].tobytes()


@pytest.fixture
def recordings(tmp_path: Path) -> Recordings:
    return Recordings(make_folder(tmp_path))


def stored(recordings: Recordings, name: str = "demonstrations.csv") -> pd.DataFrame:
    return pd.read_csv(recordings.folder / name, dtype={"user": str, "demo": str})


def draw(recordings: Recordings, valid: bool = True, scene: str = "first", user: str = "Zoë", places=DETOUR) -> dict:
    return recordings.add_path(scene, user, valid, samples(places).tolist())


def outline(recordings: Recordings, kind: str, *places: tuple[float, float], scene: str = "first") -> None:
    recordings.add_item(scene, kind, pixels(list(places)).tolist())


def test_the_report_reads_what_the_recorder_wrote(tmp_path: Path):
    recordings = Recordings(make_folder(tmp_path, ("a", "b", "c", "d")))
    for scene in "abcd":
        for valid in (True, False):
            draw(recordings, valid, scene)
    outline(recordings, "bowl", (0.4, 0.5), (0.47, 0.5), scene="a")
    folder, faults = read_folder(recordings.folder)
    assert faults == [] and folder is not None and len(folder.demos) == 8
    assert folder.items is not None and folder.items["radius_m"].tolist() == pytest.approx([0.07], abs=1e-3)


@pytest.mark.parametrize(
    ("places", "sentence"),
    [
        ([START, (0.8, 0.8)], "ends 17 cm from the goal"),
        ([(0.2, 0.08), GOAL], "begins 12 cm from the start"),
        ([START, (-0.7, 0.5), GOAL], "far off the table"),
    ],
)
def test_a_path_that_leads_elsewhere_is_refused_and_nothing_is_written(recordings: Recordings, places, sentence):
    with pytest.raises(InputError, match=sentence):
        draw(recordings, places=places)
    assert not (recordings.folder / "demonstrations.csv").exists()


def test_a_path_that_is_sent_again_is_stored_once(recordings: Recordings):
    assert draw(recordings) == draw(recordings)
    assert stored(recordings)["demo"].nunique() == 1


def test_rows_and_columns_that_a_person_wrote_stay(recordings: Recordings):
    file = recordings.folder / "demonstrations.csv"
    file.write_text("z,scene,user,demo,t,x,y,valid\n.1,first,robot,run A,0,.08,.08,true\n")
    draw(recordings, False, "second")
    lines = file.read_text().splitlines()
    assert lines[:2] == ["z,scene,user,demo,t,x,y,valid", ".1,first,robot,run A,0,.08,.08,true"]
    assert lines[2].startswith(",second,Zoë,1,0.000,0.0800,0.0800,false")


def test_threads_that_store_at_once_lose_nothing(recordings: Recordings):
    paths = [[START, (0.3, 0.3 + 0.01 * i), GOAL] for i in range(24)]
    with ThreadPoolExecutor(8) as pool:
        done = list(pool.map(lambda places: draw(recordings, places=places)["demo"], paths))
    assert sorted(map(int, done)) == list(range(1, 25))
    assert stored(recordings).groupby("demo").size().tolist() == [40] * 24


def test_undo_removes_the_path_that_was_seen_and_no_other_of_its_name(recordings: Recordings):
    seen = draw(recordings)
    recordings.remove("path", seen["id"])
    assert draw(recordings, False)["demo"] == seen["demo"]
    with pytest.raises(InputError, match="removed already"):
        recordings.remove("path", seen["id"])
    assert not stored(recordings)["valid"].any()


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "@a", "  ", "a\x07b", "x" * 61])
def test_names_that_a_spreadsheet_would_run_are_refused(recordings: Recordings, name: str):
    with pytest.raises(InputError):
        draw(recordings, user=name)


def test_a_round_and_a_long_item_become_capsules(recordings: Recordings):
    outline(recordings, "plate", (0.4, 0.5), (0.4, 0.62))
    outline(recordings, "fork", (0.5, 0.2), (0.7, 0.4), (0.6, 0.3 + 0.02 * math.sqrt(2)))
    plate, fork = stored(recordings, "items.csv").to_dict("records")
    assert plate["radius_m"] == pytest.approx(0.12, abs=1e-3) and plate["half_length_m"] == 0
    assert fork["angle_deg"] == pytest.approx(45, abs=0.5)
    assert fork["radius_m"] == pytest.approx(0.02, abs=1e-3)
    assert fork["half_length_m"] == pytest.approx(math.hypot(0.1, 0.1) - 0.02, abs=1e-3)
    recordings.remove("item", recordings.scene("first")["items"][0]["id"])
    assert stored(recordings, "items.csv")["kind"].tolist() == ["fork"]


def test_corners_that_cross_are_refused_and_table_yaml_stays(recordings: Recordings):
    before = (recordings.folder / "table.yaml").read_text()
    crossed = [[float(v) for v in CORNERS[i]] for i in (0, 2, 1, 3)]
    with pytest.raises(InputError, match="convex"):
        recordings.place_table("first", True, crossed, 1.0, list(START), list(GOAL))
    assert (recordings.folder / "table.yaml").read_text() == before


def test_corners_of_one_picture_leave_those_of_the_others(recordings: Recordings):
    moved = (np.array(CORNERS) + 5.0).tolist()
    recordings.place_table("second", False, moved, 0.8, [0.1, 0.1], [0.7, 0.7])
    content = yaml.safe_load((recordings.folder / "table.yaml").read_text())
    assert content["corners"] == {"first": CORNERS, "second": moved}
    assert content["side_m"] == 0.8 and content["goal"] == [0.7, 0.7]


def test_a_camera_that_is_turned_upright_by_exif_gives_the_size_as_shown(recordings: Recordings):
    jpeg = cv2.imencode(".jpg", picture())[1].tobytes()
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    scene = recordings.import_picture("turned.jpeg", turned)
    assert recordings.picture_size(scene) == (HEIGHT, WIDTH)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.png", b"no picture", "cannot be read"),
        ("a.png", PNG[:900], "truncated"),
        ("a.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\1\0\0\0\1\0\0\x08\x02\0\0\0", "megapixels"),
        ("first.png", PNG, "already"),
        ("..", b"", "no letter"),
    ],
)
def test_a_file_that_is_no_new_picture_leaves_no_trace(recordings: Recordings, name, content, sentence):
    before = sorted(recordings.folder.rglob("*"))
    with pytest.raises(InputError, match=sentence):
        recordings.import_picture(name, content)
    assert sorted(recordings.folder.rglob("*")) == before


def test_an_imported_picture_stays_in_the_folder_whatever_its_name(recordings: Recordings):
    assert recordings.import_picture("../../Küche <b>.png", PNG) == "Küche_b"
    assert (recordings.folder / "scenes" / "Küche_b.png").read_bytes() == PNG


@pytest.mark.parametrize("name", ["demonstrations.csv", "items.csv", "table.yaml", "scenes/third.png"])
def test_a_link_out_of_the_folder_is_refused(tmp_path: Path, name: str):
    folder = make_folder(tmp_path)
    (tmp_path / "outside").write_text("")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(tmp_path / "outside")
    with pytest.raises(InputError, match="link out of the folder"):
        Recordings(folder)
