"""Labels come along with a log, and so do bags that another program than rosbags wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from pipeline.own.importing.segments import without_ways_back
from tests.own.importing import bags
from tests.own.importing.test_import import HZ, assert_is_hand, hand, imported, write_csv


def accepted(word: Callable[[bool], Any]) -> list[bags.Entry]:
    """A hand that moves twice, and a label after each movement: yes, no."""
    entries = [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand()]
    return [*entries, *((t, "/accepted", word(t < 9)) for t in (4.5, 11.5))]


@pytest.mark.parametrize(
    "word",
    [
        lambda yes: bags.make("std_msgs/Bool", yes),
        lambda yes: bags.make("std_msgs/String", "good" if yes else "bad"),
        lambda yes: bags.make("std_msgs/Int8", int(yes)),
    ],
)
def test_labels_come_from_a_topic_after_each_movement(tmp_path: Path, word: Callable[[bool], Any]):
    demos, folder = imported(bags.write(tmp_path / "bag", accepted(word)), "--label", "/accepted", "--size", "1.2,.8")
    assert demos.groupby("scene")["valid"].unique().map(list).to_dict() == {"bag-01": ["true"], "bag-02": ["false"]}
    assert yaml.safe_load((folder / "table.yaml").read_text())["size_m"] == [1.2, 0.8]


@pytest.mark.parametrize(("segments", "labels"), [("stops", ["true", "false"]), ("moves", ["", "true", "", "false"])])
def test_a_way_back_is_left_out_and_the_label_after_it_is_the_demonstration_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], segments: str, labels: list[str]
):
    """The hand carries back in sight; the word comes when it is back, and the only picture much later."""
    places = [(x, y) for _, x, y in hand(1)]
    poses = [*places, *places[::-1]] * 2  # 12 s each way and back
    entries = [(i / HZ, "/hand", bags.posed(i / HZ, *place)) for i, place in enumerate(poses)]
    entries += [(11.9, "/ok", bags.make("std_msgs/Bool", True)), (23.9, "/ok", bags.make("std_msgs/Bool", False))]
    entries.append((99.0, "/camera", bags.image(99, np.zeros((8, 8, 3), np.uint8), "rgb8")))
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "table.yaml").write_text(f"import: {{segments: {segments}}}")
    demos, folder = imported(bags.write(tmp_path / "bag", entries), "--label", "/ok")
    assert demos.groupby("scene")["valid"].first().tolist() == labels
    assert ("left out: 2" in capsys.readouterr().out) == (segments == "stops") and not [*(folder / "scenes").iterdir()]


def test_after_a_movement_that_ends_where_it_began_none_is_a_way_back():
    there_and_back = np.tile(1 - np.abs(np.linspace(-1, 1, 51)), 3)
    metres = np.stack([0.1 + 0.8 * there_and_back, there_and_back**2], axis=1)
    assert len(without_ways_back(metres, np.split(np.arange(153), 3))) == 3


def test_a_hand_that_keeps_to_a_line_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "log.csv").write_text("\n".join(["t,x,y", *(f"{t},{x},0.7" for t, x, _ in hand(1))]))
    imported(tmp_path / "log.csv")
    assert "demonstrations: 1, " in (said := capsys.readouterr().out) and "x or y stays the same" in said


def test_labels_come_from_a_column(tmp_path: Path):
    lines = (log := write_csv(tmp_path / "log.csv", "plain")).read_text().splitlines()
    words = ["fine", *("1.0" if float(line.split(",")[0]) < 6 else "0.0" for line in lines[1:])]
    log.write_text("\n".join(f"{line},{word}" for line, word in zip(lines, words, strict=True)))
    demos, _ = imported(log, "--label", "fine")
    assert demos.groupby("scene")["valid"].first().to_dict() == {"log-01": "true", "log-02": "false"}


def test_a_bag_of_another_writer_with_types_of_its_own_is_read(tmp_path: Path):
    """The package mcap-ros2-support writes text definitions, messages of unknown types, and no metadata.yaml."""
    writer_of = pytest.importorskip("mcap_ros2.writer").Writer
    stamp, line = "builtin_interfaces/Time stamp\nstring frame_id", "\n" + "=" * 80 + "\nMSG: "
    headed = f"{line}std_msgs/Header\n{stamp}{line}builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
    image = "std_msgs/Header header\nstring format\nuint8[] data" + headed
    kinds = {"sensor_msgs/msg/CompressedImage": image, "lab_msgs/msg/Grip": "string<=9 name\nfloat32[3] force"}
    point, turn = (f"float64 {' '.join(axes)}".replace(" ", "\nfloat64 ")[8:] for axes in ("xyz", "xyzw"))
    pose = f"geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation{line}geometry_msgs/Point\n{point}"
    posed = f"std_msgs/Header header\ngeometry_msgs/Pose pose{headed}{line}geometry_msgs/Pose\n{pose}"
    kinds["geometry_msgs/msg/PoseStamped"] = f"{posed}{line}geometry_msgs/Quaternion\n{turn}"
    jpeg = cv2.imencode(".jpg", np.full((8, 8, 3), 99, np.uint8))[1].tobytes()
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = writer_of(file)
        schemas = {name: writer.register_msgdef(name, text) for name, text in kinds.items()}
        for t, x, y in hand():
            when = bags.START_NS + round(t * 1e9)
            head = {"stamp": dict(zip(("sec", "nanosec"), divmod(when, 10**9), strict=True)), "frame_id": "table"}
            place = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
            sent = {
                "geometry_msgs/msg/PoseStamped": {"header": head, "pose": place},
                "lab_msgs/msg/Grip": {"name": "left", "force": [0.0] * 3},
                "sensor_msgs/msg/CompressedImage": {"header": head, "format": "bgr8; jpeg compressed", "data": jpeg},
            }
            for name, message in sent.items():
                topic = name.rpartition("/")[2].lower()
                writer.write_message(topic, schemas[name], message, log_time=when, publish_time=when)
        writer.finish()
    demos, folder = imported(tmp_path / "log.mcap")
    assert_is_hand(demos)
    assert [path.name for path in sorted((folder / "scenes").iterdir())] == ["log-01.jpg", "log-02.jpg"]
