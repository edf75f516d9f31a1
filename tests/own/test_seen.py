"""What stands on the table: told, against the empty table, or by the picture alone."""

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.own.folder import read_folder
from pipeline.own.frame import Frame
from pipeline.own.items import crosses_itself
from pipeline.own.recorder.outlines import Item, from_coco, propose, replaced
from pipeline.own.seen import ALONE, EMPTY, STACK, TOLD, look
from pipeline.perception.empty import empty_table
from tests.factories import RED, WHITE, draw_table
from tests.own.folders import SCENES, edit, make_folder, whole, write_picture

SQUARE = [60.0, 60.0, 80.0, 60.0, 80.0, 80.0, 60.0, 80.0]  # in pictures of 100 x 100 pixels

CAPSULES = "scene,kind,x,y,angle_deg,radius_m,half_length_m\n"


def coco(*annotations: dict, scene: str = SCENES[0], **image: int) -> str:
    whole = {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [SQUARE]}
    return json.dumps({
        "images": [{"id": 1, "file_name": f"{scene}.png"} | image],
        "categories": [{"id": 1, "name": "cup"}, {"id": 2, "name": "pläte"}],
        "annotations": [whole | one for one in annotations],
    })  # fmt: skip


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_folder(tmp_path)


def test_told_outlines_are_what_models_see_kinds_included(path: Path):
    (path / "items.json").write_text(coco({}, {"category_id": 2, "segmentation": [[5, 5, 25, 5, 25, 9]]}))
    folder = whole(path)
    seen, told = folder.seen, folder.scenes.index(SCENES[0])
    assert [way for i, way in enumerate(seen.ways) if i != told] == [ALONE] * 3 and seen.ways[told] == TOLD
    objects = seen.objects
    assert seen.names == ["cup", "pläte"] and objects.present[told].sum() == 2 and objects.doubt[told] == 0
    np.testing.assert_allclose(objects.ends[told, 0].mean(0), (0.7, 0.3), atol=0.006)  # the larger one
    np.testing.assert_allclose(objects.kinds[told, :2], [[1, 0], [0, 1]])


def test_nothing_is_seen_beyond_the_edge_of_a_table_that_is_not_square(path: Path):
    """A plate that the far edge cuts off colours what continues the picture to the models' square."""
    (path / "table.yaml").write_text("size_m: [1.0, 0.6]")
    for i, scene in enumerate(SCENES):
        picture = draw_table((0.7, 0.2, 0.05, RED), (0.3 + 0.1 * i, 0.58, 0.1, RED), seed=i)
        write_picture(path / "scenes" / f"{scene}.png", picture[40:])
    edit(path, lambda table: table.assign(y=table["y"].astype(float) * 0.6))
    seen = whole(path).seen
    assert all(one.ends[:, 1].max() < 0.6 for objects in seen.found for one in objects)
    assert all(len(objects) == 2 for objects in seen.found)


def test_a_mask_and_a_capsule_and_a_polygon_tell_the_same(path: Path):
    mask = np.zeros((100, 100), np.uint16)
    mask[60:80, 60:80] = 300
    (path / "masks").mkdir()
    (path / "masks" / f"{SCENES[1]}.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    (path / "items.json").write_text(coco({}))
    (path / "items.csv").write_text(CAPSULES + f"{SCENES[2]},cup,.7,.3,0,.11284,0\n")
    folder = whole(path)
    objects = folder.seen.objects
    for i in map(folder.scenes.index, SCENES[:3]):
        np.testing.assert_allclose(objects.ends[i, 0].mean(0), (0.7, 0.3), atol=0.01)
        assert abs(objects.radius[i, 0] - 0.113) < 0.01


def packed(counts: list[int]) -> str:
    """Pack run lengths as `rleToString` of pycocotools."""
    text = ""
    for i, count in enumerate(counts):
        left, more = count - (counts[i - 2] if i > 2 else 0), True
        while more:
            digit, left = left & 31, left >> 5
            more = left != -1 if digit & 16 else left != 0
            text += chr(digit + 32 * more + 48)
    return text


@pytest.mark.parametrize("write", [list, packed])
def test_run_lengths_tell_what_their_mask_shows(path: Path, write: Callable):
    mask = np.zeros((100, 100), int)
    mask[60:80, 60:80] = mask[5:95, 62] = 1
    flat = mask.ravel(order="F")
    counts = np.diff(np.flatnonzero(np.diff(flat)) + 1, prepend=0, append=flat.size).tolist()
    (path / "items.json").write_text(coco({"segmentation": {"counts": write(counts), "size": [100, 100]}}))
    (path / "masks").mkdir()
    (path / "masks" / f"{SCENES[1]}.png").write_bytes(cv2.imencode(".png", mask.astype(np.uint8))[1].tobytes())
    told = whole(path).told
    np.testing.assert_array_equal(told[SCENES[0]][0].parts[0], told[SCENES[1]][0].parts[0])


def test_a_scene_told_to_be_empty_holds_nothing(path: Path):
    (path / "items.json").write_text(coco())
    folder = whole(path)
    assert not folder.seen.objects.present[folder.scenes.index(SCENES[0])].any()


@pytest.mark.parametrize(
    ("text", "fault"),
    {
        "runs too short": (coco({"segmentation": {"counts": "abc", "size": [100, 100]}}), "do not fill 100 x 100"),
        "a mask's size": (coco({"segmentation": {"counts": [0, 25], "size": [5, 5]}}), "5 x 5 pixels, its picture 100"),
        "outside": (coco({"segmentation": [[60, 60, 180, 60, 80, 80]]}), "leaves the picture of 100 x 100"),
        "crossing": (coco({"segmentation": [[10, 10, 50, 50, 50, 10, 10, 50]]}), "crosses itself"),
        "unknown kind": (coco({"category_id": 7}), "category 7 is not listed"),
        "unknown scene": (coco({}, scene="lunch"), "lists 'lunch', which has no picture"),
        "two numbers": (coco({"segmentation": [[1, 2]]}), "three points or more"),
        "no area": (coco({"segmentation": [[10, 10, 20, 20, 30, 30]]}), "encloses nothing"),
        "told twice": (coco({}, {"id": 2}), "item 2 of breakfast (cup) is told twice"),
        "the whole table": (coco({"segmentation": [[0, 0, 99, 0, 99, 99, 0, 99]]}), "covers most of the table"),
        "another size": (coco({}, width=50, height=50), "breakfast.png has 50 x 50 pixels, its picture 100 x 100"),
        "an image twice": (
            coco({}).replace('"images": [', '"images": [{"id": 9, "file_name": "a/breakfast.png"}, '),
            "lists an image twice",
        ),
        "a category twice": (
            coco({}).replace('"categories": [', '"categories": [{"id": 1, "name": "pan"}, '),
            "lists a category twice",
        ),
        "no category": (coco({}).replace('"category_id"', '"kind"'), "annotations: 0: category_id: Field required"),
        "no json": ("{", "is no COCO file"),
        "a list": ("[]", "is no COCO file"),
    }.values(),
)
def test_a_wrong_outline_is_a_fault_with_what_to_do(path: Path, text: str, fault: str):
    (path / "items.json").write_text(text)
    folder, faults = read_folder(path)
    assert folder is None and len(faults) == 1 and fault in faults[0], faults


def test_items_beside_the_table_are_left_out_and_counted(path: Path):
    """What lies behind a table that is not square lies within the models' square."""
    (path / "table.yaml").write_text("corners: [[10, 40], [90, 40], [90, 90], [10, 90]]\nsize_m: [1, 0.6]")
    edit(path, lambda table: table.assign(y=table["y"].astype(float) * 0.6))
    (path / "items.json").write_text(coco({}, {"segmentation": [[50, 22, 58, 22, 58, 28]]}))
    folder, faults = read_folder(path)
    assert folder is not None and faults.notes == ["items.json: 1 of 2 items of breakfast lie beside the table"]
    assert folder.seen.objects.present[folder.scenes.index(SCENES[0])].sum() == 1


def test_items_above_the_horizon_of_the_table_lie_beside_it_and_one_across_it_is_a_fault(path: Path):
    """Its sides meet at row 6 of the picture."""
    (path / "table.yaml").write_text("corners: [[25, 50], [75, 50], [100, 94], [0, 94]]\nsize_m: [1, 1]")
    above = {"segmentation": [[10, 0, 90, 0, 90, 5]]}
    (path / "items.json").write_text(coco({}, above, above))
    folder, faults = read_folder(path)
    assert folder is not None and faults.notes == ["items.json: 2 of 3 items of breakfast lie beside the table"]
    (path / "items.json").write_text(coco({"segmentation": [[40, 2, 48, 2, 48, 50]]}))
    assert ["above the horizon" in fault for fault in read_folder(path)[1]] == [True]


def test_outlines_of_thousands_of_points_take_little_memory():
    turns = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    tracemalloc.start()
    assert not crosses_itself(np.stack([np.cos(turns), np.sin(turns)], -1))
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


def test_a_damaged_mask_is_a_fault(path: Path):
    (path / "masks").mkdir()
    content = cv2.imencode(".png", np.random.default_rng(0).integers(0, 3, (100, 100), np.uint8))[1].tobytes()
    (path / "masks" / f"{SCENES[1]}.png").write_bytes(content[: len(content) // 2])
    _, faults = read_folder(path)
    assert len(faults) == 1 and f"masks/{SCENES[1]}.png is truncated or damaged" in faults[0]
    (path / "masks" / f"{SCENES[1]}.png").rename(path / "masks" / f"{SCENES[1]}.jpg")
    assert f"masks/{SCENES[1]}.jpg is not read: expected a png" in read_folder(path)[1][0]


def test_one_scene_told_twice_is_a_fault(path: Path):
    (path / "items.json").write_text(coco({}))
    (path / "items.csv").write_text(CAPSULES + f"{SCENES[0]},cup,.7,.3,0,.1,0\n")
    assert "items.json: items of breakfast stand in items.csv, too" in "".join(read_folder(path)[1])


def arrangements(n: int) -> np.ndarray:
    """Draw pictures of one patterned table with two discs that move."""
    rng = np.random.default_rng(0)
    grain = np.kron(rng.integers(-25, 25, (20, 20, 1)), np.ones((20, 20, 1)))
    pictures = []
    for _ in range(n):
        x, y = rng.uniform(0.2, 0.8, (2, 2))
        table = draw_table((x[0], y[0], 0.06, RED), (x[1], y[1], 0.07, (0.2, 0.3, 0.8)), seed=1)
        plain = draw_table(seed=1)
        item = cv2.resize((np.abs(table.astype(int) - plain).max(-1) > 20).astype(np.uint8), (400, 400)) > 0
        large = cv2.resize(table, (400, 400)).astype(float)
        pictures.append(np.clip(np.where(item[..., None], large, large + grain), 0, 255).astype(np.uint8))
    return np.stack(pictures)


def test_the_empty_table_comes_from_arrangements_that_move(tmp_path: Path):
    pictures = arrangements(12)
    empty = empty_table(pictures)
    assert empty is not None and empty.is_useful and not empty.moved and not empty.relit
    bare = arrangements(40)
    np.testing.assert_allclose(empty.canvas[::8, ::8], np.median(bare, axis=0)[::8, ::8], atol=12)


def test_a_moved_camera_and_another_light_are_named(tmp_path: Path):
    pictures = arrangements(12)
    pictures[3] = np.roll(pictures[3], 30, axis=1)
    pictures[7] = np.clip(pictures[7] * 0.3, 0, 255)
    empty = empty_table(pictures)
    assert empty is not None and empty.moved == [3] and empty.relit == [7]


@pytest.mark.slow
def test_pictures_that_the_empty_table_does_not_fit_are_read_alone_and_what_never_moves_is_said(path: Path):
    pictures = arrangements(12)
    for picture in pictures:
        cv2.circle(picture, (60, 60), 24, (200, 60, 40), -1)
    pictures[7] = np.clip(pictures[7] * 0.3, 0, 255)
    for i, picture in enumerate(pictures):
        write_picture(path / "scenes" / f"{i:02}.png", picture)
    folder = whole(path)
    ways = dict(zip(folder.scenes, folder.seen.ways, strict=True))
    assert ways["07"] == ALONE and ways["06"] == STACK
    said = " ".join(folder.how_seen)
    assert "The light changed in 07" in said and "items that never move are taken for the table" in said


def test_an_empty_table_that_is_another_table_is_not_used(path: Path):
    write_picture(path / "empty.png", draw_table() // 2)
    folder = whole(path)
    assert set(folder.seen.ways) == {ALONE} and "The empty table does not fit in" in folder.how_seen[1]


def test_pictures_of_several_tables_are_read_alone_and_what_is_unsure_is_named(path: Path):
    for i in range(8):
        random = np.random.default_rng(i).integers(0, 255, (12, 12, 3)).astype(np.uint8)
        write_picture(path / "scenes" / f"{i}.png", cv2.resize(random, (100, 100), interpolation=cv2.INTER_CUBIC))
    said = whole(path).how_seen
    assert "do not show one table from one place" in said[1] and "camera moved" not in " ".join(said)
    assert "less sure of 0, 1, 2, 3, 4, 5, 6, 7 than in training" in " ".join(said)


def test_fewer_than_five_arrangements_give_no_empty_table_however_many_pictures_show_them(path: Path):
    pictures = arrangements(4)
    assert empty_table(pictures) is None
    for i, name in enumerate([*SCENES, "5", "6", "7", "8"]):  # five of one
        write_picture(path / "scenes" / f"{name}.png", pictures[i % 4 if i < 4 else 0])
    assert whole(path).from_pictures is None


@pytest.mark.parametrize(("turn_deg", "zoom"), [(2, 1), (0, 1.03)])
def test_where_the_camera_turned_or_came_nearer_the_picture_is_read_alone(turn_deg: float, zoom: float):
    pictures, frame = arrangements(2), Frame((1.0, 1.0))
    matrix = cv2.getRotationMatrix2D((200, 200), turn_deg, zoom)
    pictures[1] = cv2.warpAffine(pictures[1], matrix, (400, 400), borderMode=cv2.BORDER_REPLICATE)
    bare = np.median(arrangements(40), axis=0).astype(np.uint8)
    seen = look(np.stack([frame.image(picture) for picture in pictures]), frame, {}, frame.image(bare), EMPTY)
    assert seen.ways == [EMPTY, ALONE]


def test_outlines_survive_their_file():
    items = [Item("cup", [[1.5, 2.0], [30.0, 2.0], [30.0, 4.0]]), Item("", [[5.0, 5.0], [9.0, 5.0], [9.0, 9.0]])]
    assert from_coco(replaced({"images": [], "annotations": []}, "夕食.png", (100, 100), items)) == {"夕食": items}
    boxes = json.loads(coco({"segmentation": [], "bbox": [1, 2, 30, 40]}))
    assert from_coco(boxes)[SCENES[0]] == [Item("cup", [[1, 2], [31, 2], [31, 42], [1, 42]])]


def test_what_another_tool_wrote_stays_where_the_recorder_changes_nothing():
    """Two parts are one item; a mask, a picture that is not here and a tool's own fields are kept."""
    two, mask = [SQUARE, [5, 5, 25, 5, 25, 9]], {"counts": [0, 2500, 7500], "size": [100, 100]}
    theirs = json.loads(coco({"segmentation": two, "attributes": {"worn": True}}, {"id": 7, "segmentation": mask}))
    theirs |= {"info": {"year": 2026}, "images": [*theirs["images"], {"id": 9, "file_name": "elsewhere.png"}]}
    shown, added = from_coco(theirs)[SCENES[0]], Item("jug", [[1.0, 2.0], [30.0, 2.0], [30.0, 4.0]])
    elsewhere = replaced(theirs, "lunch.png", (100, 100), [added])
    assert elsewhere["annotations"][:2] == theirs["annotations"] and elsewhere["info"] == theirs["info"]
    here = replaced(elsewhere, f"{SCENES[0]}.png", (100, 100), [*shown[1:], added])  # without a part of the first item
    assert [one["id"] for one in here["annotations"]] == [7, 8, 9, 10]
    assert here["annotations"][0] == theirs["annotations"][1]
    assert replaced(here, f"{SCENES[0]}.png", (9, 9), [])["images"][0]["width"] == 9
    assert (
        replaced(replaced(here, "lunch.png", (100, 100), None), f"{SCENES[0]}.png", (9, 9), None)["annotations"] == []
    )


@pytest.mark.parametrize("edge", [(0.7, 0.3), (0.7, 0.36)])
def test_a_click_proposes_the_items_outline(edge: tuple[float, float]):
    picture = cv2.resize(draw_table((0.7, 0.3, 0.06, RED), (0.3, 0.7, 0.06, WHITE)), (500, 500))
    point, to = (np.array([x, 1 - y]) * 500 for x, y in ((0.7, 0.3), edge))
    ring = np.array(propose(picture, point.tolist(), to.tolist()), np.float32)
    centre, radius = cv2.minEnclosingCircle(ring)
    np.testing.assert_allclose(centre, (350, 350), atol=5)
    assert 25 < radius < 36
    assert len(propose(picture, point.tolist(), [-5000.0, 9000.0])) > 2
