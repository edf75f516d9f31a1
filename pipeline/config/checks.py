"""Reject values that conflict with others; the error names the parameter, its value and what was expected."""

from collections.abc import Collection, Mapping

from pydantic_core import PydanticCustomError


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
