"""Ask what a user reacts to: composite an object into the pictures, and see what the model makes of it.

A verdict is about the user only as far as the models that are asked are right. The object casts no shadow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from pipeline import library
from pipeline.causal.envelope import dose_grid, path_at_doses, radius
from pipeline.models.clearance.clearance import PATH_SAMPLES
from pipeline.own.fitting import Fitted
from pipeline.own.folder import Folder
from pipeline.own.frame import CANVAS_PX, Frame, outline
from pipeline.perception.objects import Capsule, Objects, fit_capsule
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import by_item, estimate
from pipeline.stats.tests import LEVEL, MIN_PAIRS, SMALLEST_EFFECT, holm
from pipeline.world.bezier import bezier
from pipeline.world.catalogue import MIN_VISIBLE_ALPHA
from pipeline.world.layout import EMPTY, Layouts, empty, point_segment_distance, segment_distance
from pipeline.world.rules import line_clearance

PLACES = 120  # places of each kind over all scenes, at least: library.effect calls no change in 60 negligible
PATHS = 40  # random paths at each place
TRIES = 200  # draws of a free place before a scene counts as full
CLEAR_OF_ENDS_M, CLEAR_OF_ITEMS_M = 0.12, 0.015  # least distances from path ends and other objects, as there
STEP_M, DOSES = 0.01, 13  # of clearance from the object, for the envelope [m of the model]
CLEAR_OF_OTHERS_M = 0.06  # clearance of these paths from all other objects, as conf/studies/safety.yaml
SPREAD_M = 0.15  # standard deviation by which control points of random paths leave a demonstration's [m of the model]
COARSE_POINTS = 65  # of a path whose clearance the truth measures as a polyline
PER_METRE = 1000  # points per metre at which a cut-out's outline is measured
CANDIDATES = 768  # random paths a scene among which those at each clearance are chosen


@dataclass(frozen=True)
class Added:
    """One kind, composited at random free places: a row for each place."""

    scene: Array  # number of the scene
    image: UInt8[Array, "100 100 3"]  # of the first place, with the object
    seen: Objects
    seen_with: Objects
    footprint: Layouts  # of the added object, one slot [m of the model]
    found: Objects  # as the detector alone sees both pictures of the places whose scenes are told, in their order
    found_with: Objects


def add_kind(folder: Folder, kind: str) -> Added | None:
    """Return the kind's cut-outs, each at random free places; None if fewer than two scenes have room."""
    rng, side, numbers, images, ends, radii = stream("own", "places", kind), max(folder.frame.size_m), [], [], [], []
    objects, path_ends = folder.seen.objects, ends_of_paths(folder)
    cutouts = [(*cutout, footprint(*cutout)) for cutout in folder.cutouts[kind]]
    for turn in range(-(-PLACES // len(folder.scenes))):
        for scene, canvas in enumerate(folder.canvases.values()):
            cutout, width, capsule = cutouts[(turn + scene) % len(cutouts)]
            place = free_place(rng, folder.frame, objects, scene, capsule, path_ends[folder.scenes[scene]])
            if place is not None:
                centre, angle = place
                numbers.append(scene)
                images.append(folder.frame.image(paste(canvas, cutout, width / side, centre / side, angle)))
                ends.append(ends_of(folder.frame, capsule, centre, angle))
                radii.append(folder.frame.scale * capsule.radius)
    if len(set(numbers)) < 2:
        return None
    added = capsules(np.array(ends)[:, None], np.array(radii)[:, None], np.ones((len(radii), 1), bool))
    outlines = [outline(end, np.float64(radius)) for end, radius in zip(ends, radii, strict=True)]
    with_items = folder.seen.with_items(numbers, images, outlines, kind)
    told, untold = [i for i, scene in enumerate(numbers) if scene in folder.seen.told], folder.seen.untold
    of_told = [numbers[i] for i in told], [images[i] for i in told], [outlines[i] for i in told]
    found = untold.objects[of_told[0]], untold.with_items(*of_told, kind)
    return Added(np.array(numbers), images[0], objects[numbers], with_items, added, *found)


def footprint(cutout: UInt8[Array, "row column 4"], width_m: float) -> Capsule:
    """Return the capsule of a cut-out's visible part, its centre relative to the picture's [m], y upwards."""
    small = scaled(cutout[..., 3], width_m * PER_METRE)
    rows, columns = np.nonzero(small > MIN_VISIBLE_ALPHA)
    points = np.stack([columns - (small.shape[1] - 1) / 2, (small.shape[0] - 1) / 2 - rows], -1) / PER_METRE
    return fit_capsule(points, PER_METRE)


def scaled(picture: Array, across: float) -> Array:
    """Return a picture that is so many pixels wide."""
    columns = max(1, round(across))
    rows = max(1, round(columns * picture.shape[0] / picture.shape[1]))
    return cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA)


def free_place(
    rng: np.random.Generator,
    frame: Frame,
    objects: Objects,
    scene: int,
    capsule: Capsule,
    path_ends: Float[Array, "end 2"],
) -> tuple[Float[Array, "2"], float] | None:
    """Return a centre [m on the table] and an angle [rad] at which an object's picture is clear of all else, or None.

    path_ends: where demonstrated paths begin and end in this scene [m of the model].
    `world.layout.add_item` knows no table's edge, no other table than the model's and no picture beside its footprint.
    """
    present, wide = objects.present[scene], frame.scale * capsule.radius
    others, radii = objects.ends[scene, present].astype(float), objects.radius[scene, present]
    reach = np.linalg.norm(capsule.half) + capsule.radius
    for _ in range(TRIES):
        middle, angle = rng.uniform(0, 1, 2) * frame.size_m, rng.uniform(-np.pi, np.pi)  # of the object
        if (middle <= reach).any() or (middle >= np.array(frame.size_m) - reach).any():
            continue  # not on the table
        centre = middle - rotation(angle) @ capsule.centre
        ends = ends_of(frame, capsule, centre, angle)
        from_ends = point_segment_distance(path_ends, *ends).min(initial=np.inf) - wide
        gaps = segment_distance(ends, others) - wide - radii
        if from_ends >= CLEAR_OF_ENDS_M and (gaps >= CLEAR_OF_ITEMS_M).all():
            return centre, float(angle)
    return None


def ends_of(frame: Frame, capsule: Capsule, centre: Array, angle: float) -> Float[Array, "2 2"]:
    """Return the ends [m of the model] of a footprint whose picture lies at `centre` [m on the table]."""
    ends = np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half])
    return frame.to_model(centre + ends @ rotation(angle).T)


def rotation(angle: float) -> Float[Array, "2 2"]:
    """Return the matrix that turns points counter-clockwise by an angle [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def paste(canvas: Array, cutout: Array, width: float, centre: Array, angle: float) -> UInt8[Array, "side side 3"]:
    """Return a rectified table with a cut-out over it; width and centre relative to the table's side, angle [rad]."""
    layer, turned = cutout.astype(np.float32) / 255, rotation(-angle)  # rows grow downwards
    layer[..., :3] *= layer[..., 3:]
    small = scaled(layer, width * CANVAS_PX)
    middle = np.array([centre[0], 1 - centre[1]]) * CANVAS_PX - 0.5
    matrix = np.column_stack([turned, middle - turned @ (np.array(small.shape[1::-1]) - 1) / 2])
    layer = cv2.warpAffine(small, matrix, (CANVAS_PX, CANVAS_PX), flags=cv2.INTER_LINEAR)
    covered = canvas * (1 - layer[..., 3:]) + 255 * layer[..., :3]
    return np.clip(np.rint(covered), 0, 255).astype(np.uint8)


def capsules(ends: Float[Array, "scene slot 2 2"], radii: Float[Array, "scene slot"], present: Array) -> Layouts:
    """Return capsules [m] as layouts, for their clearances alone."""
    along = (ends[..., 1, :] - ends[..., 0, :]).astype(float)
    return replace(
        empty(*radii.shape),
        symbol=np.where(present, 0, EMPTY),
        centre=ends.mean(-2).astype(float),
        angle=np.arctan2(along[..., 1], along[..., 0]),
        half_length=np.linalg.norm(along, axis=-1) / 2,
        radius=radii.astype(float),
    )


def effects(fitted: Fitted, added: Mapping[str, Added], folder: Folder) -> pd.DataFrame:
    """Return one row for each kind: what adding it does to P(valid) of `random_paths`, for one user.

    effect, ci_low, ci_high, p_holm (over the user's kinds) as `library.effect` gives them, places being its scenes;
    lowest, highest: of the models that were fitted without each fold. A verdict other than `undecided` holds for all of
    these models and survives Holm's correction, because the interval alone does not cover other demonstrations.
    """
    rows = []
    for kind, places in added.items():
        z = random_paths(stream("own", "paths", kind), folder, len(places.scene), PATHS)
        change = library.effect(fitted.model, places.seen, places.seen_with, z)
        others = [
            (model.probability(places.seen_with, z).astype(float) - model.probability(places.seen, z)).mean()
            for model in fitted.fold_models
        ]
        numbers = len(z), change.estimate, *change.interval, min(others), max(others)
        rows.append((fitted.data.user, kind, *numbers, change.verdict, change.p))
    names = ["user", "kind", "places", "effect", "ci_low", "ci_high", "lowest", "highest", "verdict", "p_holm"]
    table = pd.DataFrame(rows, columns=names)
    table["p_holm"] = holm(table["p_holm"].to_numpy())
    above, below = table["lowest"] > SMALLEST_EFFECT, table["highest"] < -SMALLEST_EFFECT
    effect = (table["verdict"] == "effect") & np.where(table["effect"] < 0, below, above) & (table["p_holm"] < LEVEL)
    none = (table["lowest"] > -SMALLEST_EFFECT) & (table["highest"] < SMALLEST_EFFECT)
    holds = effect | (table["verdict"] == "negligible") & none
    return table.assign(verdict=table["verdict"].where(holds, "undecided"))


def by_detector(fitted: Fitted, added: Mapping[str, Added], folder: Folder) -> pd.DataFrame:
    """Return what adding each kind does in the scenes whose items are told: as told, and as the detector sees them.

    Mediation by intervention on the percept: rule is the effect with told items, detection what the detector adds to
    it; each has a 95 % interval over places. Paths are those of `effects`. The detector's doubt does not count.
    """
    rows = []
    for kind, places in added.items():
        told = np.flatnonzero(np.isin(places.scene, list(folder.seen.told)))
        if len(told) >= MIN_PAIRS:
            z = random_paths(stream("own", "paths", kind), folder, len(places.scene), PATHS)[told]
            before, after, found, found_with = (
                fitted.model.probability(replace(seen, doubt=np.zeros_like(seen.doubt)), z).astype(float)
                for seen in (places.seen[told], places.seen_with[told], places.found, places.found_with)
            )
            rule = (after - before).mean(1)
            parts = {"rule": rule, "detection": (found_with - found).mean(1) - rule}
            for part, value in parts.items():
                mean = estimate(value[None, None])
                interval = mean.ci_low[0], mean.effect[0], mean.ci_high[0]
                rows.append((fitted.data.user, kind, part, len(told), *interval))
    return pd.DataFrame(rows, columns=["user", "kind", "part", "places", "ci_low", "effect", "ci_high"])


def envelopes(fitted: Fitted, added: Mapping[str, Added], folder: Folder, table: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind that the user keeps away from: the clearance [m on the table] of half the effect.

    table: of `effects`. radius_m, ci_low, ci_high (95 % over scenes, both those asked and those fitted to), scenes. A
    kind without enough paths at its outline is left out. Each fold model lacks one of K groups of scenes. Deviations
    between models are multiplied by K - 1: their standard error is the jackknife's over those groups (Tukey, 1958).
    """
    rows, objects = [], folder.seen.objects
    candidates = random_paths(stream("own", "candidates"), folder, len(folder.scenes), CANDIDATES, COARSE_POINTS)
    others = capsules(objects.ends, objects.radius, objects.present)
    to_others, doses = line_clearance(others, candidates).min(-1), dose_grid(STEP_M, DOSES)
    avoided = (table["user"] == fitted.data.user) & (table["verdict"] == "effect") & (table["effect"] < 0)
    for kind in table.loc[avoided, "kind"]:
        places = added[kind]
        to_added = line_clearance(places.footprint, candidates[places.scene])[..., 0]
        chosen = path_at_doses(to_added, to_others[places.scene], doses, CLEAR_OF_OTHERS_M)  # (row, dose)
        paths = np.take_along_axis(candidates[places.scene], np.maximum(chosen, 0)[..., None, None], axis=1)
        falls = [
            model.probability(places.seen, paths) - model.probability(places.seen_with, paths).astype(float)
            for model in fitted.fold_models
        ]
        response = by_item(np.where(chosen >= 0, np.stack(falls), np.nan), places.scene)  # (model, scene, dose)
        middle = response.mean(0)
        response = middle + (len(response) - 1) * (response - middle)
        has_dose = (~np.isnan(middle)).sum(0) >= 2
        count = len(doses) if has_dose.all() else int(has_dose.argmin())
        if count >= 3:
            distances = [value / folder.frame.scale for value in radius(response[..., :count], doses[:count])]
            rows.append((fitted.data.user, kind, *distances, int((~np.isnan(response[0, :, 0])).sum())))
    return pd.DataFrame(rows, columns=["user", "kind", "radius_m", "ci_low", "ci_high", "scenes"])


def random_paths(
    rng: np.random.Generator, folder: Folder, rows: int, count: int, points: int = PATH_SAMPLES
) -> Float[Array, "row path point 2"]:
    """Draw paths [m of the model]: demonstrated ones of any scene and user, inner control points moved at random."""
    shown = folder.controls()
    return bezier(bent(rng, shown[rng.integers(len(shown), size=(rows, count))], SPREAD_M), points)


def bent(
    rng: np.random.Generator, controls: Float[Array, "*path control 2"], spread_m: float
) -> Float[Array, "*path control 2"]:
    """Return control points [m], the inner ones moved at random by this standard deviation in each coordinate."""
    moves = spread_m * rng.standard_normal(controls.shape)
    moves[..., [0, -1], :] = 0
    return controls + moves


def ends_of_paths(folder: Folder) -> dict[str, Float[Array, "end 2"]]:
    """Return where demonstrated paths begin and end in each scene [m of the model]; none where nobody showed any."""
    controls, scenes = folder.controls(), folder.demos["scene"].to_numpy()
    return {name: controls[scenes == name][:, [0, -1]].reshape(-1, 2) for name in folder.scenes}
