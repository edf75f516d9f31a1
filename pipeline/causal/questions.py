"""Translate the questions of conf/questions into interventions on the structural causal model, scene by scene."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray as Array

from pipeline.causal.question_settings import Add, Move, Question, Remove, Swap, TableTop, User
from pipeline.causal.scm import Values
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import (
    EMPTY,
    SYMBOLS,
    Items,
    LayoutRules,
    Layouts,
    add_item,
    point_segment_distance,
    segment_distance,
)

TRIES = 100  # random proposals for a moved or swapped item before its scene is left out
MIN_SCENES = 2  # fewest scenes from which a question's standard error can be estimated


@dataclass(frozen=True)
class Scenes:
    """The scenes of the questions, and the catalogue from which added items are drawn.

    items: the catalogue's footprints; pool: the rows of items.csv to draw from; textures: names of the catalogue's.
    """

    layouts: Layouts
    items: Items
    pool: Int[Array, " pool"]
    rules: LayoutRules
    textures: list[str]


@dataclass(frozen=True)
class Change:
    """do(O := ...) or do(T := ...), one entry per placement, in the `scenes` to which the question applies.

    The other scenes stay unchanged. Without placements it is do(S := s'), which the stage evaluates with user s'.
    """

    placements: list[Values]
    scenes: Bool[Array, " scene"]


def change(
    name: str, question: Question, scenes: Scenes, additions: Mapping[str, list[Layouts]], rng: np.random.Generator
) -> Change:
    """Return the interventions of one question.

    additions: symbol -> the scenes with an added item, one entry per placement. InputError if the question applies to
    fewer than MIN_SCENES scenes, or if the texture is unknown.
    """
    every = np.ones(len(scenes.layouts), dtype=bool)
    match question:
        case Add():
            return Change([{"O": layouts} for layouts in additions[question.symbol]], every)
        case User():
            return Change([], every)
        case TableTop():
            if question.texture not in scenes.textures:
                known = ", ".join(scenes.textures)
                raise InputError(f"question {name}: unknown texture {question.texture!r}; data/ has {known}")
            return Change([{"T": np.full(len(every), question.texture)}], every)
    slot, has_symbol = _pick(rng, scenes.layouts, question.symbol)
    match question:
        case Remove():
            layouts, possible = _with_slot(scenes.layouts, slot, has_symbol, item=EMPTY, symbol=EMPTY), has_symbol
        case Move():
            layouts, possible = _propose(scenes, slot, has_symbol, lambda: _moved(rng, scenes, slot, question.distance))
        case Swap():
            layouts, possible = _propose(scenes, slot, has_symbol, lambda: _swapped(rng, scenes, slot, question.to))
    if possible.sum() < MIN_SCENES:
        raise InputError(
            f"question {name}: {possible.sum()} scenes allow it, expected at least {MIN_SCENES}; "
            f"ask about another symbol than {question.symbol}, a smaller distance or more scenes"
        )
    return Change([{"O": layouts}], possible)


def draw_additions(rng: np.random.Generator, scenes: Scenes, placements: int) -> dict[str, list[Layouts]]:
    """Return the scenes with a random item of each symbol added, `placements` times."""
    return {
        symbol: [
            add_item(rng, scenes.layouts, index, scenes.items, scenes.pool, scenes.rules) for _ in range(placements)
        ]
        for index, symbol in enumerate(SYMBOLS)
    }


def allowed(layouts: Layouts, slot: Int[Array, " scene"], rules: LayoutRules) -> Bool[Array, " scene"]:
    """Return whether the item in `slot` keeps the rules for drawing scenes: in range, clear of items and path ends."""
    index = np.arange(len(slot)), slot
    segment, radius, centre = layouts.ends[index], layouts.radius[index], layouts.centre[index]
    others = layouts.present.copy()
    others[index] = False
    gaps = segment_distance(segment[:, None], layouts.ends) - layouts.radius - radius[:, None]
    from_ends = [point_segment_distance(p, segment[:, 0], segment[:, 1]) - radius for p in (P_INIT, P_F)]
    return (
        ((centre >= rules.centre_low) & (centre <= rules.centre_high)).all(-1)
        & (np.where(others, gaps, np.inf).min(-1) >= rules.clear_of_items)
        & (np.min(from_ends, axis=0) >= rules.clear_of_ends)
    )


def _pick(
    rng: np.random.Generator, layouts: Layouts, symbol: str
) -> tuple[Int[Array, " scene"], Bool[Array, " scene"]]:
    """Return the slot of a random item of the symbol in each scene, and whether the scene has one."""
    matches = layouts.symbol == SYMBOLS.index(symbol)
    return np.where(matches, rng.random(matches.shape), -1.0).argmax(1), matches.any(1)


def _propose(
    scenes: Scenes, slot: Int[Array, " scene"], pending: Bool[Array, " scene"], draw: Callable[[], Layouts]
) -> tuple[Layouts, Bool[Array, " scene"]]:
    """Return each scene's first proposal that keeps the rules, and whether one was found within TRIES."""
    accepted, layouts = np.zeros_like(pending), scenes.layouts
    for _ in range(TRIES):
        proposal = draw()
        fits = pending & ~accepted & allowed(proposal, slot, scenes.rules)
        layouts, accepted = _choose(fits, proposal, layouts), accepted | fits
    return layouts, accepted


def _moved(rng: np.random.Generator, scenes: Scenes, slot: Int[Array, " scene"], distance: float) -> Layouts:
    """Return the scenes with the item in `slot` moved by `distance` [m] in a random direction."""
    angle = rng.uniform(-np.pi, np.pi, len(slot))
    centre = scenes.layouts.centre[np.arange(len(slot)), slot]
    step = distance * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return _with_slot(scenes.layouts, slot, np.ones(len(slot), bool), centre=centre + step)


def _swapped(rng: np.random.Generator, scenes: Scenes, slot: Int[Array, " scene"], symbol: str) -> Layouts:
    """Return the scenes with the item in `slot` replaced by a random item of the symbol at a random angle."""
    index = SYMBOLS.index(symbol)
    item = rng.choice(scenes.pool[scenes.items.symbol[scenes.pool] == index], len(slot))
    scale = rng.uniform(scenes.rules.scale_low, scenes.rules.scale_high, len(slot))
    return _with_slot(
        scenes.layouts, slot, np.ones(len(slot), bool), item=item, symbol=index, scale=scale,
        angle=rng.uniform(-np.pi, np.pi, len(slot)), half_length=scenes.items.half_length[item] * scale,
        radius=scenes.items.radius[item] * scale,
    )  # fmt: skip


def _with_slot(layouts: Layouts, slot: Int[Array, " scene"], where: Bool[Array, " scene"], **values) -> Layouts:
    """Return a copy with these values for the item in `slot`, in the scenes of the mask `where`."""
    copy = Layouts(*(getattr(layouts, f.name).copy() for f in fields(layouts)))
    for name, value in values.items():
        array = getattr(copy, name)
        array[np.arange(len(slot))[where], slot[where]] = value[where] if isinstance(value, np.ndarray) else value
    return copy


def _choose(where: Bool[Array, " scene"], a: Layouts, b: Layouts) -> Layouts:
    """Return the scenes of `a` where the mask is true, else those of `b`."""
    order = np.arange(len(where))
    both = Layouts(*(np.concatenate([getattr(a, f.name), getattr(b, f.name)]) for f in fields(a)))
    return both[np.where(where, order, order + len(where))]
