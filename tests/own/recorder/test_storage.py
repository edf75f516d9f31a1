"""What the recorder writes: metres, whole files, nothing that a person did not draw."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.own import files
from pipeline.own.recorder.storage import Recordings
from pipeline.runtime.errors import InputError
from tests.own.folders import whole
from tests.own.recorder.factory import CORNERS, DETOUR, GOAL, HEIGHT, START, WIDTH, make_folder, picture, samples


@pytest.fixture
def recordings(tmp_path: Path) -> Recordings:
    return Recordings(make_folder(tmp_path))


def stored(recordings: Recordings) -> pd.DataFrame:
    return pd.read_csv(recordings.folder / "demonstrations.csv", dtype={"user": str, "demo": str})


def draw(recordings: Recordings, valid: bool = True, scene: str = "first", user: str = "Zoë", places=DETOUR) -> dict:
    return recordings.add_path(scene, user, valid, samples(places).tolist())


def test_the_report_reads_what_the_recorder_wrote(tmp_path: Path):
    recordings = Recordings(make_folder(tmp_path, ("a", "b", "c", "d")))
    for scene in "abcd":
        for valid in (True, False):
            draw(recordings, valid, scene)
    assert len(whole(recordings.folder).demos) == 8


@pytest.mark.parametrize(
    ("places", "user", "sentence"),
    [
        ([START, (-0.7, 0.5), GOAL], "Zoë", "far off the table"),
        *((DETOUR, name, "the name is") for name in ("=HYPERLINK(1)", "@a", "  ", "a\x07b", "x" * 61)),
    ],
)
def test_a_path_that_leads_elsewhere_or_a_name_that_a_spreadsheet_would_run_is_refused(
    recordings: Recordings, places, user: str, sentence: str
):
    with pytest.raises(InputError, match=sentence):
        draw(recordings, places=places, user=user)
    assert not (recordings.folder / "demonstrations.csv").exists()


def test_rows_and_columns_that_a_person_wrote_stay(recordings: Recordings):
    file = recordings.folder / "demonstrations.csv"
    file.write_text("z,scene,user,demo,t,x,y,valid\n.1,first,robot,run A,0,.08,.08,true\n")
    draw(recordings, False, "second")
    lines = file.read_text().splitlines()
    assert lines[:2] == ["z,scene,user,demo,t,x,y,valid", ".1,first,robot,run A,0,.08,.08,true"]
    assert lines[2].startswith(",second,Zoë,1,0.000,0.0800,0.0800,false")


@pytest.mark.slow
def test_threads_that_store_at_once_lose_nothing(recordings: Recordings):
    paths = [[START, (0.3, 0.3 + 0.01 * i), GOAL] for i in range(24)]
    with ThreadPoolExecutor(8) as pool:
        done = list(pool.map(lambda places: draw(recordings, places=places)["demo"], paths))
    assert sorted(map(int, done)) == list(range(1, 25))
    assert stored(recordings).groupby("demo").size().tolist() == [40] * 24


def test_a_path_sent_twice_is_stored_once_and_undo_removes_it_and_no_other_of_its_name(recordings: Recordings):
    seen = draw(recordings)
    assert draw(recordings) == seen and stored(recordings)["demo"].nunique() == 1
    recordings.remove(seen["id"])
    assert draw(recordings, False)["demo"] == seen["demo"]
    with pytest.raises(InputError, match="removed already"):
        recordings.remove(seen["id"])
    assert not stored(recordings)["valid"].any()


def test_a_path_that_nobody_judged_is_judged_once_in_all_of_its_rows(recordings: Recordings):
    draw(recordings)
    file = recordings.folder / "demonstrations.csv"
    file.write_text(file.read_text().replace(",true", ","))
    assert recordings.overview()["counts"]["first"]["Zoë"]["unjudged"] == 1
    (path,) = recordings.scene("first")["paths"]
    assert path["valid"] is None
    recordings.judge(path["id"], False)
    assert not stored(recordings)["valid"].any()
    with pytest.raises(InputError, match="judged or removed already"):
        recordings.judge(path["id"], True)


def test_a_scene_without_items_is_told_to_be_empty_or_left_to_the_detector(recordings: Recordings):
    recordings.place_items("first", [], [])
    assert recordings.items("first")["told"] and not recordings.items("second")["told"]
    recordings.place_items("first", [], [], told=False)
    assert not recordings.items("first")["told"]


def test_outlines_may_leave_the_picture_a_little_and_items_of_another_file_are_left_to_it(
    recordings: Recordings,
):
    recordings.place_items("first", ["cup"], [[[-0.5, 3.0], [20.0, 3.0], [20.0, 30.0]]])  # as detectors cut them off
    (recordings.folder / "items.csv").write_text("scene,kind\nfirst,cup\n")
    assert recordings.items("first")["elsewhere"] == "items.csv" and not recordings.items("second")["elsewhere"]
    with pytest.raises(InputError, match=r"items of first stand in items\.csv: change them there"):
        recordings.place_items("first", [], [])


def test_corners_of_one_picture_leave_those_of_the_others_and_crossing_ones_are_refused(recordings: Recordings):
    before, crossed = (recordings.folder / "table.yaml").read_text(), np.array(CORNERS, float)[[0, 2, 1, 3]].tolist()
    with pytest.raises(InputError, match="convex"):
        recordings.place_table("first", True, crossed, [1.0, 1.0])
    assert (recordings.folder / "table.yaml").read_text() == before
    moved = (np.array(CORNERS) + 5.0).tolist()
    flow = files.with_import("size_m: 2\n", "import: {\n  unit: mm\n}\nsize_m: 1\n")  # no lines of its own
    assert yaml.safe_load(flow) == {"size_m": 2, "import": {"unit": "mm"}}
    imported = "import:\n  unit: mm  # guessed\n"
    (recordings.folder / "table.yaml").write_text(f"{imported}{before}")
    recordings.place_table("second", False, moved, [0.8, 0.5])
    assert (recordings.folder / "table.yaml").read_text().endswith(imported)
    content = yaml.safe_load((recordings.folder / "table.yaml").read_text())
    assert content["corners"] == {"first": CORNERS, "second": moved}
    assert content["size_m"] == [0.8, 0.5]


def test_a_camera_that_is_turned_upright_by_exif_gives_the_size_as_shown(recordings: Recordings):
    jpeg = cv2.imencode(".jpg", picture())[1].tobytes()
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    (recordings.folder / "scenes" / "turned.jpeg").write_bytes(turned)
    assert (recordings.picture_size("first"), recordings.picture_size("turned")) == ((WIDTH, HEIGHT), (HEIGHT, WIDTH))


@pytest.mark.parametrize("name", ["demonstrations.csv", "table.yaml", "scenes/third.png"])
def test_a_link_out_of_the_folder_is_refused(tmp_path: Path, name: str):
    folder = make_folder(tmp_path)
    (tmp_path / "outside").write_text("")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(tmp_path / "outside")
    with pytest.raises(InputError, match="link out of the folder"):
        Recordings(folder)
