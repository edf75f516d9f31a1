"""A folder with a fault is refused with a sentence that names file and row, before anything runs or is written."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.own.__main__ import main
from pipeline.own.folder import read_folder
from pipeline.runtime.errors import InputError
from tests.factories import draw_table
from tests.own.folders import SCENES, add_kind, change, edit, make_folder, write_picture

Spoil = Callable[[Path], object]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path / "my table")


def text(name: str, content: str) -> Spoil:
    return lambda path: (path / name).write_text(content, encoding="latin-1")


def corners(content: str) -> Spoil:
    return text("table.yaml", f"corners: {content}")


def cell(row: int, column: str, value: str) -> Spoil:
    return lambda path: change(path, row, column, value)


def picture(pixels: np.ndarray, name: str = "scenes/tea.png") -> Spoil:
    """A picture that takes another's place; one in kinds/ lies beside the cut-out of a cup."""
    return lambda path: (name.startswith("kinds/") and add_kind(path), write_picture(path / name, pixels))


def huge(path: Path) -> None:
    """A PNG of 65 kilobytes that claims 20,000 x 20,000 pixels."""
    header = struct.pack(">II5B", 20_000, 20_000, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(60_000))), (b"IEND", b"")]
    content = b"".join(struct.pack(">I", len(b)) + n + b + struct.pack(">I", zlib.crc32(n + b)) for n, b in chunks)
    (path / "scenes" / "tea.png").write_bytes(b"\x89PNG\r\n\x1a\n" + content)


def truncated(path: Path) -> None:
    (path / "scenes" / "tea.png").unlink()
    file = path / "scenes" / "tea.jpg"
    write_picture(file, np.random.default_rng(0).integers(0, 255, (100, 100, 3), np.uint8))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def link_out(path: Path) -> None:
    scene = path / "scenes" / "tea.png"
    scene.symlink_to(scene.rename(path.with_name("elsewhere.png")))


ITEM = "scene,kind,x,y,angle_deg,radius_m,half_length_m\n"
CUP, FAINT = "kinds/cup/blue.png", np.full((9, 9, 4), (9, 9, 9, 1), np.uint8)
FAULTS: dict[str, tuple[Spoil, str]] = {
    "missing scene": (cell(2, "scene", "supper"), "demonstrations.csv, row 2: scene 'supper' has no picture"),
    "truncated picture": (truncated, "scenes/tea.jpg is truncated or damaged"),
    "huge picture": (huge, "scenes/tea.png has 20000 x 20000 pixels: expected at most 50 megapixels"),
    "one name twice": (picture(draw_table(), "scenes/tea.jpg"), "are one scene 'tea'"),
    "oblong picture": (picture(draw_table()[:80]), "scenes/tea.png has 100 x 80 pixels: expected a square picture"),
    "black picture": (picture(0 * draw_table()), "scenes/tea.png is black where the table should be"),
    "crossing corners": (corners("[[0, 0], [90, 90], [90, 0], [0, 90]]"), "table.yaml: corners cross"),
    "corners of one scene": (corners("{tea: [[0, 0], [90, 0], [90, 90], [0, 90]]}"), "no corners of Mittag"),
    "unknown setting": (
        text("table.yaml", "corner: []"),
        "table.yaml holds 'corner': expected some of side_m, corners",
    ),
    "times run backwards": (cell(5, "t", "0.05"), "row 5: t goes back from 0.2 to 0.05 s in demonstration (breakfast,"),
    "text for a number": (cell(7, "x", "0,5"), "row 7: x is '0,5': expected a number with a decimal point"),
    "changing word": (cell(3, "valid", "true"), "row 3: valid changes within demonstration (breakfast, Ana, 0)"),
    "terminal codes": (cell(3, "user", "\x1b[31mAna"), "row 3: user is '\\x1b[31mAna'"),
    "ends elsewhere": (cell(13, "x", "0.5"), "row 13: demonstration (breakfast, Ana, 0) ends at (0.5, 0.92) m, 0.42 m"),
    "one kind of label": (
        lambda p: edit(p, lambda t: t.assign(valid="true")),
        "row 2: all 16 demonstrations of user Ana are valid: expected both",
    ),
    "few scenes": (
        lambda p: edit(p, lambda t: t[t["scene"].isin(SCENES[:3])]),
        "user Ana has 3 scenes: expected at least 4",
    ),
    "no column": (text("demonstrations.csv", "scene,user,demo,t,x,y\n"), "expected also valid"),
    "other case": (text("Items.csv", ""), "Items.csv is not read: rename it to items.csv"),
    "not UTF-8": (text("demonstrations.csv", "scene,Jürgen"), "is not UTF-8: save it as"),
    "ragged": (
        text("demonstrations.csv", "scene,user,demo,t,x,y,valid\na,b,c,1,1,1,true,9,9\n"),
        "demonstrations.csv, row 2: has 9 cells, the header 7",
    ),
    "link out of the folder": (link_out, "scenes/tea.png is a link out of the folder"),
    "kind without cut-outs": (lambda p: (p / "kinds" / "cup").mkdir(parents=True), "kinds.csv is missing"),
    "cut-out without a row": (lambda p: add_kind(p, ""), "kinds/cup/blue.png has no row in kinds.csv"),
    "terminal codes in a kind": (
        picture(draw_table(), "kinds/\x1b[31m/red.png"),
        "kinds/\\x1b[31m/red.png has no row in kinds.csv",
    ),
    "faint cut-out": (picture(FAINT, CUP), "row 2: kinds/cup/blue.png has an alpha of at most 1 of 255"),
    "item without radius": (text("items.csv", ITEM + "tea,cup,.5,.5,0,0,0"), "row 2: radius_m is 0"),
    "not a folder": (lambda p: p.rename(p.with_name("moved")), "is not a folder"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_a_sentence_that_names_file_and_row(name: str, folder: Path, capfd):
    spoil, sentence = FAULTS[name]
    spoil(folder)
    before = sorted(folder.rglob("*"))
    assert main([str(folder)]) == 1
    said = capfd.readouterr().err
    assert sentence in said, said
    assert "Traceback" not in said and said.replace("\n", "").isprintable()
    assert sorted(folder.rglob("*")) == before, "nothing is half-written"


def test_a_whole_folder_has_no_fault_and_neither_check_nor_a_run_touches_a_report_of_others(folder: Path, capfd):
    (folder / "report").mkdir()
    (folder / "report" / "notes.txt").write_text("mine")
    before = sorted(folder.rglob("*"))
    assert main(["check", str(folder)]) == 0
    assert "4 scenes, 32 demonstrations of Ana, Jürgen; no fault" in capfd.readouterr().out
    with pytest.raises(InputError, match="is not an earlier report"):
        main([str(folder)])
    assert sorted(folder.rglob("*")) == before


def test_all_faults_are_named_at_once_and_alike_rows_only_once(folder: Path, capfd):
    for row in (3, 4, 5):
        change(folder, row, "x", "?")
    change(folder, 9, "valid", "yes")
    text("items.csv", ITEM + "tea,cup,a,.5,0,.1,0")(folder)
    _, faults = read_folder(folder)
    rows = ["demonstrations.csv, row 3", "demonstrations.csv, row 9", "items.csv, row 2"]
    assert [fault.split(":")[0] for fault in faults] == rows and "(2 more like it)" in faults[0]
    assert main([str(folder)]) == 1
    assert f"3 faults in {folder}: correct" in capfd.readouterr().err
    assert main(["check", "a", "b"]) == 2 and capfd.readouterr().err.startswith("error: ")


@pytest.mark.parametrize(("separator", "first"), [(";", "sep=;\n"), ("\t", "")])
def test_semicolons_tabs_and_decimal_commas_of_a_spreadsheet_are_read(folder: Path, separator: str, first: str):
    file = folder / "demonstrations.csv"
    pointed, _ = read_folder(folder)
    edit(folder, lambda table: table.replace({column: r"\." for column in "txy"}, ",", regex=True))
    text = pd.read_csv(file, dtype=str).to_csv(sep=separator, index=False)
    file.write_text(f"\ufeff{first}{text}", encoding="utf-8")  # a byte order mark, as spreadsheets write
    read, faults = read_folder(folder)
    assert not faults and read is not None and pointed is not None
    pd.testing.assert_frame_equal(read.demos, pointed.demos)


def test_names_are_kept_whatever_they_look_like_and_accents_may_be_decomposed(folder: Path):
    """Numbers with zeros, what pandas takes for missing, other cases, files of the system's own."""
    (folder / "scenes" / "tea.png").rename(folder / "scenes" / "010.PNG")
    (folder / "scenes" / "breakfast.png").rename(folder / "scenes" / "thé.png")
    users = {"Ana": "NA", "Jürgen": "null"}
    edit(folder, lambda table: table.replace({"scene": {"tea": "010", "breakfast": "the\u0301"}, "user": users}))
    add_kind(folder)
    (folder / "kinds" / "cup" / "._blue.png").write_bytes(b"of the system")
    write_picture(folder / "empty.png", draw_table())
    (folder / "empty.png").rename(folder / "Empty.PNG")
    made, faults = read_folder(folder)
    assert not faults and made is not None and made.empty is not None and made.users == ["NA", "null"]
    (folder / "Empty.PNG").unlink()
    lines = [f"  {name}: [[5, 5], [95, 5], [95, 95], [5, 95]]\n" for name in made.scenes]
    (folder / "table.yaml").write_text("".join(["corners:\n", *lines]), encoding="utf-8")
    again, faults = read_folder(folder)
    assert not faults and again is not None and again.scenes == ["010", "Mittag", "thé", "夕食"]
