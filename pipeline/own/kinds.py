"""Ask what a user reacts to: composite an object into the pictures, and see what the model makes of it.

Only what the models learned is asked, so a verdict is about the user as far as the models are right. The object casts
no shadow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from pipeline import library
from pipeline.causal.envelope import dose_grid, paths_at_doses, radius
from pipeline.models.base import to_tensor
from pipeline.own.data import plain
from pipeline.own.fitting import Fitted
from pipeline.own.folder import Folder
from pipeline.own.frame import CANVAS_PX
from pipeline.perception.capsule import Capsule, fit_capsule
from pipeline.perception.objects import Objects, detect_objects
from pipeline.runtime.streams import stream
from pipeline.stats.tests import LEVEL, SMALLEST_EFFECT, holm
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.catalogue import MIN_VISIBLE_ALPHA
from pipeline.world.layout import EMPTY, Layouts, point_segment_distance, segment_distance
from pipeline.world.rules import clearance

PLACES = 120  # places of each kind over all scenes, at least: library.effect calls no change in 60 negligible
PATHS = 40  # random paths at each place
TRIES = 200  # draws of a free place before a scene counts as full
CENTRE_M = 0.12, 0.88  # objects' centres in each coordinate [m of the model], as scenes.layout in conf/scenes.yaml
CLEAR_OF_ENDS_M, CLEAR_OF_ITEMS_M = 0.12, 0.015  # least distances from path ends and other objects, as there
STEP_M, DOSES = 0.01, 13  # of clearance from the object, for the envelope [m of the model]
CLEAR_OF_OTHERS_M = 0.06  # clearance of these paths from all other objects, as conf/studies/envelope.yaml
PER_METRE = 1000  # points per metre at which a cut-out's outline is measured
CANDIDATES = 768  # random paths a scene among which those at each clearance are chosen


@dataclass(frozen=True)
class Added:
    """One kind, composited at random free places: a row for each place."""

    scene: Array  # number of the scene
    images: UInt8[Array, "row 100 100 3"]
    images_with: UInt8[Array, "row 100 100 3"]
    footprint: Layouts  # of the added object, one slot [m of the model]


@dataclass(frozen=True)
class Scenes:
    """All pictures as the models see them, with the detected objects and the paths that are asked about."""

    names: list[str]
    images: UInt8[Array, "scene 100 100 3"]
    objects: Objects
    candidates: Float[Array, "scene path 2"]


def read_scenes(images: Mapping[str, Array]) -> Scenes:
    """Return the pictures of a folder with their detected objects and random paths."""
    stacked = np.stack(list(images.values()))
    candidates = random_z_theta(stream("own", "candidates"), len(stacked), CANDIDATES)
    return Scenes(list(images), stacked, detect_objects(to_tensor(stacked)), candidates)


def add_kind(folder: Folder, scenes: Scenes, kind: str) -> Added | None:
    """Return the kind's cut-outs, each at random free places; None if fewer than two scenes have room."""
    rng, rows = stream("own", "places", kind), []
    cutouts = [(cutout, width, footprint(cutout, width)) for cutout, width in folder.cutouts[kind]]
    for place in range(-(-PLACES // len(scenes.names))):
        for scene, name in enumerate(scenes.names):
            cutout, width, capsule = cutouts[(place + scene) % len(cutouts)]
            found = free_place(rng, folder, scenes.objects, scene, capsule)
            if found is not None:
                centre, angle = found
                canvas = paste(
                    folder.canvases[name], cutout, width / folder.frame.side_m, centre / folder.frame.side_m, angle
                )
                rows.append(
                    (scene, folder.frame.image(canvas), ends_of(folder, capsule, centre, angle), capsule.radius)
                )
    if len({row[0] for row in rows}) < 2:
        return None
    number, with_object, ends, radii = (np.array(column) for column in zip(*rows, strict=True))
    added = capsules(ends[:, None], folder.frame.scale * radii[:, None], np.ones((len(rows), 1), bool))
    return Added(number, scenes.images[number], plain(folder, with_object), added)


def footprint(cutout: UInt8[Array, "row column 4"], width_m: float) -> Capsule:
    """Return the capsule of a cut-out's visible part, its centre relative to the picture's [m], y upwards."""
    across = max(1, round(width_m * PER_METRE))
    size = across, max(1, round(across * cutout.shape[0] / cutout.shape[1]))
    rows, columns = np.nonzero(cv2.resize(cutout[..., 3], size, interpolation=cv2.INTER_AREA) > MIN_VISIBLE_ALPHA)
    points = np.stack([columns - (size[0] - 1) / 2, (size[1] - 1) / 2 - rows], -1) / PER_METRE
    return fit_capsule(points, PER_METRE)


def free_place(
    rng: np.random.Generator, folder: Folder, objects: Objects, scene: int, capsule: Capsule
) -> tuple[Float[Array, "2"], float] | None:
    """Return centre [m on the table] and angle [rad] of a place clear of all else; None after TRIES draws."""
    frame, present = folder.frame, objects.present[scene]
    wide = frame.scale * capsule.radius
    for _ in range(TRIES):
        centre = frame.to_table(rng.uniform(*CENTRE_M, 2))
        angle = rng.uniform(-np.pi, np.pi)
        ends = ends_of(folder, capsule, centre, angle)
        reach = np.linalg.norm(capsule.half) + capsule.radius
        on_table = (centre > reach).all() and (centre < frame.side_m - reach).all()
        near_end = min(point_segment_distance(end, *ends) for end in (P_INIT, P_F)) - wide < CLEAR_OF_ENDS_M
        gaps = (
            segment_distance(ends, objects.ends[scene, present].astype(float)) - wide - objects.radius[scene, present]
        )
        if on_table and not near_end and not (gaps < CLEAR_OF_ITEMS_M).any():
            return centre, float(angle)
    return None


def ends_of(folder: Folder, capsule: Capsule, centre: Array, angle: float) -> Float[Array, "2 2"]:
    """Return the ends [m of the model] of a footprint whose picture lies at `centre` [m on the table]."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return folder.frame.to_model(
        centre + np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half]) @ turn.T
    )


def paste(canvas: Array, cutout: Array, width: float, centre: Array, angle: float) -> UInt8[Array, "side side 3"]:
    """Return a rectified table with a cut-out over it; width and centre relative to the table's side, angle [rad]."""
    across = max(1, round(width * CANVAS_PX))
    size = across, max(1, round(across * cutout.shape[0] / cutout.shape[1]))
    small = cutout.astype(np.float32) / 255
    small[..., :3] *= small[..., 3:]
    small = cv2.resize(small, size, interpolation=cv2.INTER_AREA)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[c, s], [-s, c]])  # rows grow downwards
    middle = np.array([centre[0], 1 - centre[1]]) * CANVAS_PX - 0.5
    matrix = np.column_stack([turned, middle - turned @ (np.array(size) - 1) / 2])
    layer = cv2.warpAffine(small, matrix, (CANVAS_PX, CANVAS_PX), flags=cv2.INTER_LINEAR)
    covered = canvas * (1 - layer[..., 3:]) + 255 * layer[..., :3]
    return np.clip(np.rint(covered), 0, 255).astype(np.uint8)


def capsules(ends: Float[Array, "scene slot 2 2"], radii: Float[Array, "scene slot"], present: Array) -> Layouts:
    """Return capsules [m] as layouts, for their clearances alone."""
    along = ends[..., 1, :] - ends[..., 0, :]
    number = np.where(present, 0, EMPTY)
    return Layouts(
        item=number,
        symbol=number,
        centre=ends.mean(-2).astype(float),
        angle=np.arctan2(along[..., 1], along[..., 0]).astype(float),
        scale=np.ones(number.shape),
        half_length=np.linalg.norm(along, axis=-1) / 2,
        radius=radii.astype(float),
    )


def effects(fitted: Fitted, added: Mapping[str, Added]) -> pd.DataFrame:
    """Return one row for each kind: what adding it does to P(valid), for one user.

    effect, ci_low, ci_high, p_holm (over the user's kinds) as `library.effect` gives them, places being its scenes;
    lowest, highest: of the models that were fitted without each fold. The verdict holds for all of these models, or it
    is `undecided`: the interval alone does not cover other demonstrations.
    """
    rows = []
    for kind, places in added.items():
        z = random_z_theta(stream("own", "paths", kind), len(places.scene), PATHS)
        arrays = places.images, places.images_with, z
        result = library.effect(fitted.model, *arrays)
        others = [mean_change(model, *arrays) for model in fitted.fold_models]
        rows.append(
            {
                "user": fitted.data.user,
                "kind": kind,
                "places": len(places.scene),
                "effect": result.estimate,
                "ci_low": result.interval[0],
                "ci_high": result.interval[1],
                "p": result.p,
                "lowest": min(others),
                "highest": max(others),
                "verdict": result.verdict,
            }
        )
    table = pd.DataFrame(rows)
    table["p_holm"] = holm(table.pop("p").to_numpy())
    table["verdict"] = [confirmed(row) for row in table.to_dict("records")]
    return table


def mean_change(model, images: Array, images_with: Array, z: Array) -> float:
    """Return the mean change of P(valid) over places and paths."""
    return float((model.probability(images_with, z).astype(float) - model.probability(images, z)).mean())


def confirmed(row: Mapping) -> str:
    """Return the verdict if it survives Holm's correction and all models agree, or `undecided`."""
    low, high = row["lowest"], row["highest"]
    same_sign = max(low, high) < -SMALLEST_EFFECT if row["effect"] < 0 else min(low, high) > SMALLEST_EFFECT
    holds = {
        "effect": row["p_holm"] < LEVEL and same_sign,
        "negligible": max(abs(low), abs(high)) < SMALLEST_EFFECT,
        "undecided": True,
    }
    return row["verdict"] if holds[row["verdict"]] else "undecided"


def envelopes(
    fitted: Fitted, added: Mapping[str, Added], scenes: Scenes, table: pd.DataFrame, scale: float
) -> pd.DataFrame:
    """Return one row for each kind that the user keeps away from: the clearance [m on the table] of half the effect.

    radius_m, ci_low, ci_high (95 % over scenes, both those asked and those fitted to), scenes. A kind without enough
    paths at its outline is left out.
    """
    others = capsules(scenes.objects.ends, scenes.objects.radius, scenes.objects.present)
    to_others = np.concatenate(
        [clearance(others[[i]], scenes.candidates[[i]]).min(-1) for i in range(len(scenes.names))]
    )
    rows = []
    for kind in table.loc[(table["verdict"] == "effect") & (table["effect"] < 0), "kind"]:
        response, doses = responses(fitted, added[kind], scenes, to_others)
        if len(doses) < 3:
            continue
        middle, low, high = (value / scale for value in radius(response, doses))
        counted = int((~np.isnan(response[0, :, 0])).sum())
        rows.append(
            {
                "user": fitted.data.user,
                "kind": kind,
                "radius_m": middle,
                "ci_low": low,
                "ci_high": high,
                "scenes": counted,
            }
        )
    return pd.DataFrame(rows, columns=["user", "kind", "radius_m", "ci_low", "ci_high", "scenes"])


def responses(
    fitted: Fitted, places: Added, scenes: Scenes, to_others: Float[Array, "scene path"]
) -> tuple[Float[Array, "model asked dose"], Float[Array, " dose"]]:
    """Return the fall of P(valid) by fold model, scene with a place and clearance from the object, and the clearances.

    Each model lacks one of K groups of scenes. Deviations between models are multiplied by K - 1, so that their
    standard error is the jackknife's over groups of scenes (Tukey, 1958).
    """
    doses, z = dose_grid(STEP_M, DOSES), scenes.candidates[places.scene]
    to_added = np.concatenate([clearance(places.footprint[[i]], z[[i]])[..., 0] for i in range(len(z))])
    chosen = paths_at_doses(to_added, to_others[places.scene], doses, CLEAR_OF_OTHERS_M, 1)[..., 0]  # (row, dose)
    paths = np.take_along_axis(z, np.maximum(chosen, 0)[..., None], axis=1)
    falls = []
    for model in fitted.fold_models:
        fall = model.probability(places.images, paths) - model.probability(places.images_with, paths).astype(float)
        falls.append(by_scene_mean(np.where(chosen >= 0, fall, np.nan), places.scene))
    response = np.stack(falls)
    middle = response.mean(0)
    response = middle + (len(response) - 1) * (response - middle)
    has_dose = (~np.isnan(middle)).sum(0) >= 2
    count = len(doses) if has_dose.all() else int(has_dose.argmin())
    return response[..., :count], doses[:count]


def by_scene_mean(values: Float[Array, "row dose"], scene: Sequence[int] | Array) -> Float[Array, "scene dose"]:
    """Return the mean over each scene's places, NaN where none has the dose."""
    return pd.DataFrame(values).groupby(np.asarray(scene)).mean().to_numpy()
