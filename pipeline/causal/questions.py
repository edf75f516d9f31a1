"""The causal questions of conf/questions/<name>.yaml, one change per file, and the interventions that they ask for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray as Array
from pydantic import Field, model_validator

from pipeline.causal.scm import Values
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Group, Length, Name, need
from pipeline.world.layout import EMPTY, SYMBOLS, Items, LayoutRules, Layouts, add_item, allowed, concatenated

TRIES = 100  # random proposals for a moved or swapped item before its scene is left out
MIN_SCENES = 2  # fewest scenes from which a question's standard error can be estimated

Symbol = Annotated[str, Field(pattern=f"^({'|'.join(SYMBOLS)})$")]


class _Question(Group):
    family: Name | None = None  # questions of one family share Holm's correction; null: a family of its own


class Add(_Question):
    kind: Literal["add"]
    symbol: Symbol


class Remove(_Question):
    kind: Literal["remove"]
    symbol: Symbol


class Move(_Question):
    kind: Literal["move"]
    symbol: Symbol
    distance: Length


class Swap(_Question):
    kind: Literal["swap"]
    symbol: Symbol
    to: Symbol

    @model_validator(mode="after")
    def _differs(self) -> "Swap":
        need(self.to != self.symbol, "to", self.to, f"another symbol than {self.symbol}")
        return self


class TableTop(_Question):
    kind: Literal["table_top"]
    texture: str


class User(_Question):
    kind: Literal["user"]
    to: Name | None


Question = Annotated[Add | Remove | Move | Swap | TableTop | User, Field(discriminator="kind")]


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


def change(
    name: str, question: Question, scenes: Scenes, additions: Mapping[str, list[Layouts]], rng: np.random.Generator
) -> tuple[list[Values], Bool[Array, " scene"]]:
    """Return do(O := ...) or do(T := ...), one entry per placement, and the scenes to which the question applies.

    The other scenes stay unchanged. No entry: the question is do(S := s'), which the stage evaluates with user s'.
    additions: symbol -> the scenes with an added item, one entry per placement. InputError if the question applies to
    fewer than MIN_SCENES scenes, or if the texture is unknown.
    """
    layouts, count, items, rules = scenes.layouts, len(scenes.layouts), scenes.items, scenes.rules
    match question:
        case Add():
            return [{"O": added} for added in additions[question.symbol]], np.ones(count, dtype=bool)
        case User():
            return [], np.ones(count, dtype=bool)
        case TableTop():
            if question.texture not in scenes.textures:
                known = ", ".join(scenes.textures)
                raise InputError(f"question {name}: unknown texture {question.texture!r}; data/ has {known}")
            return [{"T": np.full(count, question.texture)}], np.ones(count, dtype=bool)

    matches = layouts.symbol == SYMBOLS.index(question.symbol)
    slot = np.where(matches, rng.random(matches.shape), -1.0).argmax(1)  # of a random item of the symbol
    accepted, changed = np.zeros(count, dtype=bool), layouts
    for _ in range(TRIES):
        values: dict[str, Array | int]
        match question:
            case Remove():
                values = {"item": EMPTY, "symbol": EMPTY}
            case Move():  # by the distance [m] in a random direction
                angle = rng.uniform(-np.pi, np.pi, count)
                step = question.distance * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
                values = {"centre": layouts.centre[np.arange(count), slot] + step}
            case Swap():  # for a random item of the other symbol, at a random angle
                index = SYMBOLS.index(question.to)
                item = rng.choice(scenes.pool[items.symbol[scenes.pool] == index], count)
                scale = rng.uniform(rules.scale_low, rules.scale_high, count)
                values = {"item": item, "symbol": index, "scale": scale, "angle": rng.uniform(-np.pi, np.pi, count)}
                values |= {"half_length": items.half_length[item] * scale, "radius": items.radius[item] * scale}
        proposal = replace(layouts, **{field: getattr(layouts, field).copy() for field in values})
        for field, value in values.items():
            getattr(proposal, field)[np.arange(count), slot] = value
        fits = matches.any(1) & ~accepted & (isinstance(question, Remove) | allowed(proposal, slot, rules))
        changed = concatenated([proposal, changed])[np.where(fits, 0, count) + np.arange(count)]
        accepted |= fits
    if accepted.sum() < MIN_SCENES:
        other = f"ask about another symbol than {question.symbol}, a smaller distance or more scenes"
        raise InputError(f"question {name}: {accepted.sum()} scenes allow it, expected at least {MIN_SCENES}; {other}")
    return [{"O": changed}], accepted


def draw_additions(rng: np.random.Generator, scenes: Scenes, placements: int) -> dict[str, list[Layouts]]:
    """Return the scenes with a random item of each symbol added, `placements` times."""
    drawn = scenes.items, scenes.pool, scenes.rules
    return {s: [add_item(rng, scenes.layouts, i, *drawn) for _ in range(placements)] for i, s in enumerate(SYMBOLS)}
