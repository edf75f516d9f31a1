"""The symbols O of the paper: the kinds of item that users' rules name, and their appearance, as in symbols.yaml."""

from pathlib import Path
from typing import Annotated

import yaml
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from pipeline.runtime.errors import InputError

Share = Annotated[float, Field(ge=0, le=1)]


class Symbol(BaseModel, extra="forbid", strict=True, frozen=True):
    """The appearance of one kind of item; the defaults suit an opaque, flat object."""

    concavity: Share = 0.0  # gain in brightness of a hollow item on the side away from the lamp
    shadow: Share = 0.34  # share of the lamp's light that its shadow blocks
    height_m: Share = 0.009  # height that shifts its shadow away from the lamp [m]
    transparent: bool = False  # the table shows through, but the rim casts the shadow of a solid item


def read_symbols(path: Path) -> dict[str, Symbol]:
    """Return the kinds of item in a symbols.yaml; raise InputError for an unknown key or a value out of range."""
    try:
        return TypeAdapter(dict[str, Symbol]).validate_python(yaml.safe_load(path.read_text()))
    except (yaml.YAMLError, ValidationError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error


_KINDS = read_symbols(Path(__file__).with_suffix(".yaml"))
SYMBOLS, APPEARANCES = tuple(_KINDS), tuple(_KINDS.values())  # layouts store a symbol as its position
