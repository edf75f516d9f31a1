"""A folder with a fault is refused with a sentence that names file and row, before anything runs or is written."""

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.own.__main__ import main
from pipeline.own.check import check
from tests.factories import draw_table
from tests.own.folders import SCENES, change, demonstrations, make_folder, write_cutout, write_picture


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_folder(tmp_path_factory.mktemp("own") / "my table")


def settings(text: str) -> Callable[[Path], object]:
    return lambda path: (path / "table.yaml").write_text(text)


def cell(row: int, column: str, value: str) -> Callable[[Path], object]:
    return lambda path: change(path, row, column, value)


def rows(keep: Callable) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        table = demonstrations(path)
        table[keep(table)].to_csv(path / "demonstrations.csv", index=False)

    return write


def all_valid(path: Path) -> None:
    table = demonstrations(path)
    table.loc[table["user"] == "Ana", "valid"] = "true"
    table.to_csv(path / "demonstrations.csv", index=False)


def huge(path: Path) -> None:
    """A PNG of 65 kilobytes that claims 20,000 x 20,000 pixels."""
    header = struct.pack(">II5B", 20_000, 20_000, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(60_000))), (b"IEND", b"")]
    content = b"".join(struct.pack(">I", len(b)) + n + b + struct.pack(">I", zlib.crc32(n + b)) for n, b in chunks)
    (path / "scenes" / "tea.png").write_bytes(b"\x89PNG\r\n\x1a\n" + content)


def truncated(path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (100, 100, 3), np.uint8)
    write_picture(path / "scenes" / "tea.jpg", pixels)
    (path / "scenes" / "tea.png").unlink()
    content = (path / "scenes" / "tea.jpg").read_bytes()
    (path / "scenes" / "tea.jpg").write_bytes(content[: len(content) // 2])


def link_out(path: Path) -> None:
    elsewhere = path.parent / f"{path.name} elsewhere.png"
    write_picture(elsewhere, draw_table())
    (path / "scenes" / "tea.png").unlink()
    (path / "scenes" / "tea.png").symlink_to(elsewhere)


def kinds(text: str) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        write_cutout(path / "kinds" / "cup" / "blue.png")
        (path / "kinds.csv").write_text(text)

    return write


def opaque(path: Path) -> None:
    kinds("kind,file,width_m\ncup,blue.png,0.1\n")(path)
    write_picture(path / "kinds" / "cup" / "blue.png", draw_table())


def text(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda path: (path / name).write_bytes(content)


HEADER = "scene,kind,x,y,angle_deg,radius_m,half_length_m\n"
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing scene": (cell(2, "scene", "supper"), "demonstrations.csv, row 2: scene 'supper' has no picture"),
    "no pictures": (lambda p: [f.unlink() for f in (p / "scenes").iterdir()], "scenes/ holds no picture"),
    "unreadable picture": (text("scenes/tea.png", b"no picture"), "scenes/tea.png cannot be read"),
    "truncated picture": (truncated, "scenes/tea.jpg is truncated or damaged"),
    "huge picture": (huge, "scenes/tea.png has 20000 x 20000 pixels: expected at most 50 megapixels"),
    "one name twice": (lambda p: write_picture(p / "scenes" / "tea.jpg", draw_table()), "are one scene 'tea'"),
    "oblong picture": (
        lambda p: write_picture(p / "scenes" / "tea.png", draw_table()[:80]),
        "scenes/tea.png has 100 x 80 pixels: expected a square picture",
    ),
    "black picture": (
        lambda p: write_picture(p / "scenes" / "tea.png", np.zeros((100, 100, 3), np.uint8)),
        "scenes/tea.png is black where the table should be",
    ),
    "crossing corners": (settings("corners: [[0, 0], [90, 90], [90, 0], [0, 90]]"), "table.yaml: corners cross"),
    "mirrored corners": (settings("corners: [[90, 0], [0, 0], [0, 90], [90, 90]]"), "run counter-clockwise"),
    "three corners": (settings("corners: [[0, 0], [90, 0], [90, 90]]"), "expected four [column, row] in pixels"),
    "corners outside": (settings("corners: [[0, 0], [900, 0], [900, 90], [0, 90]]"), "lie outside: correct them"),
    "small corners": (settings("corners: [[0, 0], [9, 0], [9, 9], [0, 9]]"), "less than 50 pixels apart"),
    "corners of one scene": (settings("corners: {tea: [[0, 0], [90, 0], [90, 90], [0, 90]]}"), "no corners of Mittag"),
    "corners of no scene": (
        settings("corners: {lunch: [[0, 0], [90, 0], [90, 90], [0, 90]]}"),
        "corners of lunch: scenes/ has no such picture",
    ),
    "start is goal": (settings("start: [0.5, 0.5]\ngoal: [0.5, 0.5]"), "start and goal are closer than 0.2 m"),
    "goal off the table": (settings("goal: [1.5, 0.5]"), "goal is [1.5, 0.5]: expected [x, y] in metres"),
    "unknown setting": (settings("corner: []"), "table.yaml holds 'corner': expected some of side_m, corners"),
    "no yaml": (settings("corners: ["), "table.yaml cannot be read"),
    "side": (settings("side_m: wide"), "side_m is 'wide': expected metres"),
    "times run backwards": (cell(5, "t", "0.05"), "row 5: t goes back from 0.2 to 0.05 s in demonstration (breakfast,"),
    "text for a number": (cell(7, "x", "0,5"), "row 7: x is '0,5': expected a number with a decimal point"),
    "infinite": (cell(7, "y", "inf"), "row 7: y is 'inf'"),
    "other word": (cell(3, "valid", "maybe"), "row 3: valid is 'maybe': expected true or false"),
    "changing word": (cell(3, "valid", "true"), "row 3: valid changes within demonstration (breakfast, Ana, 0)"),
    "nameless": (cell(3, "user", ""), "row 3: user is ''"),
    "terminal codes": (cell(3, "user", "\x1b[31mAna"), "row 3: user is '\\x1b[31mAna'"),
    "ends elsewhere": (cell(13, "x", "0.5"), "row 13: demonstration (breakfast, Ana, 0) ends at (0.5, 0.92) m, 0.42 m"),
    "starts elsewhere": (cell(2, "y", "0.5"), "row 2: demonstration (breakfast, Ana, 0) starts at (0.08, 0.5) m"),
    "off the table": (cell(8, "x", "50"), "row 8: the path is at (50, "),
    "short": (rows(lambda t: (t.index > 11) | (t.index < 2)), "has 2 rows: expected at least 3"),
    "one kind of label": (all_valid, "row 2: all 16 demonstrations of user Ana are valid: expected both"),
    "few scenes": (rows(lambda t: t["scene"].isin(SCENES[:3])), "user Ana has 3 scenes: expected at least 4"),
    "no column": (text("demonstrations.csv", b"scene;user;demo;t;x;y;valid\n"), "separate columns by commas"),
    "no csv": (lambda p: (p / "demonstrations.csv").unlink(), "demonstrations.csv is missing: draw paths with"),
    "empty csv": (text("demonstrations.csv", b""), "demonstrations.csv is empty: expected a header line"),
    "no rows": (text("demonstrations.csv", b"scene,user,demo,t,x,y,valid\n"), "has no row below its header"),
    "not UTF-8": (text("demonstrations.csv", "scene,Jürgen".encode("latin-1")), "is not UTF-8: save it as"),
    "ragged": (
        text("demonstrations.csv", b"scene,user,demo,t,x,y,valid\na,b,c,1,1,1,true,9,9\n"),
        "demonstrations.csv, row 2: has 9 cells, the header 7",
    ),
    "link out of the folder": (link_out, "scenes/tea.png is a link out of the folder"),
    "kind without cut-outs": (lambda p: (p / "kinds" / "cup").mkdir(parents=True), "kinds.csv is missing"),
    "empty kind": (
        lambda p: [kinds("kind,file,width_m\ncup,blue.png,0.1\n")(p), (p / "kinds" / "jug").mkdir()],
        "kinds/jug holds no cut-out",
    ),
    "cut-out without a row": (kinds("kind,file,width_m\n"), "kinds/cup/blue.png has no row in kinds.csv"),
    "row without a cut-out": (kinds("kind,file,width_m\ncup,red.png,0.1\n"), "row 2: kinds/cup/red.png is missing"),
    "cut-out elsewhere": (kinds("kind,file,width_m\ncup,../cup/blue.png,0.1\n"), "row 2: kinds/cup/../cup/blue.png is"),
    "cut-out without width": (kinds("kind,file,width_m\ncup,blue.png,-1\n"), "row 2: width_m is -1"),
    "opaque cut-out": (opaque, "row 2: kinds/cup/blue.png has no transparent background"),
    "item without radius": (text("items.csv", (HEADER + "tea,cup,.5,.5,0,0,0\n").encode()), "row 2: radius_m is 0"),
    "item of no scene": (text("items.csv", (HEADER + "tee,cup,.5,.5,0,.1,0\n").encode()), "row 2: scene 'tee' has no"),
    "not a folder": (lambda p: p.rename(p.with_name("moved")), "is not a folder"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_a_sentence_that_names_file_and_row(name: str, whole: Path, tmp_path: Path, capfd):
    path = tmp_path / "my table"
    make_folder(path)
    break_it, sentence = FAULTS[name]
    break_it(path)
    before = sorted(path.rglob("*"))
    assert main([str(path)]) == 1
    said = capfd.readouterr().err
    assert sentence in said, said
    assert "Traceback" not in said and sorted(path.rglob("*")) == before, "nothing is half-written"


def test_a_whole_folder_has_no_fault_and_check_writes_nothing(whole: Path, capfd):
    before = sorted(whole.rglob("*"))
    assert main(["check", str(whole)]) == 0
    assert "4 scenes, 32 demonstrations of Ana, Jürgen; no fault" in capfd.readouterr().out
    assert sorted(whole.rglob("*")) == before


def test_all_faults_are_named_at_once_and_alike_rows_only_once(tmp_path: Path):
    path = make_folder(tmp_path / "t")
    for row in (3, 4, 5):
        change(path, row, "x", "?")
    change(path, 9, "valid", "yes")
    (path / "items.csv").write_text(HEADER + "tea,cup,a,.5,0,.1,0\n")
    _, _, faults = check(path)
    assert [fault.split(":")[0] for fault in faults] == [
        "demonstrations.csv, row 3", "demonstrations.csv, row 9", "items.csv, row 2",
    ]  # fmt: skip
    assert "(2 more like it)" in faults[0]


@pytest.mark.parametrize("arguments", [["check"], ["a", "b"], ["check", "a", "b"]])
def test_a_wrong_command_is_explained(arguments: list[str], capfd):
    assert main(arguments) in (1, 2)
    assert capfd.readouterr().err.startswith("error: ")


def test_decomposed_accents_are_the_same_name(tmp_path: Path):
    path = make_folder(tmp_path / "t")
    os.rename(path / "scenes" / "tea.png", path / "scenes" / "thé.png")
    table = demonstrations(path)
    table["scene"] = table["scene"].replace("tea", "the\u0301")
    table.to_csv(path / "demonstrations.csv", index=False, encoding="utf-8-sig")
    folder, _, faults = check(path)
    assert not faults and folder is not None and "thé" in folder.canvases
