"""Read what a person, or their detector, says stands on each table: capsules, COCO polygons or masks.

Outlines that somebody told take the place of the detector's in their scene.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from pydantic import BaseModel, ValidationError

from pipeline.own import files
from pipeline.own.files import ITEMS, Faults, Settings, normal
from pipeline.own.frame import mapped, on_this_side, outline, to_metres, whole
from pipeline.own.pictures import MAX_PIXELS, decoded
from pipeline.runtime.errors import InputError

COCO, MASKS = "items.json", "masks"
OUTSIDE = 0.02  # share of a picture by which an outline may leave it: people click beside the edge
MIN_ITEM_SHARE = 1e-5  # smallest area of an item in a mask, over the picture's: less is a stray pixel
MAX_ITEM_SHARE = 0.5  # largest area of an item, over the table's: more is the table itself, or another unit


class Told(NamedTuple):
    """An item that somebody outlined."""

    kind: str  # "" where nobody named it
    parts: list[Float[Array, "point 2"]]  # polygons [m on the table]


class _Image(BaseModel):
    id: int
    file_name: str
    width: int | None = None
    height: int | None = None


class _Category(BaseModel):
    id: int
    name: str


class Runs(BaseModel):
    """Hold a mask as COCO's run lengths: numbers of pixels outside and inside in turn, column by column."""

    size: tuple[int, int]  # rows, columns
    counts: list[int] | str  # as text: packed, as pycocotools writes them


class Annotation(BaseModel):
    id: int = 0
    image_id: int
    category_id: int
    segmentation: list[list[float]] | Runs = []
    bbox: tuple[float, float, float, float] | None = None


class Coco(BaseModel):
    """Hold what is read of a COCO file."""

    images: list[_Image]
    annotations: list[Annotation]
    categories: list[_Category] = []

    @property
    def scenes(self) -> dict[int, str]:
        """Return the scene of each image's number."""
        return {image.id: normal(Path(image.file_name).stem) for image in self.images}

    @property
    def kinds(self) -> dict[int, str]:
        """Return the kind of each category's number."""
        return {category.id: normal(category.name) for category in self.categories}


class Views(NamedTuple):
    """Hold how pictures show the table: their sizes [pixels] by scene, and the corners that table.yaml gives."""

    sizes: Mapping[str, tuple[int, int]]
    settings: Settings

    def to_table(self, scene: str, rings: list[Float[Array, "point 2"]]) -> list[Float[Array, "point 2"]]:
        """Return polygons [column, row] of a scene's picture in metres on the table, without those above its horizon.

        Raises InputError for one that crosses the horizon.
        """
        corners = self.settings.corners_of(scene)
        corners = whole(*self.sizes[scene]) if corners is None else corners
        matrix = to_metres(corners, self.settings.size_m)
        return [mapped(matrix, ring) for ring in rings if on_this_side(matrix, ring).any()]

    def is_beside(self, part: Float[Array, "point 2"]) -> bool:
        """Return whether a polygon [m] lies beside the table."""
        return bool(((part.max(0) < 0) | (part.min(0) > self.settings.size_m)).any())


def read_items(path: Path, views: Views, faults: Faults) -> dict[str, list[Told]]:
    """Return the told items of each scene that has any source; a scene told to be empty has none."""
    told: dict[str, list[Told]] = {}
    owner: dict[str, str] = {}
    for name, read in {ITEMS: _from_csv, COCO: _from_coco, MASKS: _from_masks}.items():
        for scene, items in (read(path, views, faults) if (path / name).exists() else {}).items():
            if scene in owner:
                faults.append(f"{name}: items of {scene} stand in {owner[scene]}, too: keep one of them")
            told[scene] = [item for item in items if not all(map(views.is_beside, item.parts))]
            faults += [f"{name}: {fault}" for fault in _faults_of(scene, told[scene], views)]
            if beside := len(items) - len(told[scene]):
                faults.notes.append(f"{name}: {beside} of {len(items)} items of {scene} lie beside the table")
            owner[scene] = name
    return told


def _faults_of(scene: str, items: list[Told], views: Views) -> list[str]:
    """Return a sentence for each item of a scene that is told twice, or is no item for its size."""
    faults, seen = [], []
    for number, (kind, parts) in enumerate(items, 1):
        outlined = kind, [part.tolist() for part in parts]
        area = sum(cv2.contourArea(part.astype(np.float32)) for part in parts)
        if outlined in seen:
            faults.append(f"item {number} of {scene} ({kind}) is told twice: remove one")
        if area > MAX_ITEM_SHARE * views.settings.size_m.prod():
            faults.append(f"item {number} of {scene} ({kind}) covers most of the table: outline the items on it")
        seen.append(outlined)
    return faults


def _from_csv(path: Path, views: Views, faults: Faults) -> dict[str, list[Told]]:
    """Return the capsules of items.csv."""
    items, size, told = files.read_checked(path / ITEMS, views.sizes, faults), views.settings.size_m, {}
    if items is None:
        return {}
    faults.rows(ITEMS, items[items["radius_m"] <= 0], "radius_m is {radius_m:g}: expected metres above 0")
    faults.rows(ITEMS, items[items["half_length_m"] < 0], "half_length_m is {half_length_m:g}: expected metres from 0")
    far = items[((items[["x", "y"]] < 0) | (items[["x", "y"]] > size)).any(axis=1)]
    metres = f"expected metres from 0 to {size[0]:g} and {size[1]:g}"
    faults.rows(ITEMS, far, f"({{x:g}}, {{y:g}}) is not on the table: {metres}")
    for row in items.itertuples():
        turn = np.radians(row.angle_deg)
        arm = np.array([np.cos(turn), np.sin(turn)]) * row.half_length_m
        ends = np.array([row.x, row.y]) + np.stack([-arm, arm])
        told.setdefault(row.scene, []).append(Told(row.kind, [outline(ends, row.radius_m)]))
    return told


def _from_coco(path: Path, views: Views, faults: Faults) -> dict[str, list[Told]]:
    """Return the polygons of items.json; pictures that it lists without an annotation hold no item."""
    try:
        coco = Coco.model_validate_json((path / COCO).read_text(encoding="utf-8-sig"))
    except ValueError as error:
        why = str(error)
        if isinstance(error, ValidationError):
            first = error.errors()[0]
            why = ": ".join([*map(str, first["loc"]), first["msg"]])
        faults.append(f"{COCO} is no COCO file ({why}): expected images, annotations and categories; export it again")
        return {}
    scenes, kinds = coco.scenes, coco.kinds
    for scene in sorted(set(scenes.values()) - views.sizes.keys()):
        faults.append(f"{COCO} lists {scene!r}, which has no picture in scenes/: add it, or correct file_name")
    for image in coco.images:
        size = image.width, image.height
        expected = views.sizes.get(scenes[image.id], size)
        if all(size) and size != expected:
            fault = "{} has {} x {} pixels, its picture {} x {}".format(image.file_name, *size, *expected)
            faults.append(f"{COCO}: {fault}: expected the same; export outlines on the picture in scenes/")
    if len(set(scenes.values())) < len(coco.images):
        faults.append(f"{COCO} lists an image twice, by its id or its name: expected each once; export it again")
    if len(kinds) < len(coco.categories):
        faults.append(f"{COCO} lists a category twice, by its id: expected each once; export it again")
    for kind in kinds.values():
        if not files.is_printable(kind):
            faults.append(f"{COCO}: the category {kind!r} cannot be printed: rename it")
    told: dict[str, list[Told]] = {scene: [] for scene in scenes.values() if scene in views.sizes}
    for one in coco.annotations:
        try:
            if one.image_id not in scenes:
                raise InputError(f"image {one.image_id} is not listed under images: add it")
            if one.category_id not in kinds:
                raise InputError(f"category {one.category_id} is not listed under categories: add it")
            if (scene := scenes[one.image_id]) in told:
                told[scene].append(Told(kinds[one.category_id], _polygons(one, scene, views)))
        except InputError as error:
            faults.append(f"{COCO}, annotation {one.id}: {error}")
    return told


def _polygons(one: Annotation, scene: str, views: Views) -> list[Float[Array, "point 2"]]:
    """Return an annotation's polygons; raise InputError for what is outside, crosses itself or encloses nothing."""
    size, drawn = np.array(views.sizes[scene]), isinstance(one.segmentation, list)
    if isinstance(one.segmentation, Runs) and one.segmentation.size[::-1] != views.sizes[scene]:
        rows, columns = one.segmentation.size
        raise InputError(f"a mask of {columns} x {rows} pixels, its picture {size[0]} x {size[1]}: expected the same")
    rings = rings_of(one)
    for ring in rings:
        if not np.isfinite(ring).all() or (ring < -OUTSIDE * size).any() or (ring > (1 + OUTSIDE) * size).any():
            raise InputError(f"an outline leaves the picture of {size[0]} x {size[1]} pixels: correct it")
        if drawn and crosses_itself(ring):
            raise InputError("a polygon crosses itself: draw it anew")
    if not rings or sum(cv2.contourArea(ring.astype(np.float32)) for ring in rings) < MIN_ITEM_SHARE * size.prod():
        raise InputError("it encloses nothing: outline the item, or remove it")
    return views.to_table(scene, rings)


def rings_of(one: Annotation) -> list[Float[Array, "point 2"]]:
    """Return an annotation's polygons [column, row], its mask's, or its box; raise InputError for any other form."""
    if isinstance(one.segmentation, Runs):
        return _rings_in(_unpacked(one.segmentation))
    rings = [np.reshape(ring, (-1, 2)) for ring in one.segmentation if len(ring) >= 6 and len(ring) % 2 == 0]
    if len(rings) < len(one.segmentation):
        raise InputError("a polygon is no list of x and y of three points or more: correct it")
    if not rings and one.bbox is not None:
        x, y, width, height = one.bbox
        rings = [whole(1, 1) * [width, height] + [x, y]]
    return rings


def _unpacked(runs: Runs) -> UInt8[Array, "row column"]:
    """Return the mask of run lengths; raise InputError if they do not fill it."""
    counts = runs.counts
    if isinstance(counts, str):  # digits of 5 bits from "0", the lowest first; from the fourth on, differences by two
        text, counts, value, shift = counts, list[int](), 0, 0
        for digit in (ord(letter) - ord("0") for letter in text):
            value, shift = value | (digit & 31) << shift, shift + 5
            if not digit & 32:
                value -= (digit & 16) << shift - 4
                counts.append(value + (counts[-2] if len(counts) > 2 else 0))
                value = shift = 0
    rows, columns = runs.size
    if min(rows, columns, *counts, 1) < 0 or not 0 < sum(counts) == rows * columns <= MAX_PIXELS:
        raise InputError(f"a mask whose run lengths do not fill {columns} x {rows} pixels: export it again")
    return np.repeat(np.arange(len(counts), dtype=np.uint8) % 2, counts).reshape(columns, rows).T


def _rings_in(mask: UInt8[Array, "row column"]) -> list[Float[Array, "point 2"]]:
    """Return the outlines [column, row] of a mask's parts, without stray pixels."""
    rings, _ = cv2.findContours(np.ascontiguousarray(mask), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [ring[:, 0] + 0.5 for ring in rings if cv2.contourArea(ring) >= MIN_ITEM_SHARE * mask.size]


def crosses_itself(ring: Float[Array, "point 2"]) -> bool:
    """Return whether two edges of a closed polygon cross; those that only touch do not."""
    start, stop = ring, np.roll(ring, -1, axis=0)

    def turn(a: Array, b: Array, c: Array) -> Array:
        """Return on which side of the line from a to b the point c lies."""
        (ux, uy), (vx, vy) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        return np.sign(ux * vy - uy * vx)

    for a, b in zip(start, stop, strict=True):  # one by one: masks' outlines have thousands of points
        cross = (turn(a, b, start) * turn(a, b, stop) < 0) & (turn(start, stop, a) * turn(start, stop, b) < 0)
        if cross.any():
            return True
    return False


def _from_masks(path: Path, views: Views, faults: Faults) -> dict[str, list[Told]]:
    """Return the items of masks/SCENE.png: 0 is table, each other value an item that nobody named."""
    told: dict[str, list[Told]] = {}
    for file in files.listed(path / MASKS, *files.ENDINGS, *files.UNREAD):
        scene, name = normal(file.stem), f"{MASKS}/{file.name}"
        if file.suffix.lower() != ".png":
            faults.append(f"{name} is not read: expected a png, which keeps values as they are; export it again")
            continue
        try:
            mask = decoded(file, name, cv2.IMREAD_UNCHANGED)
        except InputError as error:
            faults.append(str(error))
            continue
        size = mask.shape[1::-1]
        if scene not in views.sizes:
            faults.append(f"{name}: scene {scene!r} has no picture in scenes/: add it, or correct the name")
        elif mask.ndim != 2:
            faults.append(f"{name} is no grey PNG: expected 0 for the table and another value for each item")
        elif size != views.sizes[scene]:
            theirs = " x ".join(map(str, views.sizes[scene]))
            faults.append(f"{name} has {size[0]} x {size[1]} pixels, its picture {theirs}: expected the same")
        else:
            told[scene] = []
            for value in np.unique(mask[mask > 0]):
                rings = _rings_in((mask == value).astype(np.uint8))
                try:
                    told[scene] += [Told("", views.to_table(scene, rings))] if rings else []
                except InputError as error:
                    faults.append(f"{name}: {error}")
    return told
