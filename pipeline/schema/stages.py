"""What is asked of fitted models, stage by stage, and how it is shown."""

from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.schema.values import (
    Between,
    Chance,
    Count,
    Demonstrations,
    Group,
    Length,
    Margins,
    Names,
    Pair,
    Several,
    Share,
    Shares,
    Spread,
    Strengths,
    Whole,
    expected,
    rising,
)


class Comparison(Group):
    family: str
    variant: str
    against: Names
    splits: Names
    n: Demonstrations | None


class Evaluate(Group):
    users: list[str]
    bins: Count
    comparisons: list[Comparison]


class Ablate(Group):
    variant: str
    n: list[Demonstrations]
    pools: list[str]


class Efficiency(Group):
    generator: Whole
    scenes: list[Count]
    variants: list[str]
    split: str
    threshold: Share


class Repair(Group):
    split: str
    starts: Count
    steps: Count
    optimiser: str
    rate: float
    settle: bool
    lattice_side: Count
    refinements: Whole


class Search(Group):
    evaluations: int
    weight: float
    probes: int
    reach: float
    step: float
    rivals: dict[str, Count | None]
    rivals_of: str


class Intervene(Group):
    split: str
    paths: Count
    placements: Count
    generator: Whole


class Counterfactual(Group):
    split: str
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


class Selftest(Group):
    families: Count
    cells: Count
    effects: Annotated[list[float], Field(min_length=1)]
    stylised: dict[str, Regime]


class Refute(Group):
    scenes: Several
    far_m: Length
    tables: str
    permuted: list[str]
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
    split: str
    paths: Count
    draws: Count
    generator: Whole
    reported: list[Count]
    stranger: Margins
    level: Between


class World(Group):
    together: Chance
    gap_m: Pair


class Confound(Group):
    generator: Whole
    worlds: dict[str, World]
    present: Share
    glasses: Count
    near_m: Length
    users: list[str]
    variants: dict[str, list[str]]
    examples: Count


class Robustness(Group):
    generator: Whole
    split: str
    scenes: Several
    pictures: dict[str, Strengths]
    tables: list[str]
    clutter: Annotated[list[Count], AfterValidator(rising), expected("whole numbers above 0, the smallest first")]
    mislabelled: dict[str, Shares]


class Accept(Group):
    variants: list[str]
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
    first: list[str]
    map_side: Several


class Report(Group):
    shown: list[str]
    scenes: Count
    map_side: Count
    panel_scenes: Count
    panel_side: Count
    reconstructed: Count
    dimensions: Count
    values: Annotated[list[float], Field(min_length=1)]
