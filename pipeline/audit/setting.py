"""Say which setting overrides make: one setting has one text, however its values are spelled."""

import json
import re
from collections.abc import Iterable
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser

BARE = re.compile(r"(?!(?:null|true|false|nan|inf)$)[^\W\d][\w./-]*", re.IGNORECASE)  # text that reads as nothing else


def canonical(value: Any) -> str:
    """Return a parameter's value as text; two values have the same text if and only if they are equal.

    100, 100.0 and 1e2 are equal, so are [9] and [9.0]; true, 1 and the text "1" are three values.
    """
    if isinstance(value, dict):
        return f"{{{','.join(sorted(f'{canonical(str(key))}:{canonical(part)}' for key, part in value.items()))}}}"
    if isinstance(value, list):
        return f"[{','.join(map(canonical, value))}]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, int | float):
        return str(int(value)) if isinstance(value, int) or value.is_integer() else repr(value)
    text = str(getattr(value, "text", value))  # of Hydra's QuotedString
    return text if BARE.fullmatch(text) else json.dumps(text, ensure_ascii=False)


def values(overrides: Iterable[str]) -> dict[str, Any]:
    """Return parameter -> value of Hydra's overrides that sweep nothing."""
    parser = OverridesParser.create()
    parsed = [parser.parse_override(text) for text in overrides]
    return {override.get_key_element().lstrip("+"): override.value() for override in parsed}


def setting(overrides: Iterable[str], fixed: Iterable[str] = ()) -> tuple[str, ...]:
    """Return parameter=value, sorted, of a job's overrides, but for those that `fixed` gives the same value."""
    own, shared = ({f"{name}={canonical(value)}" for name, value in values(x).items()} for x in (overrides, fixed))
    return tuple(sorted(own - shared))
