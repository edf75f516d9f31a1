"""What is asked of fitted models, stage by stage, and how it is shown."""

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
    """conf/evaluate.yaml."""

    users: Names
    bins: Count
    comparisons: list[Comparison]


class Repair(Group):
    """conf/repair.yaml."""

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
    """conf/intervene.yaml."""

    split: SharedSplit
    paths: Count
    placements: Count
    root_seed: Whole


class Record(Group):
    """conf/record.yaml."""

    scenes: Count
    repairs: Count
    training_scenes: Count
    first: Names
    map_side: Several


class Report(Group):
    """conf/report.yaml."""

    shown: Names
    scenes: Count
    map_side: Count
