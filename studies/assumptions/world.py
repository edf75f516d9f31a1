"""The confounded world: glasses stand next to plates, so that plates go with invalid paths without any effect."""

from typing import Annotated

import numpy as np
from jaxtyping import Bool, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf
from pydantic import AfterValidator, Field
from scipy.stats import t as student

from pipeline.artifacts.scenes import train_pool
from pipeline.runtime import settings
from pipeline.runtime.settings import Count, Group, Length, Pair, Share, Whole
from pipeline.runtime.streams import stream
from pipeline.stats.tests import LEVEL
from pipeline.world import layout
from pipeline.world.layout import SYMBOLS, Items, LayoutRules, Layouts
from pipeline.world.render import ImageSource, read_palette, render_scenes

GLASS, PLATE = SYMBOLS.index("glass"), SYMBOLS.index("plate")  # a common cause of plates and glasses
OTHERS = [symbol for symbol in range(len(SYMBOLS)) if symbol not in (GLASS, PLATE)]
GAP_TOLERANCE_M = 1e-6  # accepted error of a gap between plate and glass


class World(Group):
    """Plates and glasses of the confounded world, and of its control."""

    root_seed: Whole
    p_common_cause: settings.Chance
    doses: Annotated[list[settings.Chance], Field(min_length=2), AfterValidator(settings.rising)]
    gap_m: Pair
    present: Share
    glasses: Count
    near_m: Length


def association_strength(
    invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"], cause: Bool[Array, "scene path"]
) -> dict[str, float]:
    """Return `risk_ratio`, P(invalid | near) / P(invalid | not near), its `e_value`, and the cause's `bias_factor`.

    e_value: how strongly, as a risk ratio, a hidden common cause must go with both for it to explain all of the ratio
    (VanderWeele and Ding, 2017, doi 10.7326/M16-2607). bias_factor: the largest ratio that passing near the `cause` can
    explain, by its own two ratios (Ding and VanderWeele, 2016, Epidemiology 27(3), 368-377). Ratios below 1 are
    turned over; what is infinite or undefined is NaN.
    """

    def ratio(outcome: Array, exposed: Array) -> float:
        one, other = (np.float64(outcome[side].mean() if side.any() else np.nan) for side in (exposed, ~exposed))
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(one / other)

    found = ratio(invalid, near)
    found = found if np.isfinite(found) else np.nan
    above = max(found, 1 / found) if found > 0 else np.nan
    with_near, with_invalid = ratio(cause, near), ratio(invalid, cause)
    inverse = 0.0
    if min(with_near, with_invalid) >= 1:  # also of infinite ones
        inverse = 1 / with_near + 1 / with_invalid - 1 / (with_near * with_invalid)
    bias = 1 / inverse if inverse > 0 else np.nan
    return {"risk_ratio": found, "e_value": float(above + np.sqrt(above * (above - 1))), "bias_factor": bias}


def association(invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"]) -> dict[str, float]:
    """Return `difference`, P(invalid | near) - P(invalid | not near), with its 95 % interval.

    Paths of a scene are dependent, scenes are independent. The standard error is the jackknife's over scenes (Efron and
    Stein, 1981), and the interval is Student's. All is NaN if, without some scene, all paths or none pass near.
    """
    table = np.stack([(x & w).sum(1) for w in (near, ~near) for x in (invalid, np.ones_like(invalid))])
    without = table.sum(1, keepdims=True) - table  # (count, scene): each scene left out in turn
    if (without[[1, 3]] == 0).any():
        return dict.fromkeys(("difference", "ci_low", "ci_high"), np.nan)
    near_rate, far_rate = (float(table[i].sum() / table[i + 1].sum()) for i in (0, 2))
    difference, scenes = near_rate - far_rate, len(invalid)
    jackknife = without[0] / without[1] - without[2] / without[3]
    error = np.sqrt((scenes - 1) / scenes * ((jackknife - jackknife.mean()) ** 2).sum())
    half_width = float(student.ppf(1 - LEVEL / 2, scenes - 1) * error)
    return {"difference": difference, "ci_low": difference - half_width, "ci_high": difference + half_width}


def draw_scenes(cfg: DictConfig, key: tuple[float, int]) -> tuple[Layouts, UInt8[Array, "scene 100 100 3"]]:
    """Draw a seed's training scenes at a dose; textures, lights and cameras do not depend on the dose."""
    (p_common_cause, seed), count = key, cfg.scenes.per_seed
    world = World.model_validate(OmegaConf.to_container(cfg.studies.assumptions.world))
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    rng, rules = stream(world.root_seed, "scenes", train_pool(seed)), LayoutRules.of(cfg.scenes.layout)
    items = catalogue.footprints, catalogue.pool("train")
    layouts = layout.concatenated([lay_out(r, *items, rules, world, p_common_cause) for r in rng.spawn(count)])
    textures, seeds = rng.choice(catalogue.texture_names("train"), count), rng.integers(2**31, size=count)
    return layouts, render_scenes(layouts, list(textures), seeds.tolist(), palette)


def lay_out(
    rng: np.random.Generator, items: Items, pool: Int[Array, " n"], rules: LayoutRules, world: World, p_common: float
) -> Layouts:
    """Draw one scene with items of `pool` (catalogue rows): a plate, glasses, and bowls and cutlery.

    With probability `p_common` plate and glasses have a common cause: glasses stand beside the plate, or both are
    missing. Else they are drawn independently. The frequency of each symbol does not depend on `p_common`. The
    plate and all glasses together count as one item each of `items_per_scene`. All items are drawn before any is
    placed, even items that turn out not to be needed.
    """
    common_cause = rng.uniform() < p_common
    plate, independent_glasses = (bool(rng.uniform() < world.present) for _ in range(2))
    glasses = plate if common_cause else independent_glasses
    count = max(0, int(rng.choice(rules.items_per_scene)) - plate - glasses)
    others = rng.choice(OTHERS, count).tolist()
    laid = [PLATE] * plate + [GLASS] * (world.glasses * glasses)
    while True:
        scene = layout.empty(1, rules.slots)
        for slot, symbol in enumerate(laid):
            scene = layout.add_item(rng, scene, symbol, items, pool, rules)
            if common_cause and symbol == GLASS and not move_beside_first(rng, scene, slot, rules, world):
                break
        else:
            break
    for symbol in others:
        scene = layout.add_item(rng, scene, symbol, items, pool, rules)
    return scene


def move_beside_first(rng: np.random.Generator, scene: Layouts, slot: int, rules: LayoutRules, world: World) -> bool:
    """Move the item in `slot` along the line to the item in slot 0 until their gap is a random one.

    A step by the excess of the gap never overshoots. Return False if the item then violates a minimum distance or lies
    outside the range of centres.
    """

    def gap_between() -> float:
        return float(layout.segment_distance(*scene.ends[0, [slot, 0]]) - scene.radius[0, slot] - scene.radius[0, 0])

    gap = rng.uniform(world.gap_m[0], world.gap_m[1])
    towards = scene.centre[0, 0] - scene.centre[0, slot]
    towards /= np.linalg.norm(towards)
    while abs(excess := gap_between() - gap) > GAP_TOLERANCE_M:
        scene.centre[0, slot] += excess * towards
    return bool(layout.allowed(scene, np.array([slot]), rules)[0])
