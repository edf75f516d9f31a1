"""Outlines of items: proposed from a click, found by the detector, and stored as COCO polygons in items.json."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own.files import ITEMS, listed, normal, read_csv
from pipeline.own.items import MASKS, Coco, rings_of

WORKING_PX = 320  # side to which a picture is scaled for a proposal: GrabCut takes .1 s there
REACH = 0.4  # radius of the search about a click, where nobody dragged to the item's edge, over the longer side
SURE, LIKELY = 0.075, 0.25  # radii that are the item's, and probably so, over the search's
REACH_OVER_DRAG, MIN_REACH = 1.6, 0.02  # a shorter drag is a click
ROUNDS = 4  # of GrabCut
COARSENESS = 0.006  # of an outline, over its length
LEAST = 0.0004  # area of a proposal, over the picture's: less is noise


class Item(NamedTuple):
    """An item's outline in pixels of its picture, and its kind, "" where nobody named it."""

    kind: str
    points: list[list[float]]


def propose(picture: UInt8[Array, "row column 3"], point: Sequence[float], edge: Sequence[float]) -> list[list[float]]:
    """Return the outline [column, row] of what is at a point of a picture, by GrabCut (Rother et al., 2004).

    edge: a place at the item's edge, if the person dragged there; else the point again.
    """
    scale = WORKING_PX / max(picture.shape[:2])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    centre = tuple(int(np.clip(round(x * scale), 0, n - 1)) for x, n in zip(point, small.shape[1::-1], strict=True))
    away = REACH_OVER_DRAG * float(np.hypot(*np.subtract(edge, point))) / max(picture.shape[:2])
    reach = REACH if away < MIN_REACH else min(away, 1.0)  # people drag out of the picture, too
    mask = np.full(small.shape[:2], cv2.GC_BGD, np.uint8)
    for radius, label in ((1, cv2.GC_PR_BGD), (LIKELY, cv2.GC_PR_FGD), (SURE, cv2.GC_FGD)):
        cv2.circle(mask, centre, max(1, round(radius * reach * WORKING_PX)), label, -1)
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    colours = np.ascontiguousarray(small[..., ::-1])
    cv2.setRNGSeed(0)
    whole = (0, 0, 1, 1)  # not read
    cv2.grabCut(colours, mask, whole, background, foreground, ROUNDS, cv2.GC_INIT_WITH_MASK)
    inside = np.isin(mask, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    inside = cv2.morphologyEx(inside, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    regions = cv2.connectedComponents(inside)[1]
    inside = ((regions == regions[centre[::-1]]) & (inside > 0)).astype(np.uint8)
    if inside.mean() < LEAST:
        inside = cv2.circle(np.zeros_like(mask), centre, round(LIKELY * reach * WORKING_PX), 1, -1)
    rings, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    ring = max(rings, key=cv2.contourArea)
    ring = cv2.approxPolyDP(ring, COARSENESS * cv2.arcLength(ring, True), True)[:, 0]
    return np.round((ring + 0.5) / scale, 1).tolist()


def told_elsewhere(folder: Path, scene: str) -> str:
    """Return the file that tells a scene's items if it is not the recorder's own, else ""."""
    if (folder / ITEMS).is_file() and scene in read_csv(folder / ITEMS, ["scene"])["scene"].tolist():
        return ITEMS
    masks = (f"{MASKS}/{file.name}" for file in listed(folder / MASKS, ".png") if normal(file.stem) == scene)
    return next(masks, "")


def replaced(coco: dict[str, Any], file: str, size: tuple[int, int], items: Sequence[Item] | None) -> dict[str, Any]:
    """Return a COCO file's content with the items of one picture replaced; all else that it holds stays as it is.

    file, size: the picture's name, width and height. items: None leaves the picture out; an annotation stays if all of
    its outlines are among them. Raise ValueError, KeyError or InputError if `coco` is no COCO file.
    """
    read, scene = Coco.model_validate(coco), normal(Path(file).stem)
    images, annotations, categories = ([*coco.get(name, [])] for name in ("images", "annotations", "categories"))
    numbers = [number for number, name in read.scenes.items() if name == scene]
    if items is None:
        images = [raw for raw, image in zip(images, read.images, strict=True) if image.id not in numbers]
    else:
        if not numbers:
            numbers = [1 + max(read.scenes, default=0)]
            images.append({"id": numbers[0], "file_name": file})
        shape = {"width": size[0], "height": size[1]}
        images = [raw | shape if raw["id"] in numbers else raw for raw in images]
    added, kept = list(items or []), []
    for raw, one in zip(annotations, read.annotations, strict=True):
        if one.image_id in numbers:
            outlines = [Item(read.kinds[one.category_id], ring.tolist()) for ring in rings_of(one)]
            if not outlines or any(item not in added for item in outlines):
                continue
            added = [item for item in added if item not in outlines]
        kept.append(raw)
    known = {name: number for number, name in read.kinds.items()}
    highest = max(read.kinds, default=0)  # of two categories of one name, `known` has one
    for number, item in enumerate(added, 1 + max((one.id for one in read.annotations), default=0)):
        if item.kind not in known:
            known[item.kind] = highest = highest + 1
            categories.append({"id": known[item.kind], "name": item.kind})
        ring = np.array(item.points)
        low, high = ring.min(0), ring.max(0)
        kept.append({
            "id": number,
            "image_id": numbers[0],
            "category_id": known[item.kind],
            "segmentation": [np.round(ring, 1).ravel().tolist()],
            "bbox": np.round([*low, *(high - low)], 1).tolist(),
            "area": float(cv2.contourArea(ring.astype(np.float32))),
            "iscrowd": 0,
        })  # fmt: skip
    used = {raw["category_id"] for raw in kept}
    categories = [category for category in categories if category["name"] or category["id"] in used]
    return {**coco, "images": images, "annotations": kept, "categories": categories}


def from_coco(content: dict[str, Any]) -> dict[str, list[Item]]:
    """Return the items of a COCO file's content by scene; raise ValueError, KeyError or InputError if it is none."""
    coco = Coco.model_validate(content)
    items: dict[str, list[Item]] = {scene: [] for scene in coco.scenes.values()}
    for one in coco.annotations:
        kind = coco.kinds[one.category_id]
        items[coco.scenes[one.image_id]] += [Item(kind, ring.tolist()) for ring in rings_of(one)]
    return items
