"""Read and check a person's folder (docs/own-tables.md): every fault becomes a sentence before anything runs."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.own import files
from pipeline.own.curves import CONTROLS, POOR_ABOVE_M, fit_demonstrations
from pipeline.own.demonstrations import MIN_SCENES, read_samples
from pipeline.own.files import DEMONSTRATIONS, ENDINGS, KEY, KINDS, SCENES, SETTINGS, Faults, Settings
from pipeline.own.frame import Frame, outline, rectify
from pipeline.own.items import COCO, MASKS, Told, Views, read_items
from pipeline.own.pictures import read_cutouts, read_picture
from pipeline.own.seen import ALONE, EMPTY, STACK, Seen, detect, look
from pipeline.perception.empty import MIN_PICTURES, Empty, empty_table
from pipeline.perception.objects import Object
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SIDE

SHEET = "check.png"  # every picture with the outlines of what is seen
ALIKE_LEVELS = 6  # of 255, at most between pictures of one arrangement, after a mean of 3 x 3 pixels; ours
SIZES_PX = 6, 45  # of a typical item, where the detector is at its best [hundredths of the table's side]


@dataclass(frozen=True)
class Folder:
    """Hold all that a folder contains, checked."""

    path: Path
    frame: Frame
    canvases: dict[str, UInt8[Array, "side side 3"]]  # rectified tables by scene
    demos: pd.DataFrame  # a row for each demonstration (`fit_demonstrations`)
    degrees: pd.DataFrame  # how closely curves of each degree follow what was left out (`choose_degree`)
    empty: UInt8[Array, "side side 3"] | None  # the rectified empty table, photographed
    one_camera: bool  # all pictures show the same table from the same place, as far as table.yaml tells
    told: dict[str, list[Told]]  # items that somebody outlined, by scene
    cutouts: dict[str, list[tuple[UInt8[Array, "row column 4"], float]]]  # by kind, with width [m]

    @property
    def scenes(self) -> list[str]:
        """Return the names of the scenes in their order."""
        return list(self.canvases)

    @cached_property
    def images(self) -> UInt8[Array, "scene 100 100 3"]:
        """Return all pictures as the models see them."""
        return np.stack([self.frame.image(canvas) for canvas in self.canvases.values()])

    @cached_property
    def arrangements(self) -> Int[Array, " scene"]:
        """Return a number for each scene, the same for those whose pictures look alike: nothing was moved between."""
        smooth = np.stack([cv2.blur(image, (3, 3)) for image in self.images]).astype(np.int16)
        first = list[int]()  # scene of each arrangement
        numbers = np.zeros(len(smooth), int)
        for scene, image in enumerate(smooth):
            alike = np.abs(smooth[first] - image).max(axis=(1, 2, 3)) <= ALIKE_LEVELS
            first += [] if alike.any() else [scene]
            numbers[scene] = int(alike.argmax()) if alike.any() else len(first) - 1
        return numbers

    @cached_property
    def from_pictures(self) -> Empty | None:
        """Return the empty table as the pictures tell it, where nobody photographed it."""
        if self.empty is not None or not self.one_camera:
            return None
        once = np.unique(self.arrangements, return_index=True)[1]
        stack = empty_table(np.stack(list(self.canvases.values()))[once])  # each arrangement has one voice
        if stack is None:
            return None
        moved, relit = (np.isin(self.arrangements, some).nonzero()[0].tolist() for some in (stack.moved, stack.relit))
        return stack._replace(moved=moved, relit=relit)

    @cached_property
    def seen(self) -> Seen:
        """Return what stands in the pictures."""
        told = {self.scenes.index(name): items for name, items in self.told.items()}
        if self.empty is not None:
            return look(self.images, self.frame, told, self.frame.image(self.empty), EMPTY)
        if (stack := self.from_pictures) is None or not stack.is_useful:
            return look(self.images, self.frame, told, None, ALONE)
        return look(self.images, self.frame, told, self.frame.image(stack.canvas), STACK, stack.moved + stack.relit)

    @cached_property
    def standing(self) -> list[Object]:
        """Return what the detector finds on the empty table that the pictures give: it may never have moved."""
        if self.seen.empty is None or self.empty is not None:
            return []
        return detect(self.seen.empty, None)[0]

    def controls(self, demos: pd.DataFrame | None = None) -> Float[Array, "demo control 2"]:
        """Return the control points [m of the model] of demonstrations, of all unless some are given."""
        columns = (self.demos if demos is None else demos).filter(regex=CONTROLS)
        return columns.to_numpy().reshape(len(columns), columns.shape[1] // 2, 2)

    @property
    def users(self) -> list[str]:
        """Return the users in the order of their names."""
        return sorted(self.demos["user"].unique())

    @property
    def notes(self) -> list[str]:
        """Return remarks that are no faults."""
        notes, demos = [], self.demos
        if unlabelled := self.canvases.keys() - set(demos["scene"]):
            notes.append(f"{len(unlabelled)} scenes have no demonstration: the report says which to show next")
        if (count := len(set(self.arrangements))) < len(self.scenes):
            alike = "scenes that look alike are judged together"
            notes.append(f"{len(self.scenes)} scenes show {count} arrangements: {alike}")
        if not self.cutouts:
            notes.append(f"no {KINDS}/ with cut-outs: the report cannot ask what users react to")
        if len(poor := demos[demos["poor"]]):
            than = f"{POOR_ABOVE_M:g} of the table's side, the first ({', '.join(poor[KEY].iloc[0])})"
            notes.append(f"{len(poor)} of {len(demos)} demonstrations are followed less closely than {than}")
        return notes

    def _names(self, numbers: Iterable[int]) -> str:
        """Return the names of scenes, separated by commas."""
        return ", ".join(self.scenes[i] for i in numbers)

    @property
    def how_seen(self) -> list[str]:
        """Return sentences on how items are known, and what the empty table from the pictures leaves open."""
        ways = ", ".join(f"{way}: {count}" for way, count in Counter(self.seen.ways).items())
        lines = [f"How the models know what stands on the table, by the number of scenes: {ways}."]
        stack = self.from_pictures
        moved, relit = ([], []) if stack is None else (stack.moved, stack.relit)
        others = set(self.seen.misfits) - {*moved, *relit}
        reasons = {"camera moved": moved, "light changed": relit, "empty table does not fit": others}
        alone = [i for i, way in enumerate(self.seen.ways) if way == ALONE]
        stacked = self.empty is None and self.one_camera and len(set(self.arrangements)) >= MIN_PICTURES
        if alone and stacked and (stack is None or len({*others, *moved, *relit}) == len(self.scenes)):
            lines.append("The pictures do not show one table from one place in one light: each is read alone.")
            reasons = {}
        for why, scenes in reasons.items():
            if names := self._names(i for i in alone if i in scenes):
                lines.append(f"The {why} in {names}: read by the picture alone.")
        if names := self._names(i for i, doubt in enumerate(self.seen.objects.doubt) if doubt > 1):
            less = "than in training, and models trust it less: outline items."
            lines.append(f"The detector is less sure of {names} {less}")
        if stack is None or (stack.is_useful and STACK not in self.seen.ways):
            return lines
        unsure = f"The pictures disagree about {stack.unsure.mean():.0%} of the empty table"
        if not stack.is_useful:
            lines.append(f"{unsure}, so it is not used: move the items farther, or photograph it as empty.jpg.")
        elif stack.unsure.any():
            lines.append(f"{unsure}: items there may be missed.")
        if self.standing:
            lines.append(
                f"On the empty table from the pictures the detector finds {len(self.standing)}: items that never move "
                "are taken for the table. Move them, outline them, or photograph the table without them as empty.jpg."
            )
        return lines

    @property
    def advice(self) -> list[str]:
        """Return what was seen in the pictures, and what to do about it."""
        objects, lines = self.seen.objects, self.how_seen
        counts = objects.present.sum(1)
        bare = [name for name, count in zip(self.scenes, counts, strict=True) if not count]
        lines.append(f"{counts.sum()} items, {counts.mean():.1f} a scene; look at {SHEET}")
        if bare:
            lines.append(f"no item in {len(bare)} scenes, the first {bare[0]}: outline them if they have any")
        lengths = np.linalg.norm(objects.ends[..., 1, :] - objects.ends[..., 0, :], axis=-1) + 2 * objects.radius
        sizes = SIDE * lengths[objects.present]
        if len(sizes) and not SIZES_PX[0] <= np.median(sizes) <= SIZES_PX[1]:
            move = "further away" if np.median(sizes) > SIZES_PX[1] else "nearer"
            span = f"{SIZES_PX[0]} to {SIZES_PX[1]} hundredths of the table's side"
            lines.append(f"a typical item is {np.median(sizes):.0f} long, expected {span}: come {move}")
        if ALONE in self.seen.ways:
            least = "photograph the table empty as empty.jpg, or more arrangements with a fixed camera"
            lines.append(f"outlines are surest (`python -m pipeline.own record`); else {least}")
        return lines

    def outlines(self, scene: int) -> list[Float[Array, "point 2"]]:
        """Return the outlines [m of the model] of the objects that models see in a scene."""
        objects = self.seen.objects
        present = objects.present[scene]
        return list(map(outline, objects.ends[scene, present], objects.radius[scene, present]))


def read_folder(path: Path) -> tuple[Folder | None, Faults]:
    """Return what the folder holds, or None and a sentence for each fault."""
    faults = Faults()
    if not path.is_dir():
        faults.append(f"{path} is not a folder: expected one with {SCENES}/ and {DEMONSTRATIONS}")
        return None, faults
    for link in path.rglob("*"):
        if link.is_symlink() and not link.resolve().is_relative_to(path.resolve()):
            faults.append(f"{link.relative_to(path)} is a link out of the folder: replace it by the file itself")
    if faults:
        return None, faults
    for file in sorted(path.iterdir()):
        name = file.name.lower().replace(".yml", ".yaml")
        if name in (SETTINGS, SCENES, KINDS, COCO, MASKS, *files.COLUMNS) and name != file.name:
            faults.append(f"{file.name} is not read: rename it to {name}")
    scenes, settings, samples = files.scene_files(path, faults), None, None
    try:
        settings = files.read_settings(path)
        samples = read_samples(path, scenes, settings, faults)
    except InputError as error:
        faults += str(error).splitlines()
    cutouts = read_cutouts(path, settings, faults)
    if settings is None:
        return None, faults
    by_scene = settings.corners if isinstance(settings.corners, dict) else {}
    for scene in sorted(by_scene.keys() - scenes.keys()):
        faults.append(f"{SETTINGS}: corners of {scene}: {SCENES}/ has no such picture; correct the name")
    canvases, sizes = {}, {}
    for scene, file in scenes.items():
        corners = settings.corners_of(scene)
        if corners is None and not settings.rectified:
            faults.append(f"{SETTINGS}: no corners of {scene}: add them, as for the other scenes")
        elif (read := _read_canvas(file, f"{SCENES}/{file.name}", corners, settings, faults)) is not None:
            canvases[scene], sizes[scene] = read
    told = read_items(path, Views(sizes, settings), faults) if len(sizes) == len(scenes) else {}
    bare, named = None, [f for f in files.listed(path, *ENDINGS, *files.UNREAD) if f.stem.lower() == "empty"]
    if len(named) > 1 or any(file.suffix.lower() in files.UNREAD for file in named):
        faults.append(f"{', '.join(file.name for file in named)}: expected one empty.jpg or empty.png")
    elif named and by_scene:
        faults.append(f"{named[0].name} needs a fixed camera, and corners differ by scene: remove one of them")
    elif named:
        bare = _read_canvas(named[0], named[0].name, settings.corners_of(""), settings, faults)
    shapes = {size: name for name, size in (sizes | ({named[0].name: bare[1]} if bare else {})).items()}
    if isinstance(settings.corners, np.ndarray) and len(shapes) > 1:
        differ = "; ".join(f"{name} has {width} x {height} pixels" for (width, height), name in shapes.items())
        advice = "expected one size" + ("" if bare else ", or corners for each scene")
        faults.append(f"{SETTINGS}: corners for all pictures, and {differ}: {advice}")
    if faults or samples is None:
        return None, faults
    frame = Frame((float(settings.size_m[0]), float(settings.size_m[1])))
    demos, degrees = fit_demonstrations(samples, frame, faults)
    if faults:
        return None, faults
    empty = None if bare is None else bare[0]
    folder = Folder(path, frame, canvases, demos, degrees, empty, not by_scene, told, cutouts)
    for user, rows in demos.groupby("user"):
        count = len({folder.arrangements[folder.scenes.index(scene)] for scene in rows["scene"]})
        if count < MIN_SCENES:
            few = f"the scenes of user {user} look alike and show {count} arrangements: expected at least {MIN_SCENES}"
            faults.append(f"{SCENES}/: {few}; move objects between pictures, or leave the user out")
    return (None if faults else folder), faults


def _read_canvas(
    file: Path, name: str, corners: Array | None, settings: Settings, faults: Faults
) -> tuple[Array, tuple[int, int]] | None:
    """Return a rectified picture with the width and height of the original, or None after a fault."""
    try:
        picture = read_picture(file, name)
    except (InputError, OSError) as error:
        faults.append(str(error))
        return None
    height, width = picture.shape[:2]
    size = f"{name} has {width} x {height} pixels"
    if corners is None and not files.has_shape(width, height, settings.size_m):
        shape = "square" if settings.size_m[0] == settings.size_m[1] else "{:g} by {:g}".format(*settings.size_m)
        faults.append(f"{size}: expected a {shape} picture of just the table, or corners in {SETTINGS}")
    elif min(width, height) < files.MIN_TABLE_PX:
        faults.append(f"{size}: expected at least {files.MIN_TABLE_PX} a side; take the original, not a preview")
    elif corners is not None and ((corners < 0) | (corners > [width, height])).any():
        faults.append(f"{size}, and corners in {SETTINGS} lie outside: correct them")
    else:
        canvas = rectify(picture, corners, settings.size_m)
        if np.median(canvas.reshape(-1, 3), axis=0).any():
            return canvas, (width, height)
        faults.append(f"{name} is black where the table should be: expected a picture of it, or other corners")
    return None
