"""What is asked of fitted models, stage by stage, and how it is shown."""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field

from pipeline.schema.models import Averaged
from pipeline.schema.values import (
    Between,
    Chance,
    Count,
    Demonstrations,
    Distance,
    Group,
    Length,
    Margins,
    Name,
    Names,
    Pair,
    Several,
    Share,
    Shares,
    Size,
    Some,
    Spread,
    Strengths,
    Whole,
    each_once,
    expected,
    rising,
)

SharedSplit = Annotated[
    Literal["new_scenes", "new_items"], expected("a split that all seeds share, one of new_scenes, new_items")
]


class Comparison(Group):
    family: str
    variant: str
    against: Some
    splits: Some
    n: Demonstrations | None


class Evaluate(Group):
    users: Names
    bins: Count
    comparisons: list[Comparison]


ValidationPool = Annotated[
    Literal["val_scenes", "val_items"], expected("pools of validation, some of val_scenes, val_items")
]


class Ablate(Group):
    variant: str
    n: Annotated[list[Demonstrations], AfterValidator(each_once)]
    pools: Annotated[list[ValidationPool], Field(min_length=1), AfterValidator(each_once)]


class Efficiency(Group):
    generator: Whole
    scenes: list[Count]
    variants: Names
    split: SharedSplit
    threshold: Share


Optimiser = Literal["gradient", "normalised", "adam"]


class Repair(Group):
    split: SharedSplit
    starts: Count
    steps: Count
    optimiser: Annotated[Optimiser, expected(f"one of {', '.join(get_args(Optimiser))}")]
    rate: Size
    settle: bool
    lattice_side: Count
    refinements: Whole


class Search(Group):
    evaluations: Count
    weight: Size
    looks: Count
    climb: Whole
    reach: Length
    step: Length
    thresholds: Annotated[list[Between], AfterValidator(rising), expected("ascending numbers between 0 and 1")]
    rivals: dict[Literal["multistart", "cem", "lbfgs"], Count | None]
    rivals_of: str


class Intervene(Group):
    split: SharedSplit
    paths: Count
    placements: Count
    generator: Whole


class Counterfactual(Group):
    split: SharedSplit
    scenes: Several
    paths: Count
    moved_scenes: Several
    move_step: Annotated[float, Field(gt=0, le=0.1), expected("a length above 0 up to .1 [m]")]
    move_steps: Count
    example_variant: str
    generator: Whole


class Regime(Group):
    by_seed: Spread
    by_scene: Spread
    rest: Spread
    skewed: bool = False
    seldom: Annotated[float, Field(ge=0, lt=1), expected("a share of the scenes from 0, below 1")] = 0.0


class Selftest(Group):
    families: Count
    cells: Count
    effects: Annotated[list[float], Field(min_length=1), AfterValidator(each_once)]
    stylised: dict[str, Regime]


class Refute(Group):
    scenes: Several
    far_m: Length
    tables: str
    permuted: Names
    halves: Several
    generator: Whole


class Envelope(Group):
    planner: str
    step: Length
    doses: Several
    clear_of_others: Length
    paths: Count
    candidates: Count
    starts: Count
    generator: Whole


class Identify(Group):
    split: SharedSplit
    paths: Count
    draws: Count
    generator: Whole
    reported: Annotated[list[Count], Field(min_length=1)]
    stranger: Margins
    level: Between


class World(Group):
    together: Chance
    gap_m: Pair


class Confound(Group):
    generator: Whole
    worlds: dict[Name, World]
    present: Share
    glasses: Count
    near_m: Length
    users: Names
    variants: dict[str, Names]
    examples: Count


class Pictures(Group):
    """Strengths by disturbance; those left out are not asked about."""

    shade: Shares | None = None
    tint: Shares | None = None
    blur: Strengths | None = None
    noise: Strengths | None = None
    arm: Shares | None = None


class Robustness(Group):
    generator: Whole
    split: SharedSplit
    scenes: Several
    pictures: Pictures
    tables: Some
    clutter: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    mislabelled: dict[str, Shares]


class Misspecify(Group):
    forms: dict[Literal["margin", "brief", "right", "beside", "late", "several"], Distance]
    variants: Some
    averaged: Averaged


class Accept(Group):
    variants: Names
    level: Between
    levels: Annotated[list[Between], AfterValidator(rising), expected("ascending numbers between 0 and 1")]
    fitted: Count
    folds: Several
    error: Between
    generator: Whole


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
    panel_scenes: Count
    panel_side: Count
    reconstructed: Count
    dimensions: Count
    values: Annotated[list[float], Field(min_length=1)]
