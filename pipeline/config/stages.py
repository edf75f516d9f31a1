"""Parameters of the stages that evaluate fitted models and present results."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pipeline.runtime.settings import (
    Count,
    Demonstrations,
    Group,
    Length,
    Names,
    Several,
    Size,
    Some,
    Whole,
    expected,
    rising,
)

ControlPoint = Annotated[list[float], Field(min_length=2, max_length=2), expected("two numbers [m]")]
SharedSplit = Annotated[
    Literal["new_scenes", "new_items"], expected("a split that all seeds share, one of new_scenes, new_items")
]


class Comparison(Group):
    """A family of paired tests: one variant against others."""

    family: str
    variant: str
    against: Some
    splits: Some
    n_demos: Demonstrations | None


class Evaluate(Group):
    users: Names
    bins: Count
    comparisons: list[Comparison]


class Readings(Group):
    root_seed: Whole
    clear_cm: Annotated[list[Whole], AfterValidator(rising), expected("ascending whole numbers from 0 [cm]")]
    n_demos: Annotated[list[Demonstrations], AfterValidator(rising), Field(min_length=2)]
    families: Annotated[list[ControlPoint], Field(min_length=1)]
    family_radius: Length
    candidates: Count
    held_out: Count


class Repair(Group):
    split: SharedSplit
    starts: Count
    steps: Count
    optimiser: Literal["gradient", "normalised", "adam"]
    rate: Size
    settle: bool
    distance_penalty: Size
    lattice_side: Count
    refinements: Whole


class Intervene(Group):
    split: SharedSplit
    more_scenes: Whole
    paths: Count
    placements: Count
    root_seed: Whole


class Record(Group):
    scenes: Count
    repairs: Count
    training_scenes: Count
    first: Names
    map_side: Several


class Report(Group):
    shown: Names
    scenes: Count
    map_side: Count
    patterned_top: str
