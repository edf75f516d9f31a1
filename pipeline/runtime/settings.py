"""Types of single values with their ranges, and the wording of validation errors."""

from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, WrapValidator
from pydantic_core import PydanticCustomError

from pipeline.world.layout import SYMBOLS

RESERVED = "truth", "ideal", "z"  # names with another meaning in tables and files
MAX_N = 10  # largest number of demonstrations per scene (paper: 10)


def expected(what: str) -> WrapValidator:
    """Return a validator that answers any wrong value with "expected <what>"."""

    def validate(value: Any, handler: Callable[[Any], Any]) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise PydanticCustomError("expected", "{expected}", {"expected": what}) from None

    return WrapValidator(validate)


def explain(error: ValidationError, prefix: str = "") -> str:
    """Return a sentence about the first invalid parameter: its name, its value and what was expected."""
    first = error.errors()[0]
    context = first.get("ctx", {})
    keys = [str(key) for key in first["loc"] if not isinstance(key, int)]
    if keys[:1] in (["variants"], ["questions"]) and len(keys) > 2 and keys[2] != "[key]":
        del keys[2]  # the kind, which pydantic inserts to distinguish variants or questions
    name = prefix + ".".join(keys)
    if "name" in context:  # a whole name, or that of a field within
        name = f"{name}.{context['name']}" if keys and "." not in context["name"] else context["name"]
    what = f"expected {context['expected']}" if "expected" in context else first["msg"][:1].lower() + first["msg"][1:]
    if keys[-1:] == ["[key]"]:
        return f"name {first['input']!r} in {prefix}{'.'.join(keys[:-2])}: {what}"
    match first["type"]:
        case "missing":
            return f"missing parameter {name!r} (see conf/)"
        case "union_tag_not_found":
            return f"missing parameter '{name}.kind' (see conf/{keys[0]}/)"
        case "union_tag_invalid":
            return f"parameter {name}.kind is {context['tag']!r}: expected one of {context['expected_tags']}"
        case "extra_forbidden":
            return f"unknown parameter {name!r}"
        case "unknown_symbol":
            return f"unknown parameter '{name}.{context['symbol']}'"
        case _:
            return f"parameter {name} is {context.get('value', first['input'])!r}: {what}"


def rising(values: list) -> list:
    """Return the values; raise ValueError unless they are strictly increasing and at least one."""
    if not values or values != sorted(set(values)):
        raise ValueError
    return values


def ordered(values: list) -> list:
    """Return the values; raise ValueError unless none is below the one before it."""
    if values != sorted(values):
        raise ValueError
    return values


def unique(values: list) -> list:
    """Return the values; reject repeated ones."""
    if len(set(values)) != len(values):
        raise PydanticCustomError("expected", "{expected}", {"expected": "each one once"})
    return values


def _not_reserved(name: str) -> str:
    if name in RESERVED:
        raise ValueError
    return name


def _every_symbol(margins: dict) -> dict:
    if unknown := sorted(set(margins) - set(SYMBOLS)):
        raise PydanticCustomError("unknown_symbol", "unknown symbol", {"symbol": unknown[0]})
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
Size = Annotated[float, Field(gt=0), expected("a number above 0")]
Weight = Annotated[float, Field(ge=0), expected("a weight from 0")]
Spread = Annotated[float, Field(ge=0), expected("a standard deviation from 0")]
Chance = Annotated[float, Field(ge=0, le=1), expected("a probability from 0 to 1")]
Between = Annotated[float, Field(gt=0, lt=1), expected("a number between 0 and 1")]
Share = Annotated[float, Field(gt=0, le=1), expected("a share above 0, at most 1")]
Margin = Annotated[float | None, Field(ge=0, lt=1), expected("null (no margin) or a margin from 0 to 1 [m]")]
Margins = Annotated[dict[str, Margin], AfterValidator(_every_symbol)]
Name = Annotated[
    str,
    Field(pattern="^[A-Za-z][A-Za-z0-9_-]*$"),
    AfterValidator(_not_reserved),
    expected(f"a name of letters, digits, - and _ that begins with a letter, none of {', '.join(RESERVED)}"),
]
Names = Annotated[list[str], AfterValidator(unique)]
Some = Annotated[Names, Field(min_length=1)]
Range = Annotated[
    list[Annotated[float, Field(ge=0)]],
    Field(min_length=2, max_length=2),
    AfterValidator(ordered),
    expected("two numbers from 0, the smaller first"),
]
ShareRange = Annotated[
    list[Annotated[float, Field(ge=0, le=1)]],
    Field(min_length=2, max_length=2),
    AfterValidator(ordered),
    expected("two numbers from 0 to 1, the smaller first"),
]
Pair = Annotated[list[float], Field(min_length=2, max_length=2), expected("two numbers, the smaller first")]
Seeds = Annotated[list[Whole], Field(min_length=1), AfterValidator(unique)]
Strengths = Annotated[
    list[Annotated[float, Field(gt=0)]], AfterValidator(rising), expected("numbers above 0, the smallest first")
]
Shares = Annotated[list[Share], AfterValidator(rising), expected("numbers above 0, at most 1, the smallest first")]


class Group(BaseModel):
    """A group of parameters: all are required, unknown ones are rejected, and nothing is converted."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class StudyGroup(Group):
    """Check the setting of all studies: the question that the page and the list of studies print."""

    question: Annotated[str, Field(pattern=r"\?$"), expected("a question that ends in ?")]


def need(holds: bool, name: str, value: object, what: str) -> None:
    """Reject the value of parameter `name` unless `holds`; the error says that `what` was expected."""
    if not holds:
        raise PydanticCustomError("expected", "{expected}", {"name": name, "value": value, "expected": what})


def need_some(name: str, values: Collection[str], known: Collection[str], or_none: bool = False) -> None:
    """Reject `values` unless they are among the `known` names and, without `or_none`, at least one."""
    need((or_none or len(values) > 0) and set(values) <= set(known), name, list(values), f"some of {', '.join(known)}")


def need_one(name: str, value: str, known: Collection[str]) -> None:
    """Reject `value` unless it is one of the `known` names."""
    need(value in known, name, value, f"one of {', '.join(known)}")


def widest_margin(users: Mapping[str, Mapping[str, float | None]]) -> float | None:
    """Return the widest margin [m] of any user; None if there is none."""
    return max((m for margins in users.values() for m in margins.values() if m is not None), default=None)
