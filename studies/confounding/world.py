"""Layouts of a world in which glasses stand next to plates, so that plates are associated with invalid paths.

With probability `p_common_cause`, a common cause decides on a scene's plate and glasses: the glasses stand next to the
plate, or both are missing. In the other scenes, plate and glasses are drawn independently. The frequency of each symbol
does not depend on `p_common_cause`, so this parameter changes only the strength of the confounding.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Int
from numpy import ndarray as Array

from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import (
    SYMBOLS,
    Items,
    LayoutRules,
    Layouts,
    add_item,
    empty,
    point_segment_distance,
    segment_distance,
)

GLASS, PLATE = SYMBOLS.index("glass"), SYMBOLS.index("plate")
OTHERS = [symbol for symbol in range(len(SYMBOLS)) if symbol not in (GLASS, PLATE)]
CONFOUNDED, CONTROL = "confounded", "control"  # the world of the results, and the world without a common cause
GAP_TOLERANCE_M = 1e-6  # accepted error of a gap


@dataclass(frozen=True)
class Confounding:
    """Parameters of plates and glasses (conf/studies/confounding.yaml)."""

    p_common_cause: float  # probability that a scene's plate and glasses have a common cause
    present: float  # probability of a plate in a scene, and of glasses
    glasses: int  # number of glasses in a scene that has any
    gap_low: float  # gap between the footprints of a plate and a glass next to it: uniform between these [m]
    gap_high: float


def confounded_layouts(
    rng: np.random.Generator,
    scenes: int,
    items: Items,
    pool: Int[Array, " pool"],
    rules: LayoutRules,
    confounding: Confounding,
) -> Layouts:
    """Draw scenes with items of `pool` (catalogue rows): a plate, glasses, and bowls and cutlery.

    The plate and all glasses together count as one item each of `items_per_scene`. Each scene has its own generator, so
    that another `p_common_cause` changes only the scenes that gain or lose the common cause.
    """
    drawn = [_scene(scene_rng, items, pool, rules, confounding) for scene_rng in rng.spawn(scenes)]
    return Layouts(*(np.concatenate([getattr(scene, f.name) for scene in drawn]) for f in fields(Layouts)))


def _scene(rng, items: Items, pool: Array, rules: LayoutRules, confounding: Confounding) -> Layouts:
    """Draw one scene. All items are drawn before any is placed, even items that turn out not to be needed."""
    common_cause = rng.uniform() < confounding.p_common_cause
    plate, independent_glasses = (bool(rng.uniform() < confounding.present) for _ in range(2))
    glasses = plate if common_cause else independent_glasses
    count = max(0, int(rng.choice(rules.items_per_scene)) - plate - glasses)
    others = rng.choice(OTHERS, count).tolist()
    laid = [PLATE] * plate + [GLASS] * (confounding.glasses * glasses)
    while True:
        scene = empty(1, rules.slots)
        for slot, symbol in enumerate(laid):
            scene = add_item(rng, scene, symbol, items, pool, rules)
            if common_cause and symbol == GLASS and not _beside_first(rng, scene, slot, rules, confounding):
                break
        else:
            break
    for symbol in others:
        scene = add_item(rng, scene, symbol, items, pool, rules)
    return scene


def _beside_first(rng, scene: Layouts, slot: int, rules: LayoutRules, confounding: Confounding) -> bool:
    """Move the item in `slot` along the line to the item in slot 0 until their gap is a random one.

    A step by the excess of the gap never overshoots. Return False if the item then violates a minimum distance or lies
    outside the range of centres.
    """
    gap = rng.uniform(confounding.gap_low, confounding.gap_high)
    towards = scene.centre[0, 0] - scene.centre[0, slot]
    towards /= np.linalg.norm(towards)
    while abs(excess := _gaps(scene, slot)[0] - gap) > GAP_TOLERANCE_M:
        scene.centre[0, slot] += excess * towards
    centre, ends = scene.centre[0, slot], scene.ends[0, slot]
    from_ends = min(point_segment_distance(p, *ends) for p in (P_INIT, P_F)) - scene.radius[0, slot]
    inside = ((centre >= rules.centre_low) & (centre <= rules.centre_high)).all()
    return bool(inside and from_ends >= rules.clear_of_ends and (_gaps(scene, slot)[1:] >= rules.clear_of_items).all())


def _gaps(scene: Layouts, slot: int) -> Array:
    """Return the gap [m] between the footprint of the item in `slot` and that of each item before it."""
    apart = segment_distance(scene.ends[0, slot], scene.ends[0, :slot])
    return apart - scene.radius[0, slot] - scene.radius[0, :slot]
