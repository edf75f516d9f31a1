"""What single values may be: types with a range, and what is said to have been expected of them."""

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, WrapValidator
from pydantic_core import PydanticCustomError

from pipeline.world.layout import SYMBOLS

RESERVED = "truth", "ideal", "z"  # what tables and files call something else
MAX_N = 10  # demonstrations a scene has at the most (paper: 10)


def expected(what: str) -> WrapValidator:
    """Whatever is wrong with the value, say that `what` was expected."""

    def validate(value: Any, handler: Callable[[Any], Any]) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("expected", "{expected}", {"expected": what}) from None

    return WrapValidator(validate)


def need(holds: bool, name: str, value: object, what: str) -> None:
    """Say of the parameter `name` that `what` was expected, unless that holds."""
    if not holds:
        raise PydanticCustomError("expected", "{expected}", {"name": name, "value": value, "expected": what})


def rising(values: list) -> list:
    """The values; ValueError unless each is above the one before it, and there is one."""
    if not values or values != sorted(set(values)):
        raise ValueError
    return values


def each_once(values: list) -> list:
    if len(set(values)) != len(values):
        raise PydanticCustomError("expected", "{expected}", {"expected": "each one once"})
    return values


def _not_reserved(name: str) -> str:
    if name in RESERVED:
        raise ValueError
    return name


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
Name = Annotated[
    str,
    Field(pattern="^[A-Za-z][A-Za-z0-9_-]*$"),
    AfterValidator(_not_reserved),
    expected(f"a name of letters, digits, - and _ that begins with a letter, none of {', '.join(RESERVED)}"),
]
Names = Annotated[list[str], AfterValidator(each_once)]
Some = Annotated[Names, Field(min_length=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2), expected("two numbers, the smaller first")]
Seeds = Annotated[list[Whole], Field(min_length=1), AfterValidator(each_once)]
Strengths = Annotated[
    list[Annotated[float, Field(gt=0)]], AfterValidator(rising), expected("numbers above 0, the smallest first")
]
Shares = Annotated[list[Share], AfterValidator(rising), expected("numbers above 0, at most 1, the smallest first")]


class Group(BaseModel):
    """Parameters that belong together: all of them are there, no others, and nothing is converted."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
