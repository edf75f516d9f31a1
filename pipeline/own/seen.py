"""Find what stands on each table, and say how that is known: told, against the empty table, or by the picture alone.

Where a person named kinds, every other item gets the kind whose items look most like it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from scipy.special import softmax
from scipy.stats import median_abs_deviation

from pipeline.models.base import to_tensor
from pipeline.own.frame import Frame, outline, whole
from pipeline.own.items import MAX_ITEM_SHARE, Told
from pipeline.perception.objects import SUPERSAMPLING, Object, Objects, Outline, describe_outlined, detect_objects
from pipeline.perception.segmenter import LOOKS
from pipeline.world.layout import SIDE, point_segment_distance

TOLD, EMPTY, STACK, ALONE = "told", "empty table", "empty table from the pictures", "picture alone"
FINE = SIDE * SUPERSAMPLING  # points a side on which outlines are laid down
SPREAD = 0.5  # standard deviation that each kind's looks have at least, over that of all items
USUAL_DOUBT = 12.0, 3.5  # of nine in ten composites as in the segmenter's training: alone, over an empty table [nat/px]
MAX_DRIFT_PX = 1.2  # of a corner of the table: beyond it the camera moved, and edges of patterns become finds
NEARER = 0.9  # median difference after such a movement, over that before, at most
NEAR_M = 0.01  # an item's centre may lie this far outside a detected outline [m of the model]
Image = UInt8[Array, "100 100 3"]
Named = tuple[str, Object]  # kind, "" where nobody named it


@dataclass(frozen=True)
class Kinds:
    """Kinds that a person named, as normal distributions of looks with independent coordinates (naive Bayes)."""

    names: list[str]
    mean: Float[Array, "kind look"]
    spread: Float[Array, "kind look"]

    @classmethod
    def learn(cls, items: Iterable[Named], others: Iterable[Object]) -> "Kinds | None":
        """Return the kinds of items, or None if fewer than two are named; others: not outlined."""
        items = list(items)
        names = sorted({kind for kind, _ in items if kind})
        if len(names) < 2:
            return None
        scale = np.stack([_looks(one) for one in [*(one for _, one in items), *others]]).std(0).clip(1e-3)
        own = [np.stack([_looks(one) for kind, one in items if kind == name]) for name in names]
        spread = np.stack([np.sqrt(each.var(0) + (SPREAD * scale) ** 2) for each in own])
        return cls(names, np.stack([each.mean(0) for each in own]), spread)

    def probability(self, one: Object) -> Float[Array, " kind"]:
        """Return the probability of each kind."""
        square = ((_looks(one) - self.mean) / self.spread) ** 2
        return softmax(-square.sum(1) / 2 - np.log(self.spread).sum(1))


def _looks(one: Object) -> Float[Array, " look"]:
    return np.concatenate([one.features, np.log(np.clip(one.looks, 1e-3, 1))])


@dataclass(frozen=True)
class Seen:
    """Hold what stands in the scenes of a folder."""

    frame: Frame
    empty: Image | None  # the table without items
    ways: list[str]  # how each scene's items are known: TOLD, EMPTY, STACK or ALONE
    misfits: list[int]  # scenes whose camera or light is not that of `empty`
    told: dict[int, list[Named]]  # items that somebody outlined, by scene
    found: list[list[Object]]  # what the detector finds in each scene
    doubt: list[float]  # of the detector, over USUAL_DOUBT
    kinds: Kinds | None

    @property
    def objects(self) -> Objects:
        """Return the objects that models see."""
        doubts = [0.0 if scene in self.told else doubt for scene, doubt in enumerate(self.doubt)]
        return Objects.of([self._scene(i) for i in range(len(self.ways))], doubts, len(self.names))

    @property
    def names(self) -> list[str]:
        """Return what the columns of the objects' `kinds` stand for."""
        return list(LOOKS) if self.kinds is None else self.kinds.names

    @property
    def untold(self) -> "Seen":
        """Return the same scenes as the detector alone sees them, with the kinds that were named."""
        return replace(self, told={}, ways=[ALONE] * len(self.ways))

    def with_items(self, scenes: Sequence[int], images: Sequence[Image], rings: Sequence[Array], kind: str) -> Objects:
        """Return the objects of scenes to which an item of a kind was added; rings [m of the model]: its outlines."""
        parts, doubts = [], []
        for scene, image, ring in zip(scenes, images, rings, strict=True):
            if self.ways[scene] == TOLD:
                added = describe_outlined(image, [_outline([ring])])
                parts.append([*self._scene(scene), *(self._final(one, kind) for one in added)])
                doubts.append(0.0)
            else:
                found, doubt = detect(image, None if scene in self.misfits else self.empty)
                parts.append([self._final(one) for one in found])
                doubts.append(doubt)
        return Objects.of(parts, doubts, len(self.names))

    def _scene(self, scene: int) -> list[Object]:
        if scene in self.told:
            return [self._final(one, kind) for kind, one in self.told[scene]]
        return [self._final(one) for one in self.found[scene]]

    def _final(self, one: Object, kind: str = "") -> Object:
        """Return an object whose looks are the probabilities of the named kinds, if there are any."""
        if self.kinds is None:
            return one
        said = np.array([name == kind for name in self.kinds.names], float)
        return one._replace(looks=said if said.any() else self.kinds.probability(one))


def look(
    images: UInt8[Array, "scene 100 100 3"],
    frame: Frame,
    told: Mapping[int, Sequence[Told]],
    empty: Image | None,
    way: str,
    misfits: Sequence[int] = (),
) -> Seen:
    """Return what stands in pictures; told: items by scene; `empty`: the table without items, known by `way`.

    misfits: scenes in another light or from another place than `empty`; what stands there is known by the picture
    alone, as where the camera moved, or the comparison finds something as large as the table.
    """
    if empty is not None:
        misfits = [i for i, image in enumerate(images) if i in misfits or _is_moved(image, empty)]
    pairs = [detect(image, None if i in misfits else empty) for i, image in enumerate(images)]
    if empty is not None:
        misfits = [i for i, (objects, _) in enumerate(pairs) if i in misfits or any(map(_is_huge, objects))]
        pairs = [detect(images[i], None) if i in misfits else pair for i, pair in enumerate(pairs)]
    found, doubt = [objects for objects, _ in pairs], [each for _, each in pairs]
    known = {scene: _described(images[scene], items, frame) for scene, items in told.items()}
    ways = [TOLD if i in known else ALONE if i in misfits else way for i in range(len(images))]
    others = [one for i, objects in enumerate(found) if i not in known for one in objects]
    kinds = Kinds.learn([item for items in known.values() for item in items], others)
    return Seen(frame, empty, ways, list(misfits), known, found, doubt, kinds)


def suggest(
    canvases: Mapping[str, UInt8[Array, "side side 3"]], told: Mapping[str, Sequence[Told]], scene: str
) -> list[tuple[str, Float[Array, "point 2"]]]:
    """Return the kind and the outline of each object that the detector finds in a scene.

    The kind is that of the items in `told` that look most like it. Outlines: in shares of the table's longer side.
    """
    frame = Frame((1.0, 1.0))
    known = [_described(frame.image(canvases[name]), items, frame) for name, items in told.items()]
    found, _ = detect(frame.image(canvases[scene]), None)
    learned = Kinds.learn([item for items in known for item in items], found)
    kinds = ["" if learned is None else learned.names[int(learned.probability(one).argmax())] for one in found]
    return [(kind, outline(one.ends, np.float64(one.radius))) for kind, one in zip(kinds, found, strict=True)]


def detect(image: Image, empty: Image | None) -> tuple[list[Object], float]:
    """Return what the detector finds in a picture, and its doubt over USUAL_DOUBT; `empty`: the table without items."""
    table = None if empty is None else to_tensor(empty[None])
    objects = detect_objects(to_tensor(image[None]), table, looks=True)
    fields = objects.ends, objects.radius, objects.features, objects.kinds
    rows = [Object(*(field[0, i] for field in fields)) for i in np.flatnonzero(objects.present[0])]
    return rows, float(objects.doubt[0]) / USUAL_DOUBT[empty is not None]


def _is_moved(image: Image, empty: Image) -> bool:
    """Return whether the table lies elsewhere in a picture: an affine movement (ECC) brings most of it nearer."""
    grey, onto = (cv2.cvtColor(cv2.GaussianBlur(each, (0, 0), 1), cv2.COLOR_RGB2GRAY) for each in (image, empty))
    try:
        _, matrix = cv2.findTransformECC(onto, grey, np.eye(2, 3, dtype=np.float32), cv2.MOTION_AFFINE)
    except cv2.error:  # nothing to hold on to, as on a plain table
        return False
    back = cv2.warpAffine(grey, matrix, (SIDE, SIDE), flags=cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
    before, after = (median_abs_deviation(each.astype(float) - onto, axis=None) for each in (grey, back))
    drift = np.abs(whole(SIDE, SIDE) @ (matrix[:, :2].T - np.eye(2)) + matrix[:, 2]).max()
    return bool(drift > MAX_DRIFT_PX and after < NEARER * before)


def _is_huge(one: Object) -> bool:
    """Return whether an object covers so much of the table that it is no item."""
    radius, length = float(one.radius), float(np.linalg.norm(one.ends[1] - one.ends[0]))
    return np.pi * radius**2 + 2 * radius * length > MAX_ITEM_SHARE


def _described(image: Image, items: Sequence[Told], frame: Frame) -> list[Named]:
    """Return kind and object of each told item of which the picture shows some part."""
    laid = [(kind, _outline([frame.to_model(part) for part in parts])) for kind, parts in items]
    shown = [(kind, one) for kind, one in laid if one.mask.any()]
    objects = describe_outlined(image, [one for _, one in shown])
    return [(kind, one) for (kind, _), one in zip(shown, objects, strict=True)]


def _outline(parts: Sequence[Float[Array, "point 2"]]) -> Outline:
    """Return the points within polygons [m of the model]."""
    mask = np.zeros((FINE, FINE), np.uint8)
    rings = [np.rint((part * [1, -1] + [0, 1]) * FINE - 0.5).astype(np.int32) for part in parts]
    return Outline(cv2.fillPoly(mask, rings, (1,)), 0, 0)


def compared(seen: Seen, scenes: Sequence[str]) -> tuple[pd.DataFrame, int]:
    """Return one row for each told item: scene, kind, and whether a detected object covers its centre.

    The number counts the detected objects that cover no told item, in the scenes whose items are told.
    """
    rows, unlisted = [], 0
    for scene, items in seen.told.items():
        centres = np.array([item.ends.mean(0) for _, item in items]).reshape(-1, 2)
        hits = np.zeros((len(seen.found[scene]), len(items)), bool)
        for i, one in enumerate(seen.found[scene]):
            ends = np.asarray(one.ends, float)
            hits[i] = point_segment_distance(centres, ends[0], ends[1]) - one.radius < NEAR_M
        unlisted += int((~hits.any(1)).sum())
        rows += [(scenes[scene], kind, bool(hit)) for (kind, _), hit in zip(items, map(np.any, hits.T), strict=True)]
    return pd.DataFrame(rows, columns=["scene", "kind", "detected"]), unlisted
