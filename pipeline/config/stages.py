"""Parameters of the stages that evaluate fitted models and present results."""

from typing import Annotated, Literal

from pipeline.config.values import Count, Demonstrations, Group, Names, Several, Size, Some, Whole, expected

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
