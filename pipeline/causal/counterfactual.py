"""Which item a rejected path owes its rejection to: questions to one table, one path and one user at a time.

The effect is V = 0, its possible causes X_j that item j stands where it does; the noise of V is held
(pipeline.causal.scm). Tian and Pearl's probabilities of causation (2000; Pearl, 2009, Definitions 9.2.1 and 9.2.2):

    PN_j = P(V_{O without j} = 1 | V = 0)             necessity: but for j the path would be valid
    PS_j = P(V_{j alone} = 0 | V_{empty table} = 1)   sufficiency: j put on the empty table makes it invalid

PN is asked on the table as it stands, PS with every other item away: where two items each forbid a path, V = 0 on
the table without either as well, and what j would do to a path that is valid there is a question about no unit at all.
So one item to blame shows as PN = PS = 1, and overdetermination as PN = 0 for all and PS = 1 for several.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.causal.interventions import DIGITS
from pipeline.causal.scm import chance_of_change
from pipeline.stats.crossed import ratio
from pipeline.world.bezier import P_F, P_INIT, curve
from pipeline.world.layout import EMPTY, SYMBOLS, LayoutRules, Layouts, point_segment_distance, segment_distance
from pipeline.world.rules import SAMPLES

NOBODY = -1  # in the place of a slot: no single item is to blame
FEWEST = 30  # pairs of seed and scene that have something to count ...
SCENES = 10  # ... and scenes: below, no interval (Cochran, 1977, Chapter 6)
DECISION = 0.5  # a path is called valid if its probability exceeds it; a probability above it: more likely than not


@dataclass(frozen=True)
class Removals:
    """One quantity on four kinds of table: as it stands, empty, without each item, with it alone.

    In an empty slot, "without" is the table as it stands and "alone" the empty table.
    """

    whole: Float[Array, "*b scene path"]
    empty: Float[Array, "*b scene path"]
    without: Float[Array, "*b scene path slot"]
    alone: Float[Array, "*b scene path slot"]

    @property
    def necessity(self) -> Float[Array, "*b scene path slot"]:
        """PN_j from P(valid); 0 in empty slots, NaN where the path cannot be invalid."""
        return chance_of_change(False, self.whole[..., None], self.without)

    @property
    def sufficiency(self) -> Float[Array, "*b scene path slot"]:
        """PS_j from P(valid); 0 in empty slots, NaN where the path cannot be valid on the empty table."""
        return chance_of_change(True, self.empty[..., None], self.alone)


@dataclass(frozen=True)
class Tables:
    """The distinct tables behind the questions about some scenes, each one once (in a scene of two items,
    without the one is the other alone)."""

    scene: Int[Array, " table"]
    kept: Bool[Array, "table slot"]  # the items left on it
    index: Int[Array, "scene question"]  # table; questions: whole, empty, without each slot, each slot alone

    def fold(self, values: Float[Array, "*b table path"]) -> Removals:
        """What was asked of every table, by question."""
        asked = np.moveaxis(np.asarray(values, dtype=np.float64)[..., self.index, :], -2, -1)  # (..., scene, path, q)
        slots = self.kept.shape[1]
        return Removals(asked[..., 0], asked[..., 1], asked[..., 2 : 2 + slots], asked[..., 2 + slots :])


def removals(present: Bool[Array, "scene slot"]) -> Tables:
    """The tables to ask about, for scenes with items in the slots that are `present`."""
    scenes, slots = present.shape
    one = np.eye(slots, dtype=bool)
    masks = np.concatenate([np.ones((1, slots), bool), np.zeros((1, slots), bool), ~one, one])  # (question, slot)
    kept = present[:, None] & masks  # (scene, question, slot)
    scene = np.broadcast_to(np.arange(scenes)[:, None, None], (*kept.shape[:2], 1))
    rows = np.concatenate([scene, kept], axis=-1).reshape(-1, 1 + slots)
    tables, index = np.unique(rows, axis=0, return_inverse=True)
    return Tables(tables[:, 0], tables[:, 1:].astype(bool), index.reshape(scenes, -1))


def keep(layouts: Layouts, kept: Bool[Array, "scene slot"]) -> Layouts:
    """The same scenes with the items of the other slots taken away."""
    return replace(layouts, item=np.where(kept, layouts.item, EMPTY), symbol=np.where(kept, layouts.symbol, EMPTY))


def blame(necessity: Float[Array, "*b slot"]) -> Int[Array, "*b"]:
    """The slot whose PN is largest; NOBODY if several share it, or none has any."""
    most = necessity.max(-1, keepdims=True)
    single = (most[..., 0] > 0) & ((necessity == most).sum(-1) == 1)
    return np.where(single, necessity.argmax(-1), NOBODY)


def nulls(
    culprit: Int[Array, "scene path"],
    present: Bool[Array, "scene slot"],
    symbol: Int[Array, "scene slot"],
    clearances: Float[Array, "scene path slot"],
) -> dict[str, Float[Array, "scene path"]]:
    """The chance that whoever blames an item without any model hits the culprit; 0 where there is none.

    random: any present item; nearest: the one with the least clearance [m]; base_rate: one drawn in proportion to how
    often items of its symbol are the culprit when they are present (the truth's own rates on these very paths).
    """
    hit = culprit[..., None] == np.arange(present.shape[1])  # (scene, path, slot)
    blamed = hit.any(-1)  # (scene, path)
    stands = np.broadcast_to(np.where(present, symbol, EMPTY)[:, None], hit.shape)
    hits, chances = (
        np.bincount(stands[x & (stands != EMPTY)], minlength=len(SYMBOLS)) for x in (hit, blamed[..., None])
    )
    weight = np.where(present, (hits / np.maximum(chances, 1))[symbol], 0.0)
    share = weight / np.maximum(weight.sum(-1, keepdims=True), np.finfo(float).tiny)  # (scene, slot)
    return {
        "random": blamed / np.maximum(present.sum(-1, keepdims=True), 1),
        "nearest": (blamed & (culprit == clearances.argmin(-1))).astype(float),
        "base_rate": np.where(hit, share[:, None], 0.0).sum(-1),
    }


def study(
    model: Removals,
    truth: Removals,
    present: Bool[Array, "scene slot"],
    chances: Mapping[str, Float[Array, "scene path"]],
) -> dict | None:
    """How well models, (seed, scene, path), tell what the truth, (scene, path), owes its rejections to.

    Over the paths that both reject: None if there is none. `single`: the share with a single culprit. Over these, how
    often the model blames it (`blame_right`; `blame_sure`: with PN above one half; `named`: how often it blames any
    item at all), beside each null of `chances` (`null_...`; `over_...`: the model's lead over it). Over the others, how
    often it finds each of several culprits enough and none necessary, all probabilities on the right side of one half
    (`several_right`). Over all their items, the mean absolute errors of PN and PS beside the best constant's
    (`..._null`). `empty_rejected`: the share of the paths that the model rejects on the empty table too.
    Intervals are Student's over seeds crossed with scenes (pipeline.stats.crossed.ratio); `blame_right` has
    `ci_low` and `ci_high`, each other name its own.
    """
    pn, ps, true_pn, true_ps = model.necessity, model.sufficiency, truth.necessity, truth.sufficiency
    culprit = blame(true_pn)
    invalid = np.broadcast_to(truth.whole == 0, model.whole.shape)
    rejected = invalid & (model.whole <= DECISION)
    if not rejected.any():
        return None
    single, several = rejected & (culprit != NOBODY), rejected & (culprit == NOBODY)
    hit = culprit[..., None] == np.arange(present.shape[1])
    likely = np.where(hit, pn, 0.0).sum(-1) > DECISION
    blamed = blame(pn)
    right = blamed == culprit
    as_true = ((ps > DECISION) == (true_ps > DECISION)) & (pn <= DECISION)
    items = rejected[..., None] & present[:, None]
    pn_known, ps_known = items & np.isfinite(pn), items & np.isfinite(ps)
    questions = {
        "blame_right": (right, single), "blame_sure": (right & likely, single), "named": (blamed != NOBODY, single),
        "several_right": (as_true.all(-1), several), "empty_rejected": (model.empty <= DECISION, rejected),
        "pn_error": (np.abs(pn - true_pn), pn_known), "ps_error": (np.abs(ps - true_ps), ps_known),
    }  # fmt: skip
    for null, chance in chances.items():
        questions |= {f"null_{null}": (chance, single), f"over_{null}": (right - chance, single)}
    cell = {
        "rejected": rounded(rejected.sum() / len(rejected)),
        "recall": rounded(rejected.sum() / invalid.sum()),
        "single": rounded(single.sum() / rejected.sum()),
        "pn_null": _constant_error(np.broadcast_to(true_pn, pn.shape)[pn_known]),
        "ps_null": _constant_error(np.broadcast_to(true_ps, ps.shape)[ps_known]),
    }
    for name, (value, asked) in questions.items():
        cell |= _mean(name, value, asked, not name.startswith("null_"))
    return cell


def _mean(name: str, value: Array, asked: Array, interval: bool = True) -> dict[str, float | None]:
    """Mean of `value`, (seed, scene, ...), where it is `asked`, and its interval, kept within [0, 1] for a share;
    None where nothing is asked, or too little for an interval."""
    ends = ["ci_low", "ci_high"] if name == "blame_right" else [f"{name}_ci_low", f"{name}_ci_high"]
    names = [name, *ends] if interval else [name]
    if not asked.any():
        return dict.fromkeys(names)
    axes = tuple(range(2, asked.ndim))
    count = asked.sum(axes)
    e = ratio(np.where(asked, value, 0.0).sum(axes)[None], count[None].astype(float))
    found = np.array([e.effect[0], e.ci_low[0], e.ci_high[0]])
    found = found.clip(0, 1) if value.dtype == bool else found
    enough = (count > 0).sum() >= FEWEST and (count > 0).any(0).sum() >= SCENES
    known = 3 if enough else 1
    return dict.fromkeys(names) | {n: rounded(x) for n, x in zip(names, found[:known], strict=False)}


def _constant_error(truth: Float[Array, " item"]) -> float | None:
    """Mean absolute error of the best constant answer to what is 0 or 1."""
    return rounded(min(truth.mean(), 1 - truth.mean())) if len(truth) else None


def rounded(value: float) -> float:
    """As every reported number is."""
    return round(float(value), DIGITS) + 0.0  # + 0.0: never -0.0


def away(layouts: Layouts, slot: Int[Array, " case"], z_theta: Float[Array, "case 2"]) -> Float[Array, "case 2"]:
    """Unit normal of each path at its point nearest the centre of the item in `slot`, on the side of that centre."""
    points, case = curve(z_theta, SAMPLES), np.arange(len(slot))
    offset = layouts.centre[case, slot][:, None] - points  # (case, sample, 2)
    nearest = case, np.linalg.norm(offset, axis=-1).argmin(-1)
    along = np.gradient(points, axis=1)[nearest]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    side = (normal * offset[nearest]).sum(-1, keepdims=True)
    return np.where(side < 0, -normal, normal)


def slide(
    layouts: Layouts, slot: Int[Array, " case"], direction: Float[Array, "case 2"], distance: Float[Array, " step"]
) -> Layouts:
    """Each scene with the item in `slot` moved by each distance [m]: (case * step), steps varying fastest."""
    case = np.repeat(np.arange(len(layouts)), len(distance))
    moved = layouts[case]
    moved.centre[np.arange(len(case)), slot[case]] += direction[case] * np.tile(distance, len(layouts))[:, None]
    return moved


def fits(layouts: Layouts, slot: Int[Array, " scene"], rules: LayoutRules) -> Bool[Array, " scene"]:
    """Whether the item in `slot` stands where scenes may have one: within the centres' range, clear of all else."""
    at = np.arange(len(slot)), slot
    own, radius, centre = layouts.ends[at], layouts.radius[at], layouts.centre[at]
    others = layouts.present.copy()
    others[at] = False
    gaps = segment_distance(own[:, None], layouts.ends) - layouts.radius - radius[:, None]
    to_ends = [point_segment_distance(p, own[:, 0], own[:, 1]) - radius for p in (P_INIT, P_F)]
    return (
        ((centre >= rules.centre_low) & (centre <= rules.centre_high)).all(-1)
        & (np.where(others, gaps, np.inf).min(-1) >= rules.clear_of_items)
        & (np.min(to_ends, axis=0) >= rules.clear_of_ends)
    )


def crossing(distance: Float[Array, " step"], value: Float[Array, "*b step"], threshold: float) -> Float[Array, "*b"]:
    """First distance at which `value` exceeds the threshold, linear between steps; NaN if it never does."""
    above = value > threshold
    after = above.argmax(-1)[..., None]
    before = np.maximum(after - 1, 0)
    low, high = (np.take_along_axis(value, i, -1)[..., 0] for i in (before, after))
    share = (threshold - low) / np.where(high > low, high - low, 1.0)
    start, end = distance[before[..., 0]], distance[after[..., 0]]
    return np.where(above.any(-1), start + np.clip(share, 0.0, 1.0) * (end - start), np.nan)


def move_study(
    found_m: Float[Array, "seed case"], rejected: Bool[Array, "seed case"], true_m: Float[Array, " case"]
) -> dict | None:
    """The models' least moves [m], NaN if none was found, beside the true ones; over the cases they reject at first.

    `found`: the share of these that some move makes acceptable; over those the mean absolute error, the mean error
    (`bias_m`), and the error of the best constant (`null_error_m`). None below two cases, or if none is rejected.
    """
    if len(true_m) < 2 or not rejected.any():
        return None
    found = rejected & np.isfinite(found_m)
    constant = np.abs(true_m - np.median(true_m))
    return (
        {"cases": len(true_m), "true_m": rounded(true_m.mean()), "rejected": rounded(rejected.mean())}
        | _mean("found", np.isfinite(found_m), rejected)
        | _mean("error_m", np.abs(found_m - true_m), found)
        | _mean("bias_m", found_m - true_m, found)
        | _mean("null_error_m", np.broadcast_to(constant, found.shape), found, interval=False)
    )


def unlike(
    rejected: Bool[Array, "user scene path"], culprit: Int[Array, "user scene path"]
) -> tuple[Bool[Array, "scene path"], Bool[Array, "scene path"]]:
    """Where the first two users disagree on whom to blame: both reject a path, not for the same item; and
    the first rejects it for a single item where the second accepts it."""
    return (
        rejected[0] & rejected[1] & (culprit[0] != culprit[1]),
        rejected[0] & (culprit[0] != NOBODY) & ~rejected[1],
    )


def first(where: Bool[Array, "scene path"], but: Sequence[int]) -> tuple[int, int] | None:
    """The first scene, other than those of `but`, and in it the first path; None if there is none."""
    scene, path = np.nonzero(where)
    free = ~np.isin(scene, but)
    return (int(scene[free][0]), int(path[free][0])) if free.any() else None
