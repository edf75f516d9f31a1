"""What conf/ may hold: the type and range of every parameter, group by group, as pydantic checks them.

A group that a class of the library takes has its types alone here, for that class keeps its ranges (Schedule, Weights,
Jitter, Ascent, Near, Hand). What parameters must be to one another, or to what a stage finds, its stage says.
"""

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from pipeline.table.layout import SYMBOLS

MAX_N = 10  # demonstrations a scene has at the most (paper: 10)


def sentence(error: ValidationError) -> str:
    """The first parameter that is wrong: its name, what it is, and what was expected."""
    first = error.errors()[0]
    context, value = first.get("ctx", {}), first["input"]
    if first["loc"][-1:] == ("[key]",):
        return f"a name in {first['loc'][0]} is {value!r}: expected letters; put it in quotes"
    keys = [str(key) for key in first["loc"] if not isinstance(key, int)]
    if keys[0:1] == ["variants"] and len(keys) > 2:
        del keys[2]  # its kind, which pydantic puts there to tell variants apart
    name = context.get("name", ".".join(keys))
    match first["type"]:
        case "missing":
            return f"parameter {name} is missing: expected a value, for conf/ gives each one"
        case "union_tag_not_found":
            return f"parameter {name}.kind is missing: expected one of the kinds of models"
        case "union_tag_invalid":
            return f"parameter {name}.kind is {context['tag']!r}: expected one of {context['expected_tags']}"
        case "extra_forbidden":
            return f"parameter {name} is {value!r}: expected none of that name"
        case other:
            what = context.get("expected") or TYPES.get(other, first["msg"])
            return f"parameter {name} is {context.get('value', value)!r}: expected {what}"


TYPES = {  # pydantic's name of an error -> what was expected
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a number that is finite",
    "bool_type": "true or false",
    "string_type": "a name",
    "none_required": "null",
    "list_type": "a list, such as [1, 3]",
    "too_short": "one at least",
    "dict_type": "a mapping from names to values",
    "model_type": "a mapping from names to values",
    "model_attributes_type": "a mapping from names to values",
}


def expected(what: str) -> WrapValidator:
    """Whatever is wrong with the value, say that `what` was expected."""

    def validate(value: Any, handler: Callable[[Any], Any]) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("expected", "{expected}", {"expected": what}) from None

    return WrapValidator(validate)


def _need(holds: bool, name: str, value: object, what: str) -> None:
    """Say of the parameter `name` that `what` was expected, unless that holds."""
    if not holds:
        raise PydanticCustomError("expected", "{expected}", {"name": name, "value": value, "expected": what})


def _rising(values: list) -> list:
    """The values; ValueError unless each is above the one before it, and there is one."""
    if not values or values != sorted(set(values)):
        raise ValueError
    return values


def _each_once(values: list) -> list:
    if len(set(values)) != len(values):
        raise PydanticCustomError("expected", "{expected}", {"expected": "each one once"})
    return values


def _every_symbol(margins: dict) -> dict:
    if set(margins) != set(SYMBOLS):
        raise PydanticCustomError("expected", "{expected}", {"expected": f"a margin for each of {', '.join(SYMBOLS)}"})
    return margins


Whole = Annotated[int, Field(ge=0), expected("a whole number from 0")]
Count = Annotated[int, Field(ge=1), expected("a whole number from 1")]
Several = Annotated[int, Field(ge=2), expected("a whole number from 2")]
Demonstrations = Annotated[int, Field(ge=1, le=MAX_N), expected(f"a whole number from 1 to {MAX_N}")]
Length = Annotated[float, Field(gt=0), expected("a length above 0 [m]")]
Distance = Annotated[float, Field(ge=0), expected("a length from 0 [m]")]
Place = Annotated[float, Field(ge=0, le=1), expected("a place from 0 to 1 [m]")]
Size = Annotated[float, Field(gt=0), expected("a size above 0")]
Spread = Annotated[float, Field(ge=0), expected("a standard deviation from 0")]
Chance = Annotated[float, Field(ge=0, le=1), expected("a chance from 0 to 1")]
Between = Annotated[float, Field(gt=0, lt=1), expected("a number between 0 and 1")]
Share = Annotated[float, Field(gt=0, le=1), expected("a share above 0, at most 1")]
Margin = Annotated[float | None, Field(ge=0, lt=1), expected("null (does not care) or a margin from 0 to 1 [m]")]
Margins = Annotated[dict[str, Margin], AfterValidator(_every_symbol)]
Names = Annotated[list[str], Field(min_length=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2), expected("two numbers, the smaller first")]
Seeds = Annotated[list[Whole], Field(min_length=1), AfterValidator(_each_once)]
Strengths = Annotated[
    list[Annotated[float, Field(gt=0)]], AfterValidator(_rising), expected("numbers above 0, the smallest first")
]
Shares = Annotated[list[Share], AfterValidator(_rising), expected("numbers above 0, at most 1, the smallest first")]


class Group(BaseModel):
    """Parameters that belong together: all of them are there, no others, and nothing is converted."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Layout(Group):
    items_per_scene: list[Whole]
    glasses_chance: list[Chance]
    centre_low: Place
    centre_high: Place
    clear_of_ends: Distance
    clear_of_items: Distance
    scale_low: Size
    scale_high: Size
    slots: Count

    @model_validator(mode="after")
    def _agrees(self) -> "Layout":
        def need(holds: bool, name: str, what: str) -> None:
            _need(holds, f"scenes.layout.{name}", getattr(self, name), what)

        counts, room = self.items_per_scene, self.slots - 1
        one_less = f"whole numbers from 0 to {room}, one less than scenes.layout.slots"
        need(bool(counts) and max(counts) <= room, "items_per_scene", one_less)
        need(abs(sum(self.glasses_chance) - 1) < 1e-9, "glasses_chance", "chances from 0 that add up to 1")
        need(self.centre_low <= self.centre_high, "centre_high", "a place from centre_low to 1 [m]")
        need(self.scale_low <= self.scale_high, "scale_high", "a size from scale_low")
        return self


class Scenes(Group):
    generator: Whole
    per_seed: Count
    shared: Count
    validation: Count
    calibration: Count
    calibration_paths: Count
    prior_side: Count
    layout: Layout


class Hand(Group):
    rate_hz: float
    jitter_s: float
    speed_m_s: float
    speed_spread: float
    tremor_m: float
    tremor_hz: Pair
    drift_m: float
    height_m: float
    height_drift_m: float


class Demos(Group):
    generator: Whole
    per_scene: Demonstrations
    queries_seen: Count
    queries_new: Count
    recorded: str | None
    ends_within_m: Length
    poor_above_m: Length
    hand: Hand


class Schedule(Group):
    steps: int
    rate: float
    weight_decay: float
    curve_every: int


class VaeModel(Group):
    latent: Count
    channels: Annotated[list[Count], Field(min_length=3, max_length=3), expected("three whole numbers from 1")]
    hidden: Count


class Train(Schedule):
    engine: Annotated[
        Literal["auto", "stacked", "batched", "reference"], expected("one of auto, stacked, batched, reference")
    ]
    model: VaeModel


class Jitter(Group):
    hue: float
    gain: float
    shift: float
    scene_gain: float
    other_table: float


class Irl(Group):
    rate: float
    weight_decay: float
    scenes_per_step: int
    copies: int
    sparsity: Annotated[float, Field(ge=0), expected("a weight from 0")]
    across: bool
    curve_every: int
    jitter: Jitter


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
    clutter: Annotated[list[Count], AfterValidator(_rising), expected("whole numbers above 0, the smallest first")]
    mislabelled: dict[str, Shares]


class Accept(Group):
    variants: list[str]
    level: Between
    levels: Annotated[list[Between], AfterValidator(_rising), expected("ascending numbers between 0 and 1")]
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


class Vae(Group):
    stage: Annotated[Literal["train"], expected("train, which fits kind vae")]
    kind: Literal["vae"]
    alpha: float
    beta: float
    gamma: float
    model: VaeModel


class RewardModel(Group):
    channels: Several
    dilated: Count
    gain: Annotated[float, Field(gt=0), expected("a factor above 0")]
    dropout: Annotated[float, Field(ge=0, lt=1), expected("a chance from 0, below 1")]
    lattice_side: Several
    symmetric: bool
    ceiling: bool


class Reward(Group):
    stage: Annotated[Literal["irl"], expected("irl, which fits kind reward")]
    kind: Literal["reward"]
    objective: str
    steps: int
    model: RewardModel


class ClearanceModel(Group):
    members: Count


class Clearance(Group):
    stage: Annotated[Literal["path"], expected("path, which fits kind clearance")]
    kind: Literal["clearance"]
    model: ClearanceModel


Variant = Annotated[Vae | Reward | Clearance, Field(discriminator="kind")]


class Splits(Group):
    seen_scenes: None
    new_scenes: str
    new_items: str


class Protocol(Group):
    name: str
    seeds: Seeds
    splits: Splits


class Settings(Group):
    """All of conf/, as params.yaml holds it."""

    seeds: Seeds
    validation_seeds: Seeds
    n: Annotated[list[Demonstrations], Field(min_length=1), AfterValidator(_each_once)]
    study_n: int
    checkpoints: Annotated[list[Whole], AfterValidator(_each_once)]
    variant: str
    seed: Whole | None
    workers: Count
    paths: dict[str, str]
    users: Annotated[dict[str, Margins], Field(min_length=1)]
    scenes: Scenes
    demos: Demos
    train: Train
    irl: Irl
    path: Schedule
    evaluate: Evaluate
    ablate: Ablate
    efficiency: Efficiency
    repair: Repair
    search: Search
    intervene: Intervene
    counterfactual: Counterfactual
    selftest: Selftest
    refute: Refute
    envelope: Envelope
    identify: Identify
    confound: Confound
    robustness: Robustness
    accept: Accept
    record: Record
    report: Report
    variants: dict[str, Variant]
    protocol: Protocol
    profile: str

    @model_validator(mode="after")
    def _agree(self) -> "Settings":
        known = [*self.seeds, *self.validation_seeds]
        shared = sorted(set(self.seeds) & set(self.validation_seeds))
        none_shared = f"none of `seeds` (shared: {shared})"
        _need(not shared, "validation_seeds", self.validation_seeds, none_shared)
        _need(self.study_n in self.n, "study_n", self.study_n, f"one of n = {self.n}")
        per_scene, most = self.demos.per_scene, max(self.n)
        _need(per_scene >= most, "demos.per_scene", per_scene, f"a whole number from max(n) = {most} to {MAX_N}")
        _need(self.variant in self.variants, "variant", self.variant, f"one of {', '.join(self.variants)}")
        _need(self.seed is None or self.seed in known, "seed", self.seed, f"null or one of {known}")
        widest = max((m for margins in self.users.values() for m in margins.values() if m is not None), default=0.0)
        more = f"more than the widest margin in users, {widest} m: raise it"
        _need(self.envelope.clear_of_others > widest, "envelope.clear_of_others", self.envelope.clear_of_others, more)
        _need(self.refute.far_m > widest, "refute.far_m", self.refute.far_m, more)
        some = set(self.protocol.seeds) <= set(known)
        _need(some, "protocol.seeds", self.protocol.seeds, f"a list of some of {known}")
        return self
