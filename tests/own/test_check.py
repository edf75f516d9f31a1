"""A folder with a fault is refused with a sentence that names file and row, before anything runs or is written."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from pipeline.own.__main__ import main
from pipeline.own.curves import MAX_NOISE_GAIN, choose_degree, fit_demonstrations, noise_gain
from pipeline.own.demonstrations import check_paths
from pipeline.own.files import KEY, Faults, check_settings, normal
from pipeline.own.folder import read_folder
from pipeline.own.frame import Frame
from pipeline.own.pictures import read_cutout, read_picture
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT, bernstein, bezier, curve, random_z_theta
from pipeline.world.bezier_fit import fit_any
from pipeline.world.hand import ARC_POINTS, Hand, simulate
from tests.factories import as_controls, composed, draw_table
from tests.own.folders import SCENES, add_kind, change, edit, make_folder, whole, write_picture

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


def rows(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Spoil:
    return lambda path: edit(path, change)


def several(*spoils: Spoil) -> Spoil:
    return lambda path: [spoil(path) for spoil in spoils]


def keep(*kept: float) -> Spoil:
    """Leave these rows of the first path; 1.5 is halfway between two."""

    def leave(table: pd.DataFrame) -> pd.DataFrame:
        places = {c: np.interp(kept, range(12), table[c][:12].astype(float)) for c in "txy"}
        return pd.concat([table[: len(kept)].assign(**places), table[12:]])

    return rows(leave)


def shift(first: int, last: int, metres: float) -> Spoil:
    """Move rows of the first path in x."""
    return rows(lambda t: t.assign(x=t["x"].astype(float) + metres * t.index.isin(range(first, last))))


def lost(row: int, factor: float) -> Spoil:
    """A sample at the origin, and the time of all scaled."""
    return several(cell(row, "x", "0"), cell(row, "y", "0"), scale_time(factor))


def scale_time(factor: float) -> Spoil:
    return rows(lambda table: table.assign(t=table["t"].astype(float) * factor))


def damaged(path: Path) -> None:
    """Half of the scan is zero, and the end marker is there."""
    (path / "scenes" / "tea.png").unlink()
    noise = np.random.default_rng(0).integers(0, 255, (100, 100, 3), np.uint8)
    write_picture(file := path / "scenes" / "tea.jpg", noise)
    content = file.read_bytes()
    middle = len(content) // 2
    file.write_bytes(content[:middle] + bytes(len(content) - middle - 2) + content[-2:])


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def huge(path: Path) -> None:
    """A PNG of 65 kilobytes that claims 20,000 x 20,000 pixels."""
    header = struct.pack(">II5B", 20_000, 20_000, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(60_000))), (b"IEND", b"")]
    content = b"".join(chunk(*one) for one in chunks)
    (path / "scenes" / "tea.png").write_bytes(b"\x89PNG\r\n\x1a\n" + content)


def link_out(path: Path) -> None:
    scene = path / "scenes" / "tea.png"
    scene.symlink_to(scene.rename(path.with_name("elsewhere.png")))


ITEM = "scene,kind,x,y,angle_deg,radius_m,half_length_m\n"
CUP, FAINT = "kinds/cup/blue.png", np.full((9, 9, 4), (9, 9, 9, 1), np.uint8)
HEADER = "scene,user,demo,t,x,y,valid\n"
FIRST, OTHER = "demonstration (breakfast, Ana, 0)", "demonstration (Mittag, Ana, 0)"
FAULTS: dict[str, tuple[Spoil, str]] = {
    "missing scene": (cell(2, "scene", "supper"), "demonstrations.csv, row 2: scene 'supper' has no picture"),
    "huge picture": (huge, "scenes/tea.png has 20000 x 20000 pixels: expected at most 50 megapixels"),
    "one name twice": (picture(draw_table(), "scenes/tea.jpg"), "are one scene 'tea'"),
    "oblong picture": (picture(draw_table()[:80]), "scenes/tea.png has 100 x 80 pixels: expected a square picture"),
    "preview": (picture(draw_table()[:40, :40]), "scenes/tea.png has 40 x 40 pixels: expected at least 50"),
    "black picture": (picture(0 * draw_table()), "scenes/tea.png is black where the table should be"),
    "crossing corners": (corners("[[0, 0], [90, 90], [90, 0], [0, 90]]"), "table.yaml: corners cross"),
    "corners of one scene": (corners("{tea: [[0, 0], [90, 0], [90, 90], [0, 90]]}"), "no corners of Mittag"),
    "unknown name": (text("table.yaml", "corner: []"), "table.yaml holds 'corner': expected some of size_m, corners"),
    "times run backwards": (cell(5, "t", "0.05"), f"row 5: t goes back from 0.2 to 0.05 s in {FIRST}"),
    "text for a number": (cell(7, "x", "0,5"), "row 7: x is '0,5': expected a number with a decimal point"),
    "changing word": (cell(3, "valid", "true"), f"row 3: valid changes within {FIRST}"),
    "name that nobody sees": (cell(3, "user", "\u200b"), "row 3: user is ''"),
    "terminal codes": (cell(3, "user", "\x1b[31mAna"), "row 3: user is '\\x1b[31mAna'"),
    "four rows": (keep(0, 5, 8, 11), f"row 2: {FIRST} has 4 rows: expected at least"),
    "km": (
        rows(lambda t: t.assign(x="5e-4", y="4e-4")),
        f"row 98: {OTHER} stays within 0 m: expected a path in metres",
    ),
    "crowded rows": (keep(0, 1, 1.5, 2, 11), f"{FIRST} does not determine its path"),
    "drop-out": (lost(7, 0.2), f"row 7: {FIRST} jumps by 0.6 m in 0.02 s"),
    "drop-out of a slow recording": (lost(4, 10), f"row 4: {FIRST} is at (0, 0), where lost samples are logged"),
    "spike of a slow recording": (
        several(shift(5, 6, -0.45), scale_time(10)),
        f"row 7: {FIRST} leaves its path for one row, to (0.210165",
    ),
    "teleport of a slow recording": (several(shift(5, 11, -0.9), scale_time(10)), f"row 7: {FIRST} jumps by 0.8"),
    "two lost rows": (several(shift(5, 7, -0.3), scale_time(0.5)), f"row 9: {FIRST} jumps by 0.37"),
    "first row lost": (several(shift(0, 1, -0.3), scale_time(0.5)), f"row 3: {FIRST} jumps by 0."),
    "picture in another format": (
        text("scenes/new.AVIF", ""),
        "scenes/new.AVIF is not read: expected a name that ends",
    ),
    "thousands": (
        text("demonstrations.csv", HEADER.replace(",", ";") + "tea;Ana;0;1.234,5;0,1;0,1;true\n"),
        "row 2: t is '1.234,5': expected a number with a decimal point, and no other separator",
    ),
    "two recordings under one name": (
        rows(lambda t: t.assign(demo=t["demo"].replace("3", "0"), valid="true").sort_values([*KEY, "t"])),
        f"row 5: {OTHER} jumps by 0.16 m in 0 s",
    ),
    "one recording after another": (
        rows(lambda t: pd.concat([t, t.assign(t="1" + t["t"])]).sort_values(KEY, kind="stable")),
        f"row 14: {OTHER} has a gap of 1.2 m: give each recording a name of its own",
    ),
    "frozen tracker": (
        rows(lambda t: t.assign(**{c: t[c].mask(t.index.isin([4, 5, 6]), t[c].iloc[3]) for c in "xy"})),
        f"row 9: {FIRST} stands still for 4 rows and then jumps by 0.4",
    ),
    "damaged scan": (damaged, "scenes/tea.jpg is truncated or damaged (Corrupt JPEG data"),
    "other ending of the settings": (text("table.yml", ""), "table.yml is not read: rename it to table.yaml"),
    "bidirectional override": (cell(3, "user", "Ana\u202e"), "row 3: user is 'Ana\\u202e'"),
    "half a label": (cell(5, "valid", ""), f"row 5: valid is empty, but not in all rows of {FIRST}"),
    "corners of other sizes": (
        several(corners("[[10, 10], [90, 10], [90, 90], [10, 90]]"), picture(np.full((200, 200, 3), 90, np.uint8))),
        "table.yaml: corners for all pictures, and 夕食 has 100 x 100 pixels; tea has 200 x 200 pixels",
    ),
    "a cut-out in centimetres": (lambda p: add_kind(p, "cup,blue.png,8\n"), "row 2: width_m is 8: expected"),
    "no label at all": (
        rows(lambda t: t.assign(valid="")),
        "row 2: no demonstration has a label: judge them with `python -m pipeline.own record",
    ),
    "alike": (rows(lambda t: t.assign(valid="true")), "row 2: user Ana has valid demonstrations alone: expected both"),
    "few scenes": (rows(lambda t: t[t["scene"].isin(SCENES[:3])]), "user Ana has 3 scenes: expected at least 4"),
    "no column": (text("demonstrations.csv", "scene,user,demo,t,x,y\n"), "expected also valid"),
    "other case": (text("Items.csv", ""), "Items.csv is not read: rename it to items.csv"),
    "not UTF-8": (text("demonstrations.csv", "scene,Jürgen"), "is not UTF-8: save it as"),
    "ragged": (
        text("demonstrations.csv", HEADER + "a,b,c,1,1,1,true,9,9\n"),
        "demonstrations.csv, row 2: has 9 cells, the header 7",
    ),
    "link out of the folder": (link_out, "scenes/tea.png is a link out of the folder"),
    "kind without cut-outs": (lambda p: (p / "kinds" / "cup").mkdir(parents=True), "kinds.csv is missing"),
    "cut-out without a row": (lambda p: add_kind(p, ""), "kinds/cup/blue.png has no row in kinds.csv"),
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
    assert sorted(folder.rglob("*")) == sorted([*before, folder / "check.png"])


def test_demonstrations_without_a_label_are_left_out_and_counted(folder: Path, capfd):
    edit(folder, lambda table: table.assign(valid=table["valid"].where(table["demo"].isin(["1", "3"]), "")))
    assert main(["check", str(folder)]) == 0
    said = capfd.readouterr().out
    assert "demonstrations without a label, left out: 16" in said and "4 scenes, 16 demonstrations" in said


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


def test_a_command_to_type_names_the_folder_as_a_shell_takes_it(tmp_path: Path):
    folder = make_folder(tmp_path / "{my} table")
    (folder / "demonstrations.csv").unlink()
    assert f"`python -m pipeline.own record '{folder}'`" in read_folder(folder)[1][0]


@pytest.mark.parametrize(("separator", "first"), [(";", "sep=;\n"), (";", "sep=;;;;;;;\n"), ("\t", "")])
def test_semicolons_tabs_and_decimal_commas_of_a_spreadsheet_are_read(folder: Path, separator: str, first: str):
    file = folder / "demonstrations.csv"
    pointed = whole(folder).demos
    edit(folder, lambda table: table.replace({column: r"\." for column in "txy"}, ",", regex=True))
    text = pd.read_csv(file, dtype=str).to_csv(sep=separator, index=False)
    file.write_text(f"\ufeff{first}{text}", encoding="utf-8")  # a byte order mark, as spreadsheets write
    pd.testing.assert_frame_equal(whole(folder).demos, pointed)


def test_names_are_kept_whatever_they_look_like_and_accents_may_be_decomposed(folder: Path):
    """Numbers with zeros, what pandas takes for missing, joiners, other cases, files of the system's own."""
    (folder / "scenes" / "tea.png").rename(folder / "scenes" / "010.PNG")
    (folder / "scenes" / "breakfast.png").rename(folder / "scenes" / "thé.png")
    users = {"Ana": "NA", "Jürgen": "می\u200cخواهم"}
    edit(folder, lambda table: table.replace({"scene": {"tea": "010", "breakfast": "the\u0301"}, "user": users}))
    add_kind(folder)
    (folder / "kinds" / "cup" / "._blue.png").write_bytes(b"of the system")
    (folder / "kinds" / ".Trashes").mkdir()
    write_picture(folder / "empty.png", draw_table())
    (folder / "empty.png").rename(folder / "Empty.PNG")
    made = whole(folder)
    assert made.empty is not None and made.users == ["NA", users["Jürgen"]]
    (folder / "Empty.PNG").unlink()
    lines = [f"  {name}: [[5, 5], [95, 5], [95, 95], [5, 95]]\n" for name in made.scenes]
    (folder / "table.yaml").write_text("".join(["corners:\n", *lines]), encoding="utf-8")
    assert whole(folder).scenes == ["010", "Mittag", "thé", "夕食"]


def test_names_of_files_are_utf_8_whatever_the_locale():
    for name in ("夕食", "thé", "\ud800"):
        assert normal(name) == name
    for encoding in ("ascii", "utf-8"):  # of the locale
        assert normal("the\u0301".encode().decode(encoding, "surrogateescape")) == "thé"


def test_a_picture_whose_profile_or_date_is_odd_is_read(tmp_path: Path):
    """libpng warns of both: a colour profile that is none, and a time that does not exist."""
    write_picture(file := tmp_path / "a.png", draw_table())
    content = file.read_bytes()
    odd = chunk(b"iCCP", b"x\0\0" + zlib.compress(bytes(200))) + chunk(b"tIME", bytes(7))
    file.write_bytes(content[:33] + odd + content[33:])
    np.testing.assert_array_equal(read_picture(file, "a.png"), draw_table())
    write_picture(file := tmp_path / "b.jpg", draw_table())
    plain, content = read_picture(file, "b.jpg"), file.read_bytes()
    file.write_bytes(content[:-2] + b"\x12\x34\x56" + content[-2:])  # as some cameras pad
    np.testing.assert_array_equal(read_picture(file, "b.jpg"), plain)


def test_sixteen_bits_are_scaled_alike_in_all_pictures_or_refused(tmp_path: Path):
    def picture(white: int) -> Path:
        grey = np.linspace(0, white, 100 * 100).reshape(100, 100).astype(np.uint16)
        (tmp_path / "a.png").write_bytes(cv2.imencode(".png", grey)[1].tobytes())
        return tmp_path / "a.png"

    assert [read_picture(picture(white), "a.png").max() for white in (65535, 32768, 16448)] == [255, 128, 64]
    for bits in (10, 12, 14):
        with pytest.raises(InputError, match=f"a.png has 16 bits.*{2**bits - 1:,}: expected 65,535 for white"):
            read_picture(picture(2**bits - 1), "a.png")
    cutout = np.full((60, 60, 4), [4095, 4095, 4095, 65535], np.uint16)  # alpha is full, colours have 12 bits
    cutout[:10, :, 3] = 0
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", cutout)[1].tobytes())
    with pytest.raises(InputError, match=r"a.png has 16 bits.*4,095: expected 65,535 for white"):
        read_cutout(tmp_path / "a.png", "a.png")


MOVEMENTS = [
    {}, {"rate_hz": 1000}, {"rate_hz": 5}, {"rate_hz": 20, "speed_m_s": 2.0}, {"speed_m_s": 0.05},
    {"tremor_m": 0.01, "rate_hz": 200, "jitter_s": 0.01}, {"drift_m": 0.01}, {"jitter_s": 0.02},
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("extreme", MOVEMENTS, ids=str)
@pytest.mark.parametrize("decimals", [9, 2])
def test_what_a_hand_does_is_no_fault(extreme: dict, decimals: int):
    hand, rng, parts = Hand.of({**composed().demos.hand, **extreme}), np.random.default_rng(0), []
    for demo, z_theta in enumerate(random_z_theta(rng, 12)):
        rows = pd.DataFrame(simulate(rng, curve(z_theta, ARC_POINTS), hand)[:, :3].round(decimals), columns=list("txy"))
        parts.append(rows.assign(scene="a", user="b", demo=f"{demo:03}", valid=True, name=str(demo)))
    samples, faults = pd.concat(parts, ignore_index=True), Faults()
    check_paths(samples, check_settings({}), faults)
    fit_demonstrations(samples, Frame((1.0, 1.0)), faults)
    assert not faults


@pytest.mark.slow
@pytest.mark.parametrize("rows", [5, 6, 9])
def test_a_path_that_passes_is_determined_by_its_samples(rows: int):
    """Irregular exact rows give back the path, or are refused."""
    rng = np.random.default_rng(rows)
    z_theta, misses = random_z_theta(rng, 200), []
    for z in z_theta:
        u = np.sort([0, *rng.uniform(0, 1, rows - 2), 1])
        points = bernstein(u, 2) @ as_controls(z)
        controls, at, _ = fit_any(points, 2)
        if noise_gain(controls, at) <= MAX_NOISE_GAIN:
            misses.append(np.linalg.norm(bezier(controls, 33)[:, None] - curve(z, 999), axis=-1).min(1).max())
    assert len(misses) > 20 and np.quantile(misses, 0.95) < 0.02


@pytest.mark.slow
def test_paths_of_many_samples_that_the_curves_cannot_follow_are_poor_and_no_fault():
    """The degree is that of most paths. A curve of it near an S of a higher degree may fold, which no sample tells."""
    s_shape = np.array([[0.922, 0.488], [0.725, 0.697], [0.532, 0.231], [0.334, 0.675], [0.139, 0.44]])
    rng, t = np.random.default_rng(0), np.linspace(0, 1, 106)
    drawn = s_shape + rng.normal(0, 0.02, (8, 5, 2))
    others = [np.array([[0.1, 0.1], [0.9, 0.1 + a], [0.1, 0.8], [0.9, 0.9 - a]]) for a in rng.uniform(0, 0.2, 24)]
    shapes = [*others, *drawn]
    slowly = 10 * t**3 - 15 * t**4 + 6 * t**5  # as a hand starts and ends
    paths = [bernstein(slowly, len(controls) - 1) @ controls for controls in shapes]
    rows = [pd.DataFrame(path, columns=["x", "y"]).assign(demo=f"{i:02}") for i, path in enumerate(paths)]
    samples = pd.concat(rows, ignore_index=True).assign(scene="a", user="b", valid=True, name="a, b")
    demos, degrees = fit_demonstrations(samples, Frame((1.0, 1.0)), faults := Faults())
    assert degrees.loc[degrees["chosen"], "degree"].item() == 3 and demos["poor"].tolist() == [False] * 24 + [True] * 8
    assert not faults and (demos["noise_gain"] > MAX_NOISE_GAIN).any()


@pytest.mark.slow
def test_a_parabola_is_enough_for_parabolas_and_not_for_s_shapes():
    rng = np.random.default_rng(0)
    hand = Hand.of({**composed().demos.hand, "drift_m": 0.0})
    left_out = {}
    for inner in (1, 3):
        controls = [np.concatenate([[P_INIT], rng.uniform(-0.2, 1.2, (inner, 2)), [P_F]]) for _ in range(12)]
        table = choose_degree([simulate(rng, bezier(one, ARC_POINTS), hand)[:, 1:3] for one in controls], 1.0)
        left_out[inner] = table.set_index("degree")["left_out_m"]
        assert table["chosen"].sum() == 1 and (inner == 1 or table.loc[table["chosen"], "degree"].item() >= 4)
    assert left_out[1][2] < 1.2 * left_out[1].min() and left_out[3][2] > 2 * left_out[3].min()
