"""The parts between a folder and its report: the homography and the similarity, paths, padding, places, scores."""

import shutil
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from pipeline.own import fitting, kinds
from pipeline.own.fitting import UserData
from pipeline.own.folder import Folder, read_folder
from pipeline.own.frame import CANVAS_PX, Frame, rectify
from pipeline.own.results import Results
from pipeline.perception.objects import FEATURES, Object, Objects
from pipeline.world.bezier import P_INIT
from pipeline.world.images import read_image
from tests.factories import RED, WHITE, draw_table
from tests.own.folders import SCENES, add_kind, edit, make_folder, whole, write_picture

CORNERS = np.array([[148, 62], [498, 71], [612, 441], [37, 428]], float)
NOTHING = Objects.of([[]], [0.0], 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    path = make_folder(tmp_path_factory.mktemp("own") / "t")
    add_kind(path)
    return whole(path)


def test_scenes_with_fewer_demonstrations_repeat_them_and_only_real_ones_are_scored(folder: Folder):
    some = folder.demos.drop(folder.demos.query("scene == 'tea' and user == 'Ana'").index[1:3])
    data = UserData.of("Ana", replace(folder, demos=some))
    tea = data.scenes.index("tea")
    assert data.real[tea].tolist() == [True, True, False, False] and data.real.sum() == 14
    assert data.demo[tea].tolist() == ["0", "3", "0", "3"]
    assert np.array_equal(data.controls[tea, 1], data.controls[tea, 3])


@pytest.mark.slow
@pytest.mark.parametrize("by_kind", [True, False])
def test_relevance_is_of_named_kinds_unless_appearance_explains_the_labels_better(by_kind: bool):
    """One item in each of twelve scenes; paths beside it are invalid for one of two kinds, or of two sizes."""
    scenes = np.arange(12)
    kind, large = scenes % 2, scenes // 2 % 2
    if by_kind:
        large[:10] = kind[:10]  # nearly the same in few items
    features = np.zeros((12, len(FEATURES)))
    features[:, [0, 2, 3]] = large[:, None] + np.random.default_rng(0).normal(0, 0.1, (12, 3))
    looks, ends = np.eye(2, dtype=np.float32)[kind], np.full((2, 2), 0.5)
    objects = Objects.of([[Object(ends, 0.05, features[i], looks[i])] for i in scenes], [0.0] * 12, 2)
    heights = np.array([0.45, 0.5, 0.52, 0.56, 0.1, 0.2, 0.8, 0.9])
    controls = np.stack([np.stack([[0.1, y], [0.4, y], [0.6, y], [0.9, y]]) for y in heights])
    valid = (np.abs(heights - 0.5) > 0.1) | ~(kind if by_kind else large).astype(bool)[:, None]
    shape = valid.shape
    data = UserData(
        "Ana", [str(i) for i in scenes], scenes, objects, True, np.broadcast_to(controls, (12, *controls.shape)).copy(),
        valid, np.ones(shape, bool), np.broadcast_to(np.arange(8).astype(str), shape),
    )  # fmt: skip
    model = fitting.fit_on(data, scenes)
    others = replace(objects, features=objects.features[::-1].copy())
    change = model.probability(others, data.paths) - model.probability(objects, data.paths)
    assert (np.abs(change).max() < 1e-6) == by_kind
    assert (((model.probability(objects, data.paths) > 0.5) == valid).mean()) > 0.95


@pytest.mark.slow
def test_doubt_is_that_of_the_segmenters_training_and_not_of_these_pictures(folder: Folder):
    data = UserData.of("Ana", folder)
    data = replace(data, objects=replace(data.objects, doubt=np.full(len(data.scenes), 2, np.float32)))
    model = fitting.fit_on(data, np.arange(len(data.scenes)))
    sure = replace(data.objects, doubt=np.ones(len(data.scenes), np.float32))
    p, p_sure = (np.abs(model.probability(objects, data.paths) - 0.5) for objects in (data.objects, sure))
    assert (p < p_sure).all()


def test_scenes_that_look_alike_are_judged_by_models_that_saw_neither(tmp_path: Path):
    """As of a log with a picture for each demonstration: the camera's noise is all that differs."""
    path = make_folder(tmp_path / "t")
    for scene in SCENES:
        picture = read_image(path / "scenes" / f"{scene}.png").astype(int)
        noisy = (picture + np.random.default_rng(0).integers(-2, 3, picture.shape)).clip(0, 255).astype(np.uint8)
        write_picture(path / "scenes" / f"{scene} again.png", noisy)
    edit(path, lambda table: pd.concat([table, table.assign(scene=table["scene"] + " again")]))
    folder = whole(path)
    assert len(set(folder.arrangements)) == 4
    assert "8 scenes show 4 arrangements" in folder.notes[0]
    data = UserData.of("Ana", folder)
    fold = fitting.folds(data)
    for first, again in ((data.scenes.index(name), data.scenes.index(f"{name} again")) for name in SCENES):
        assert fold[first] == fold[again]
    assert set(fold) == {0, 1, 2, 3}
    shutil.copy(path / "scenes" / "tea.png", path / "scenes" / "夕食.png")
    for scene in ("夕食 again.png", "tea again.png"):
        shutil.copy(path / "scenes" / "tea.png", path / "scenes" / scene)
    folder, faults = read_folder(path)
    assert folder is None and "look alike and show 3 arrangements: expected at least 4" in faults[0]


def test_a_pasted_cutout_lies_where_its_footprint_says(folder: Folder):
    cutout, width = folder.cutouts["cup"][0]
    capsule = kinds.footprint(cutout, width)
    assert capsule.radius == pytest.approx(0.12 * 28.5 / 64, abs=0.002)
    canvas = kinds.paste(np.zeros((CANVAS_PX, CANVAS_PX, 3), np.uint8), cutout, width, np.array([0.3, 0.8]), 0.7)
    rows, columns = np.nonzero(canvas.any(-1))
    place = np.array([columns.mean() + 0.5, CANVAS_PX - rows.mean() - 0.5]) / CANVAS_PX
    np.testing.assert_allclose(kinds.ends_of(folder.frame, capsule, place, 0.7).mean(0), (0.3, 0.8), atol=0.003)


def test_places_are_clear_of_objects_and_path_ends_and_a_full_table_has_none(folder: Folder):
    capsule, rng, objects = kinds.footprint(*folder.cutouts["cup"][0]), np.random.default_rng(0), deepcopy(NOTHING)
    objects.ends[0, 0], objects.radius[0, 0], objects.present[0, 0] = (0.5, 0.5), 0.2, True
    places = [kinds.free_place(rng, folder.frame, objects, 0, capsule, P_INIT[None]) for _ in range(50)]
    centres = np.array([centre for centre, _ in filter(None, places)])
    assert len(centres) == 50 and (np.linalg.norm(centres - 0.5, axis=1) > 0.2 + capsule.radius + 0.014).all()
    assert (np.linalg.norm(centres - P_INIT, axis=1) > 0.12 + capsule.radius - 0.002).all()
    picture = np.zeros((300, 400, 4), np.uint8)
    picture[20:60, 300:380] = 255  # far from the picture's middle
    corner = kinds.footprint(picture, 1.2)
    places = [kinds.free_place(rng, folder.frame, objects, 0, corner, P_INIT[None]) for _ in range(50)]
    for centre, angle in filter(None, places):
        ends = kinds.ends_of(folder.frame, corner, centre, angle)
        assert ((ends > corner.radius) & (ends < 1 - corner.radius)).all()
    objects.radius[0, 0] = 0.7
    assert kinds.free_place(rng, folder.frame, objects, 0, capsule, P_INIT[None]) is None


@pytest.mark.parametrize(
    ("half", "scenes", "state"), [(0.5, 25, "rising"), (1.0, 25, "flat"), (1.0, 6, "open"), (0.1, 5, "open")]
)
def test_whether_more_scenes_would_help_follows_from_the_second_half(half: float, scenes: int, state: str):
    """No change in 6 scenes proves nothing, nor does any in 5."""
    keys = ["share", "arrangement", "demo"]
    judged = pd.MultiIndex.from_product([(1.0, 0.5), range(scenes), range(8)], names=keys).to_frame(index=False)
    right = np.random.default_rng(1).random(len(judged)) < np.where(judged["share"] == 1, 1.0, half)
    judged = judged.assign(scene="all", user="Ana", predictor="clearance", valid=True, p=np.where(right, 0.9, 0.1))
    assert fitting.enough(judged, "clearance")["state"].tolist() == [state]


@pytest.mark.parametrize(
    ("blind", "scenes", "state"), [(0.5, 12, "helps"), (0.5, 5, "open"), (1.0, 5, "open"), (1.0, 25, "nothing")]
)
def test_that_pictures_help_or_do_not_takes_six_scenes_and_enough_answers(blind: float, scenes: int, state: str):
    """The same gain in each scene has no variance, and no gain in few answers may be chance."""
    keys = ["predictor", "arrangement", "demo"]
    names = ("clearance", "nearest_demonstration", "position_only")
    judged = pd.MultiIndex.from_product([names, range(scenes), range(8)], names=keys).to_frame(index=False)
    valid, wrong = judged["demo"] % 2 == 0, (judged["predictor"] != "clearance") & (judged["demo"] >= 8 * blind)
    judged = judged.assign(scene="all", user="Ana", share=1.0, valid=valid, p=np.where(valid != wrong, 0.9, 0.1))
    found = fitting.gain_from_seeing(judged, fitting.scores(judged))
    assert found["state"].tolist() == [state]


@pytest.mark.parametrize(
    ("name", "title"),
    [("Zoë", "Zoë"), ("a$_{2}$\\", r"a\$_{2}\$\\"), ("שלום", "user 2"), ("مريم", "user 2"), ("夕", "user 2")],
)
def test_a_figure_has_names_that_it_can_write_and_numbers_for_others(name: str, title: str):
    results: Any = SimpleNamespace(fitted=["Ana", name])
    assert Results.title(results, name) == title


def test_an_accuracy_without_any_mistake_has_the_exact_interval_of_its_number():
    rows = [("a", "clearance", 1.0, f"s{scene}", valid, float(valid)) for scene in range(4) for valid in (True, False)]
    judged = pd.DataFrame(rows, columns=["user", "predictor", "share", "scene", "valid", "p"])
    judged["arrangement"] = judged["scene"]
    (row,) = fitting.scores(judged).itertuples()
    assert (row.accuracy, row.ci_high) == (1, 1) and row.ci_low == pytest.approx(0.025 ** (1 / 8))


def centre_of_red(image: np.ndarray) -> np.ndarray:
    """The centre [m] of the red pixels."""
    red = (image[..., 0] > 150) & (image[..., 1] < 120)
    rows, columns = np.nonzero(red)
    return np.array([columns.mean() + 0.5, len(image) - rows.mean() - 0.5]) / len(image)


def photograph(table: np.ndarray) -> np.ndarray:
    square = np.array([[0, 0], [100, 0], [100, 100], [0, 100]], np.float32)
    matrix = cv2.getPerspectiveTransform(square - 0.5, CORNERS.astype(np.float32) - 0.5)
    return cv2.warpPerspective(table, matrix, (640, 480), flags=cv2.INTER_LINEAR)


def test_an_oblique_photograph_becomes_the_table_again():
    table = draw_table((0.7, 0.3, 0.05, RED), (0.3, 0.7, 0.06, WHITE))
    image = Frame((1.0, 1.0)).image(rectify(photograph(table), CORNERS))
    assert image.shape == (100, 100, 3)
    np.testing.assert_allclose(centre_of_red(image), (0.7, 0.3), atol=0.004)
    assert np.abs(image.astype(int) - table)[5:-5, 5:-5].mean() < 4


@pytest.mark.parametrize("size", [(2.0, 2.0), (1.2, 0.8), (0.5, 1.0)])
def test_a_table_of_any_shape_lies_in_the_near_left_corner_of_the_models_square(size: tuple[float, float]):
    table = draw_table((0.7, 0.3, 0.05, RED))
    frame, points = Frame(size), np.array([[0.0, 0.0], [0.7, 0.3], [1.0, 1.0]]) * size
    image = frame.image(rectify(photograph(table), CORNERS, size))
    np.testing.assert_allclose(centre_of_red(image), frame.to_model(points)[1], atol=0.006)
    np.testing.assert_allclose(frame.to_table(frame.to_model(points)), points)
    assert frame.to_model(points).max() == 1
