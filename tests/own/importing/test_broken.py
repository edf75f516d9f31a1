"""A log that cannot be used is refused with a sentence that says why, and nothing is written."""

import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode  # pyright: ignore[reportMissingImports]

from pipeline.own.__main__ import main
from pipeline.runtime.errors import InputError
from tests.own.importing import bags
from tests.own.importing.test_import import BESIDE, hand

Make = Callable[[Path], Path]  # makes a log in a folder and returns it


def poses(change: Callable[[list[bags.Entry]], list[bags.Entry]] = list, name: str = "log", **how: Any) -> Make:
    """A bag of poses, whose entries are changed."""
    entries = [(t, "/hand", bags.posed(t, x, y)) for t, x, y in hand(1)]
    return lambda path: bags.write(path / name, change(entries), **how)


def more(*entries: bags.Entry) -> Make:
    return poses(lambda given: [*given, *entries])


def spoilt(make: Make, spoil: Callable[[Path], object]) -> Make:
    """The log, after something was done to it."""

    def made(path: Path) -> Path:
        log = make(path)
        spoil(log)
        return log

    return made


def truncate(file: Path, share: float) -> None:
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])


def cut(make: Make, pattern: str, share: float = 0.6) -> Make:
    """The file that fits the pattern is truncated."""
    return spoilt(make, lambda log: truncate(next(log.rglob(pattern)), share))


def widest_pages(log: Path) -> None:
    with closing(sqlite3.connect(next(log.rglob("*.db3")))) as database:
        database.execute("pragma page_size = 65536")
        database.execute("vacuum")


def without(make: Make, pattern: str) -> Make:
    return spoilt(make, lambda log: next(log.rglob(pattern)).unlink())


def metadata(old: str, new: str) -> Make:
    """A bag whose metadata.yaml says something else."""

    def spoil(log: Path) -> None:
        text = (log / "metadata.yaml").read_text()
        assert old in text
        (log / "metadata.yaml").write_text(text.replace(old, new))

    return spoilt(poses(), spoil)


def lerobot(version: str = "v30", info: Callable[[dict], object] = lambda info: None) -> Make:
    """A data set whose info.json is changed."""

    def spoil(log: Path) -> None:
        content = json.loads((log / "meta/info.json").read_text())
        info(content)
        (log / "meta/info.json").write_text(json.dumps(content))

    return spoilt(lambda path: Path(shutil.copytree(BESIDE / f"lerobot_{version}", path / "log")), spoil)


def states(*columns: list) -> Make:
    """A data set whose table has these columns of states, each row alike, in place of its own."""

    def spoil(log: Path) -> None:
        (file,) = log.glob("data/*/*")
        table = pq.read_table(file).drop_columns(["observation.state"])
        for row in columns:
            table = table.append_column("observation.state", pa.array([row] * len(table), pa.list_(pa.float32())))
        pq.write_table(table, file)

    return spoilt(lerobot(), spoil)


def rewritten(pattern: str, column: str, change: Callable[[int, Any], Any]) -> Make:
    """A data set in one of whose tables a column is changed, cell by cell (row, cell)."""

    def spoil(log: Path) -> None:
        table = pq.read_table(file := next(log.glob(pattern)))
        i, cells = table.column_names.index(column), table[column].to_pylist()
        changed = pa.array([change(row, cell) for row, cell in enumerate(cells)])
        pq.write_table(table.set_column(i, column, changed), file)

    return spoilt(lerobot(), spoil)


def state(change: Callable[[int, Any], Any]) -> Make:
    return rewritten("data/*/*", "observation.state", change)


def shorten(log: Path) -> None:
    """The video of all episodes is the one of the first alone."""
    (video,) = log.rglob("*.mp4")
    shutil.copy(next((BESIDE / "lerobot_v21").rglob("episode_000000.mp4")), video)


def pointer(log: Path) -> None:
    next(log.rglob("data/*/*")).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")


def text(content: str, name: str = "log.csv") -> Make:
    def made(path: Path) -> Path:
        (path / name).write_text(content)
        return path / name

    return made


def rows(header: str, *lines: str) -> Make:
    return text("\n".join([header, *(f"{t},{x},{y}" for t, x, y in hand(1)), *lines]))


def second_camera(info: dict) -> None:
    info["features"]["observation.images.wrist"] = info["features"]["observation.images.top"]


def name_more(info: dict) -> None:
    info["features"]["observation.state"]["names"] = ["a", "b", "c", "d", "x", "y"]


def video_path(name: str) -> Make:
    return lerobot(info=lambda info: info.update(video_path=name))


def open_bracket(log: Path) -> None:
    (log / "metadata.yaml").write_text("a: [\n")


EPISODES, FILE_INDEX = "meta/episodes/*/*", "videos/observation.images.top/file_index"
NO_JSON = spoilt(lerobot(), lambda log: (log / "meta/info.json").write_text("["))
NO_EPISODE = lerobot(info=lambda info: info.update(total_episodes=0))
EMPTY = spoilt(NO_EPISODE, lambda log: shutil.rmtree(log / "data"))
GREY = np.zeros((8, 8, 3), np.uint8)
OTHER = (0.0, "/other", bags.posed(0, 0, 0))
AFTER, WORD = (9.0, *OTHER[1:]), (9.0, "/say", bags.make("std_msgs/String", "so"))
NUMBERLESS = poses(lambda given: [(t, "/hand", bags.posed(t, np.nan, 0)) for t, *_ in given])
BASE = (0.0, "/tf", bags.tf(0, "map", "base", 0, 0))
LEFT, RIGHT = (0.0, "/left", bags.image(0, GREY, "rgb8")), (0.0, "/right", bags.image(0, GREY, "png"))
UNTURNED = bags.tf(0, "table", "base", 0, 0)
UNTURNED.transforms[0].transform.rotation.w = 0.0
TALL = bags.image(0, GREY, "rgb8")
TALL.height *= 2
CLOSED = (0.0, "/grip", bags.make("std_msgs/Bool", True))
SQLITE: dict[str, Any] = {"storage": bags.STORAGES[0]}
ZSTD = SQLITE | {"mode": CompressionMode.FILE, "fmt": CompressionFormat.ZSTD}
PLAIN, LZ77 = "compression_mode: ''", "compression_mode: file"
BROKEN: list[tuple[str, Make, str, str]] = [  # what is wrong, the log, options, the sentence
    ("missing", lambda path: path / "log.mcap", "", "is missing: expected a ROS bag"),
    ("another kind", text("", "log.pdf"), "", "is of another kind"),
    ("no topic with poses", poses(lambda given: [CLOSED]), "", "expected geometry"),
    ("several topics", more(OTHER), "", "--topic: several.* /hand .*/other .*choose"),
    ("a topic that is not there", poses(), "--topic /arm", "/arm is not among /hand"),
    ("no transform", more(BASE), "--frame desk", "from table to desk.* base, map"),
    ("no TF at all", poses(), "--frame desk", "TF holds no frame"),
    ("hand without frame", more(BASE), "--hand tool", "add --frame; TF holds base, map"),
    ("a rotation of zeros", more((0.0, "/tf", UNTURNED)), "--frame map", "from base to table .* unit quaternion"),
    ("hand not in TF", more(BASE), "--hand tool --frame map", "from tool"),
    ("several frames", more((9, "/hand", bags.posed(9, 0, 0, "map"))), "", "frames map, table"),
    ("poses without numbers", NUMBERLESS, "", "none with"),
    ("times that go back", more((9, "/hand", bags.posed(1, 0, 0))), "", "time goes back from .* at sample 301"),
    ("truncated mcap", cut(poses(), "*.mcap"), "", "truncated"),
    ("empty mcap", text("", "log.mcap"), "", "seems to be empty.*mcap recover"),
    ("truncated sqlite3", cut(poses(**SQLITE), "*.db3"), "", "truncated"),
    ("sqlite3 without its end", cut(poses(**SQLITE), "*.db3", 0.999), "", "truncated"),
    ("sqlite3 of wide pages", cut(spoilt(poses(**SQLITE), widest_pages), "*.db3", 0.999), "", "truncated"),
    ("fewer messages", metadata("message_count: 300", "message_count: 400"), "", "after 300 poses.* another bag's"),
    ("no metadata", without(poses(), "metadata.yaml"), "", "reindex"),
    ("no storage file", without(poses(), "*.mcap"), "", "missing"),
    ("unknown storage", metadata("identifier: mcap", "identifier: rocksdb"), "", "'rocksdb' not supported"),
    ("unknown compression", metadata(PLAIN, LZ77), "", "Compression format .* not supported"),
    ("damaged compression", cut(poses(**ZSTD), "*.zstd"), "", "truncated"),
    ("several cameras", more(LEFT, RIGHT), "", "--picture: several"),
    ("depth pictures", more((0, "/depth", bags.image(0, GREY, "16UC1"))), "", "encoding is '16UC1'"),
    ("a picture with too few rows", more((0.0, "/camera", TALL)), "", "of 8 x 16 pixels has 224 bytes in rows of 28"),
    ("a camera that is not there", poses(), "--picture /camera", "no topic of sensor_msgs/msg/CompressedImage"),
    ("gripper that stays", more(CLOSED), "--gripper /grip", "opens and closes"),
    ("gripper of poses", poses(), "--gripper /hand", "TOPIC:JOINT"),
    ("no movement", poses(lambda given: given[:50]), "", "no movement is 0.1 m long"),
    ("a part of a data set", lambda path: lerobot()(path) / "meta", "", "another kind"),
    ("old format", lerobot(info=lambda info: info.update(codebase_version="v1.6")), "", "v1.6"),
    ("two cameras", lerobot(info=second_camera), "", "images.top, observation.images.wrist"),
    ("a column that is not there", lerobot(), "--columns x=px,y=py", "px, py not among them"),
    (
        "info without features",
        lerobot(info=lambda info: info.pop("features")),
        "",
        "info.json: features: Field required",
    ),
    ("info that is none", NO_JSON, "", "json: Invalid"),
    ("info with a word", lerobot(info=lambda info: info.update(total_episodes="x")), "", "total_episodes: "),
    ("info of another data set", lerobot(info=lambda info: info.update(total_episodes=1)), "", "episode 2, .* names 1"),
    ("info with more names", lerobot(info=name_more), "", "state has 4 numbers a row, meta/info.json names more"),
    ("info without video_path", lerobot(info=lambda info: info.pop("video_path")), "", "video_path: Field required"),
    ("info with a video of no name", video_path("{camera}.mp4"), "", "'{camera}.mp4' is no name with .* in braces"),
    ("info with an open brace", video_path("{"), "", "video_path: Value error"),
    ("episodes without a number", rewritten(EPISODES, FILE_INDEX, lambda row, cell: None), "", "file_index is not a n"),
    ("episodes with words", rewritten(EPISODES, "episode_index", lambda row, cell: "a"), "", "index is not a n"),
    ("states of lost samples", state(lambda row, cell: cell if row % 4 else None), "", "state is not .* in each row"),
    ("states of 3 and 5 numbers", state(lambda row, cell: cell[:3] if row % 2 else [*cell, 9.0]), "", "in each row"),
    ("states of words", state(lambda row, cell: "a"), "", "state is not a number"),
    ("metadata of several lines", spoilt(poses(), open_bracket), "", r"YAML from .*, but found .* \(line: 2\)"),
    ("a data set without episodes", EMPTY, "", "no recording"),
    ("parquet without the columns", states(), "", "no column observation.state"),
    ("a data set of lost samples", states([np.nan] * 4), "", "no row with a time and a position"),
    ("format v3 without its list of episodes", without(lerobot(), "meta/episodes/*/*"), "", "lacks 3 episodes"),
    ("truncated parquet", cut(lerobot(), "data/*/*"), "", "file-000.parquet is no whole parquet file"),
    ("a clone without its tables", spoilt(lerobot(), pointer), "", "file-000.parquet .* `git lfs pull`"),
    ("an episode is missing", without(lerobot("v21"), "*1.parquet"), "", "lacks 1 of 3 episodes, the first 1"),
    ("a video is missing", without(lerobot("v21"), "*1.mp4"), "", "episode_000001.mp4"),
    ("a video that ends early", spoilt(lerobot(), shorten), "", "ends before 1.6 s"),
    ("truncated video", cut(lerobot("v21"), "*.mp4"), "", "cannot be read"),
    ("csv without times", rows("n,x,y"), "", "no times among n, x, y"),
    ("csv without places", rows("t,a,b"), "", "expected a header"),
    ("csv with several places", text("t,hand.x,hand.y,head.x,head.y\n"), "", "x=hand.x,y=hand.y; x=head.x,y=head.y"),
    ("csv with words", rows("t,x,y", "9,left,0"), "", "row 302: x is 'left'"),
    ("csv with two columns of a name", text("t,x,y,x\n"), "", "two columns 'x'"),
    ("csv with two columns of labels", text("t,x,y,valid,Valid\n"), "", "two columns 'Valid'"),
    ("csv with decimal commas between commas", text("t,x,y\n0,0,0,1,0,1\n"), "", "row 2 has 6 cells, the header 3"),
    ("csv with a scene in another folder", text("t,x,y,scene\n0,0,0,../a\n1,1,1,../a\n"), "", r"scene is '\.\./a'"),
    ("a user without a name", rows("t,x,y"), "--user=", "user is ''"),
    ("a column for nothing", rows("t,x,y"), "--columns q=t", "--columns names 'q'"),
    ("csv with times that stand still", text("sec,x,y\n" + "1,0,0\n1,1,1\n1,2,2\n"), "", "the time of the one before"),
    ("csv in which dates are none", rows("t,x,y", "25:61,0,0"), "", "row 302: t is '25:61'"),
    ("a label that is none", more(WORD), "--label /say", "label of log is 'so'"),
    ("a topic that says no label", more(AFTER), "--topic /hand --label /other", "is 'geometry_msgs/msg/PoseStamped'"),
    ("a size that is none", poses(), "--size 1.2m", "size_m is .*1.2m"),
    ("csv with a short row", rows("t,x,y", "9,0"), "", "row 302 has 2 cells"),
    ("csv with times that go back", rows("t,x,y", "1,0,0"), "", "time goes back"),
    ("csv in pixels", rows("t,x,y", "9,1e6,0"), "", "no path on a table"),
    ("empty csv", text(""), "", "expected a header"),
    ("csv of lost samples", text("t,x,y\n0,nan,nan\n"), "", "no row with a time and a position"),
]


@pytest.mark.parametrize(("make", "options", "sentence"), [pytest.param(*rest, id=name) for name, *rest in BROKEN])
def test_a_broken_log_is_refused_and_nothing_is_written(tmp_path: Path, make: Make, options: str, sentence: str):
    log = make(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=sentence):
        main(["import", str(log), str(tmp_path / "new" / "folder"), *options.split()])
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_that_cannot_be_written_is_refused_and_nothing_is_left(tmp_path: Path):
    log = rows("t,x,y")(tmp_path)
    with pytest.raises(InputError, match=r"folder cannot be written .* choose another"):
        main(["import", str(log), str(log / "folder")])
    assert [*tmp_path.iterdir()] == [log]


WRONG = {
    "import: {unit: inch}": "import.unit is 'inch'",
    "import: {colour: red}": "import.colour",
    "import: metres": "import is 'metres'",
    "import: [": "cannot be read",
}


@pytest.mark.parametrize("content", WRONG)
def test_a_wrong_table_yaml_is_refused(tmp_path: Path, content: str):
    log, folder = rows("t,x,y")(tmp_path), tmp_path / "folder"
    folder.mkdir()
    (folder / "table.yaml").write_text(content)
    with pytest.raises(InputError, match=WRONG[content]):
        main(["import", str(log), str(folder)])
    assert [path.name for path in folder.iterdir()] == ["table.yaml"]
