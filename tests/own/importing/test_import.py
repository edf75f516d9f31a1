"""Logs of every kind that is read become the same folder of a person's own table."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.own.__main__ import main
from pipeline.own.folder import read_folder
from pipeline.runtime.errors import InputError
from tests.factories import RED, WHITE, draw_table
from tests.own.folders import whole
from tests.own.importing import bags

BESIDE = Path(__file__).parent
HZ = 50
Samples = list[tuple[float, float, float]]  # t [s], x, y [m]


def hand(demos: int = 2) -> Samples:
    """Movements from (.08, .08) to (.92, .92) in two seconds each, at rest for two seconds around each of them."""
    u = np.concatenate([[0.0] * 2 * HZ, *[np.r_[np.linspace(0, 1, 2 * HZ), [1.0] * 2 * HZ]] * demos])
    restarts = np.flatnonzero((u[1:] == 0) & (u[:-1] == 1)) + 1
    t = np.arange(len(u)) / HZ
    for row in restarts:
        t[row:] += 3  # the hand is carried back unseen
    return list(zip(t.tolist(), (0.08 + 0.84 * u).tolist(), (0.08 + 0.84 * u**2).tolist(), strict=True))


def imported(log: Path | Sequence[Path], *options: str) -> tuple[pd.DataFrame, Path]:
    """The demonstrations that come out of a log, and their folder."""
    logs = [log] if isinstance(log, Path) else list(log)
    folder = logs[0].parent / "folder"
    assert main(["import", *map(str, logs), str(folder), *options]) == 0
    return pd.read_csv(folder / "demonstrations.csv", dtype={"valid": str, "demo": str}, keep_default_na=False), folder


def assert_is_hand(demos: pd.DataFrame, count: int = 2) -> None:
    """They are the movements of `hand`, without the rests."""
    groups = [rows for _, rows in demos.groupby(["scene", "user", "demo"])]
    assert len(groups) == count
    for rows in groups:
        places = rows[["x", "y"]].to_numpy()
        np.testing.assert_allclose(places[[0, -1]], [[0.08, 0.08], [0.92, 0.92]], atol=0.012)
        np.testing.assert_allclose(places[:, 1], 0.08 + 0.84 * ((places[:, 0] - 0.08) / 0.84) ** 2, atol=2e-4)
        assert rows["t"].iloc[0] == 0 and 1.9 < rows["t"].iloc[-1] < 2.6


def plan(begin: float) -> Any:
    return bags.make("nav_msgs/Path", bags.header(0, "table"), [bags.posed(t + begin, x, y) for t, x, y in hand(1)])


POSES: dict[str, tuple[Callable[[], list[bags.Entry]], list[str]]] = {
    "PoseStamped": (lambda: [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand()], []),
    "Odometry": (lambda: [(t, "/odom", bags.odometry(t, x, y)) for t, x, y in hand()], []),
    "TF": (
        lambda: [(t, "/tf", bags.tf(t, "table", "hand", x, y)) for t, x, y in hand()],
        ["--hand", "hand", "--frame", "table"],
    ),
    "Path": (lambda: [(9.0 * i, "/plan", plan(i)) for i in (0, 1, 1)], []),  # the second is published twice
}


@pytest.mark.parametrize("storage", bags.STORAGES, ids=str)
@pytest.mark.parametrize("kind", POSES)
def test_poses_of_a_bag_become_demonstrations_cut_by_stops(tmp_path: Path, kind: str, storage: Any):
    entries, options = POSES[kind]
    demos, _ = imported(bags.write(tmp_path / "bag", entries(), storage), *options)
    if kind == "Path":  # is a demonstration as it is, its rests too
        demos = demos[demos["t"].between(2 - 1e-6, 4)].assign(t=lambda rows: rows["t"] - 2)
    assert_is_hand(demos)
    assert set(demos["valid"]) == {""} and set(demos["user"]) == {"me"}


def test_a_bag_in_millimetres_is_told_by_the_size_of_its_paths(tmp_path: Path):
    entries = [(t, "/odom", bags.odometry(t, 1000 * x, 1000 * y)) for t, x, y in hand()]
    demos, folder = imported(bags.write(tmp_path / "bag", entries))
    assert_is_hand(demos)
    assert yaml.safe_load((folder / "table.yaml").read_text())["import"]["unit"] == "mm"


def test_poses_follow_a_chain_of_transforms_that_moves(tmp_path: Path):
    """The table's corner lies at (1, 2) of the map, turned by 90 degrees, which is told late; the robot drives."""
    entries: list[bags.Entry] = [(9, "/tf_static", bags.tf(9, "map", "table", 1.0, 2.0, np.pi / 2))]
    for t, x, y in hand():
        entries.append((t, "/tf", bags.tf(t, "map", "robot", 0.01 * t, 0.5, np.pi)))
        entries.append((t + 1e-3, "/hand", bags.posed(t, 0.01 * t - (1 - y), 0.5 - (2 + x), "robot")))
    assert_is_hand(imported(bags.write(tmp_path / "bag", entries), "--frame", "table")[0])


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "mono8", "8UC3", "bayer_grbg8", "jpeg", "png"])
def test_a_scene_is_the_picture_before_the_hand_moves(tmp_path: Path, encoding: str):
    entries = [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand()]
    for second in range(18):
        pixels = np.full((48, 64, 3), [10 * second, 80, 20], np.uint8)
        entries.append((second + 0.5, "/camera", bags.image(second, pixels, encoding)))
    _, folder = imported(bags.write(tmp_path / "bag", entries))
    for scene, t in (("bag-01", 2), ("bag-02", 9)):
        picture = cv2.imread(str(folder / "scenes" / f"{scene}.{'jpg' if encoding == 'jpeg' else 'png'}"))
        assert picture is not None and picture.shape == (48, 64, 3)
        red = 10 * (t - 1)  # of half a second before
        assert np.abs(picture[20, 20].astype(int) - ([red] * 3 if encoding == "mono8" else [20, 80, red])).max() <= 3


@pytest.mark.parametrize("of", ["Bool", "JointState"])
def test_a_gripper_cuts_a_bag_where_it_is_closed(tmp_path: Path, of: str):
    def message(closed: bool) -> Any:
        if of == "Bool":
            return bags.make("std_msgs/Bool", closed)
        width, empty = np.array([0.3, 0.0 if closed else 0.04]), np.empty(0)
        return bags.make("sensor_msgs/JointState", bags.header(0, ""), ["arm", "finger"], width, empty, empty)

    entries = [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand()]
    entries += [(t, "/gripper", message(closed)) for t, closed in ((0, False), (2.49, True), (3.49, False))]
    gripper = "/gripper" if of == "Bool" else "/gripper:finger"
    demos, folder = imported(bags.write(tmp_path / "bag", entries), "--gripper", gripper)
    assert set(demos["scene"]) == {"bag"} and demos["t"].max() == pytest.approx(1, abs=0.03)
    assert demos["x"].iloc[0] == pytest.approx(0.08 + 0.84 * 0.25, abs=0.01)
    closed = yaml.safe_load((folder / "table.yaml").read_text())["import"]["closed"]
    assert closed == ("high" if of == "Bool" else "low")


@pytest.mark.parametrize("version", ["v21", "v30"])
def test_episodes_of_a_lerobot_data_set_become_demonstrations_with_their_first_frames(tmp_path: Path, version: str):
    """The samples were written by LeRobot itself, by make_lerobot.py beside this file."""
    log = tmp_path / "cups"
    log.symlink_to(BESIDE / f"lerobot_{version}")
    demos, folder = imported(log)
    u = np.arange(16) / 15
    path = np.stack([u * 1.5, 0.1 + 0.8 * u, 0.1 + 0.8 * u**2], -1)
    for episode, (_, rows) in enumerate(demos.groupby("scene")):
        np.testing.assert_allclose(rows[["t", "x", "y"]], path, atol=1e-4)
        picture = cv2.imread(str(folder / "scenes" / f"lerobot_{version}-{episode:03d}.png"))
        assert picture is not None and np.abs(picture.astype(int) - (40 + 80 * episode)).max() <= 2
    assert demos["scene"].nunique() == 3


def test_a_lerobot_data_set_can_be_cut_by_a_column(tmp_path: Path):
    log = tmp_path / "cups"
    log.symlink_to(BESIDE / "lerobot_v30")
    demos, _ = imported(log, "--gripper", "gripper", "--columns", "x=action.x,y=action.y")
    assert demos.groupby("scene").size().tolist() == [8] * 3
    assert demos["x"].min() == pytest.approx(1.1 + 0.8 * 4 / 15, abs=1e-4)


DIALECTS = {  # header, delimiter, decimal sign, and t, x, y as written
    "plain": ("t,x,y", ",", ".", lambda t, x, y: (t, x, y)),
    "German Excel": ("Zeit;t [ms];X [cm];Y [cm]", ";", ",", lambda t, x, y: (0, t * 1e3, x * 100, y * 100)),
    "rostopic echo -p": (
        "%time,field.header.stamp,field.pose.position.x,field.pose.position.y,field.pose.orientation.x,field.pose.orientation.y",
        ",",
        ".",
        lambda t, x, y: (bags.START_NS + round(t * 1e9), 0, x, y, 0, 1),
    ),
    "motion capture": ("# tracker 7\n\nframe\ttime_s\tTX\tTY", "\t", ".", lambda t, x, y: (0, t, x * 1e3, y * 1e3)),
    "spaces": ("stamp  pos_x  pos_y", " ", ".", lambda t, x, y: (t * 1e6, x, y)),
    "motion capture with a take": ("Take Name,a\n\nFrame,Time (Seconds),X,Y", ",", ".", lambda t, x, y: (0, t, x, y)),
    "dates": ("Datetime;X [mm];Y [mm]", ";", ",", lambda t, x, y: (f"2026-11-28T09:00:{t:09.6f}Z", x * 1e3, y * 1e3)),
    "French": ("temps;x;y", ";", ",", lambda t, x, y: (t, x, y)),
    "quoted": ('"time","x_mm","y_mm"', ",", ",", lambda t, x, y: (t, x * 1e3, y * 1e3)),
}


def write_csv(path: Path, dialect: str) -> Path:
    header, delimiter, decimal, written = DIALECTS[dialect]

    def cell(value: float) -> str:
        text = f"{value:.6f}".replace(".", decimal) if isinstance(value, float) else str(value)
        return f'"{text}"' if delimiter == decimal else text

    lines = [delimiter.join(map(cell, written(*sample))) for sample in hand()]
    path.write_text("\n".join([header, *lines, ""]))
    return path


@pytest.mark.parametrize("dialect", DIALECTS)
def test_csv_is_read_in_any_dialect(tmp_path: Path, dialect: str):
    assert_is_hand(imported(write_csv(tmp_path / "log.csv", dialect))[0])


def test_minutes_and_seconds_as_excel_shows_them_are_no_hours(tmp_path: Path):
    lines = [f"{int(t) // 60:02d}:{t % 60:04.1f},{x},{y}" for t, x, y in hand()[::5]]
    (tmp_path / "log.csv").write_text("\n".join(["t,x,y", *lines]))
    assert 1 < imported(tmp_path / "log.csv")[0]["t"].max() < 3


def test_a_demonstration_that_hardly_moves_is_left_out_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    lines = [f"{t},{x if demo else 0.1},{y if demo else 0.1},{demo}" for demo in (0, 1) for t, x, y in hand(1)]
    (tmp_path / "log.csv").write_text("\n".join(["t,x,y,demo", *lines]))
    assert set(imported(tmp_path / "log.csv")[0]["demo"]) == {"1"}
    said = capsys.readouterr().out
    assert "recordings without a demonstration of 0.1 m, left out: 1" in said and "times are taken for s" in said


def test_two_logs_that_make_one_scene_are_refused(tmp_path: Path):
    logs = write_csv(tmp_path / "take.csv", "plain"), tmp_path / "take-01.csv"
    logs[1].write_text("\n".join(["t,x,y", *(f"{t},{x},{y}" for t, x, y in hand(1))]))
    with pytest.raises(InputError, match="take and take-01 both make the scene take-01: rename one"):
        imported(logs)


def test_what_table_yaml_says_holds(tmp_path: Path):
    """Here y runs down from the far edge of a table of 10 m, in cm, from a corner at (.5, .1) m; the log is turned."""
    log, table = write_csv(tmp_path / "log.csv", "motion capture"), tmp_path / "folder" / "table.yaml"
    table.parent.mkdir()
    table.write_text("size_m: 10\nimport: {unit: cm, y: down, origin: [.5, .1], turn_deg: 90, segments: whole}")
    demos, _ = imported(log)
    _, x, y = hand()[0]
    assert (demos["x"].iloc[0], demos["y"].iloc[0]) == pytest.approx((10 * y - 0.1, 10 + 10 * x - 0.5), abs=1e-4)


def test_a_second_import_by_the_written_table_yaml_says_the_same(tmp_path: Path):
    log = write_csv(tmp_path / "log.csv", "German Excel")
    first, folder = imported(log)
    written = (folder / "table.yaml").read_text()
    assert yaml.safe_load(written)["import"]["columns"] == {"t": "t [ms]", "x": "X [cm]", "y": "Y [cm]"}
    (folder / "demonstrations.csv").unlink()
    (folder / "scenes").rmdir()
    with pytest.raises(InputError, match="correct it there, or leave the option out"):
        imported(log, "--columns", "t=X [cm]")
    pd.testing.assert_frame_equal(imported(log, "--columns", "t=t [ms]")[0], first)
    assert (folder / "table.yaml").read_text() == written


def test_names_and_labels_of_a_csv_file_are_kept(tmp_path: Path):
    demos = (("a", "7", "true"), ("b", "8", ""))
    lines = [f"{t},{x},{y},{scene},Jürgen,{demo},{valid}" for scene, demo, valid in demos for t, x, y in hand(1)]
    text = "\n".join(["t,x,y,Scene,participant,trial,valid", *lines])
    (tmp_path / "log.csv").write_text(text, encoding="cp1252")
    rows = imported(tmp_path / "log.csv", "--columns", "user=participant,demo=trial")[0].drop_duplicates("scene")[
        ["scene", "user", "demo", "valid"]
    ]
    assert rows.to_numpy().tolist() == [["a", "Jürgen", "7", "true"], ["b", "Jürgen", "8", ""]]


def test_a_bag_for_each_demonstration_becomes_a_folder_that_the_check_accepts(tmp_path: Path):
    logs = []
    for i in range(4):
        entries = [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand(1)]
        picture = draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE), seed=i)
        logs.append(bags.write(tmp_path / f"run{i}", [*entries, (0.0, "/camera", bags.image(0, picture, "rgb8"))]))
    demos, folder = imported(logs)
    assert read_folder(folder)[0] is None  # for want of labels
    demos.assign(valid=(demos["scene"] < "run2")).to_csv(folder / "demonstrations.csv", index=False)
    assert whole(folder).scenes == ["run0", "run1", "run2", "run3"]


def test_a_folder_that_holds_anything_is_left_as_it_is(tmp_path: Path):
    log = write_csv(tmp_path / "log.csv", "plain")
    _, folder = imported(log)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="move the rest away"):
        imported(log)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
