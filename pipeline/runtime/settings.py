"""Types of single values with their ranges, parameters that all stages share, and the errors of wrong values."""

from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal, TypeVar

from omegaconf import OmegaConf
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from pipeline.runtime.errors import InputError

RESERVED = "truth", "ideal", "z", "position_only", "nearest_demonstration"  # other meanings in tables and files
NAME = "^[A-Za-z][A-Za-z0-9_-]*$"
MAX_N = 10  # largest number of demonstrations per scene (paper: 10)
Checked = TypeVar("Checked", bound="Group")


def rising(values: list) -> list:
    """Return the values; raise ValueError unless they are strictly increasing and at least one."""
    if not values or values != sorted(set(values)):
        raise ValueError("expected ascending numbers, at least one")
    return values


def ordered(values: tuple) -> tuple:
    """Return the values; raise ValueError unless none is below the one before it."""
    if list(values) != sorted(values):
        raise ValueError("expected the smaller number first")
    return values


def unique(values: list) -> list:
    """Return the values; reject repeated ones."""
    if len(set(values)) != len(values):
        raise ValueError("expected each one once")
    return values


def _not_reserved(name: str) -> str:
    if name in RESERVED:
        raise ValueError(f"expected a name, none of {', '.join(RESERVED)}")
    return name


def _every_symbol(margins: dict) -> dict:
    from pipeline.world.layout import SYMBOLS  # which imports this module

    if set(margins) != set(SYMBOLS):
        raise ValueError(f"expected a margin for each of {', '.join(SYMBOLS)}")
    return margins


Whole = Annotated[int, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]
Several = Annotated[int, Field(ge=2)]
Demonstrations = Annotated[int, Field(ge=1, le=MAX_N)]
Length = Annotated[float, Field(gt=0)]  # [m]
Distance = Annotated[float, Field(ge=0)]  # [m]
Size = Annotated[float, Field(gt=0)]
Weight = Annotated[float, Field(ge=0)]
Spread = Annotated[float, Field(ge=0)]  # a standard deviation
Chance = Annotated[float, Field(ge=0, le=1)]
Between = Annotated[float, Field(gt=0, lt=1)]
Share = Annotated[float, Field(gt=0, le=1)]
Margin = Annotated[float | None, Field(ge=0, lt=1)]  # [m]; null: none
Margins = Annotated[dict[str, Margin], AfterValidator(_every_symbol)]
Name = Annotated[str, Field(pattern=NAME), AfterValidator(_not_reserved)]
Names = Annotated[list[str], AfterValidator(unique)]
Some = Annotated[Names, Field(min_length=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Range = Annotated[tuple[Distance, Distance], Field(strict=False), AfterValidator(ordered)]
ShareRange = Annotated[tuple[Chance, Chance], Field(strict=False), AfterValidator(ordered)]
Seeds = Annotated[list[Whole], Field(min_length=1), AfterValidator(unique)]
Wholes = Annotated[list[Whole], AfterValidator(rising)]
Counts = Annotated[list[Count], AfterValidator(rising)]
Strengths = Annotated[list[Size], AfterValidator(rising)]
Shares = Annotated[list[Share], AfterValidator(rising)]
SharedSplit = Literal["new_scenes", "new_items"]  # splits that all seeds share


class Group(BaseModel):
    """A group of parameters: unknown ones are rejected, and nothing is converted."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    @classmethod
    def of(cls: type[Checked], values: Mapping[str, Any]) -> Checked:
        """Return the group of those among the `values` of conf/ that belong to it."""
        plain: Any = OmegaConf.to_container(OmegaConf.create(dict(values)))
        return cls(**{name: plain[name] for name in cls.model_fields if name in plain})


class StudyGroup(Group):
    """Check the setting of all studies: the question that the page and the list of studies print."""

    question: Annotated[str, Field(pattern=r"\?$")]


class VariantSettings(Group):
    n_demos: Annotated[list[Demonstrations], Field(min_length=1)] | None  # besides main_n_demos; null: all
    compared: bool


class Splits(Group):
    """split -> pool of scenes; null: the training scenes of each seed."""

    seen_scenes: None
    new_scenes: str
    new_items: str


class Protocol(Group):
    """Parameters of conf/protocol/*.yaml: the training sets that are fitted, and the pools for evaluation."""

    name: str
    seeds: Seeds
    splits: Splits


class Graph(Group):
    """Name what dvc.yaml runs once each: variants of each stage that fits, and pages of studies."""

    train: Names
    irl: Names
    clearance: Names
    pages: Names


class Shared(Group):
    """Parameters that belong to no stage alone."""

    seeds: Seeds
    validation_seeds: Seeds
    n_demos: Annotated[list[Demonstrations], Field(min_length=1), AfterValidator(unique)]
    main_n_demos: int
    checkpoints: Annotated[list[Whole], AfterValidator(unique)]
    variant: str
    seed: Whole | None
    workers: Count
    paths: dict[str, str]
    users: Annotated[dict[Name, Margins], Field(min_length=1)]
    protocol: Protocol
    profile: str
    composed: list[str]
    graph: Graph

    @model_validator(mode="after")
    def _agrees(self) -> "Shared":
        shared = sorted(set(self.seeds) & set(self.validation_seeds))
        need(not shared, "validation_seeds", self.validation_seeds, f"none of `seeds` (shared: {shared})")
        need(self.main_n_demos in self.n_demos, "main_n_demos", self.main_n_demos, f"one of n_demos = {self.n_demos}")
        seeds, known = self.protocol.seeds, [*self.seeds, *self.validation_seeds]
        need(set(seeds) <= set(known), "protocol.seeds", seeds, f"a list of some of {known}")
        one_of = f"null or one of protocol.seeds, {seeds} under protocol={self.protocol.name}"
        need(self.seed is None or self.seed in seeds, "seed", self.seed, one_of)
        return self


def checked(group: type[Checked], values: Any, name: str = "") -> Checked:
    """Return the values of parameter `name` as a `group`. Raise InputError that names the first wrong one."""
    try:
        return group.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        if isinstance(cause := first.get("ctx", {}).get("error"), InputError):
            raise cause from error
        parameter = ".".join(str(part) for part in (name, *first["loc"]) if part != "")
        value = "" if first["type"] == "missing" else f" is {first['input']!r}"
        what = first["msg"].removeprefix("Value error, ")
        raise InputError(f"parameter {parameter}{value}: {what}") from error


def need(holds: bool, name: str, value: object, what: str) -> None:
    """Raise InputError for the value of parameter `name` unless `holds`; it says that `what` was expected."""
    if not holds:
        raise InputError(f"parameter {name} is {value!r}: expected {what}")


def need_some(name: str, values: Collection[str], known: Collection[str]) -> None:
    """Reject `values` unless they are among the `known` names, and at least one."""
    need(len(values) > 0 and set(values) <= set(known), name, list(values), f"some of {', '.join(known)}")


def need_one(name: str, value: str, known: Collection[str]) -> None:
    """Reject `value` unless it is one of the `known` names."""
    need(value in known, name, value, f"one of {', '.join(known)}")


def widest_margin(users: Mapping[str, Mapping[str, float | None]]) -> float | None:
    """Return the widest margin [m] of any user; None if there is none."""
    return max((m for margins in users.values() for m in margins.values() if m is not None), default=None)
