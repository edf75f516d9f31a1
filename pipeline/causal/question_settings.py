"""Parameters of the causal questions: conf/questions/<name>.yaml, one change per file."""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field, model_validator

from pipeline.runtime.settings import Group, Length, Name, expected, need
from pipeline.world.layout import SYMBOLS


def _known(symbol: str) -> str:
    if symbol not in SYMBOLS:
        raise ValueError
    return symbol


Symbol = Annotated[str, AfterValidator(_known), expected(f"one of {', '.join(SYMBOLS)}")]


class _Question(Group):
    family: Name | None = None  # questions of one family share Holm's correction; null: a family of its own


class Add(_Question):
    kind: Literal["add"]
    symbol: Symbol


class Remove(_Question):
    kind: Literal["remove"]
    symbol: Symbol


class Move(_Question):
    kind: Literal["move"]
    symbol: Symbol
    distance: Length


class Swap(_Question):
    kind: Literal["swap"]
    symbol: Symbol
    to: Symbol

    @model_validator(mode="after")
    def _differs(self) -> "Swap":
        need(self.to != self.symbol, "to", self.to, f"another symbol than {self.symbol}")
        return self


class TableTop(_Question):
    kind: Literal["table_top"]
    texture: str


class User(_Question):
    kind: Literal["user"]
    to: Name | None


Question = Annotated[Add | Remove | Move | Swap | TableTop | User, Field(discriminator="kind")]
KINDS = tuple(get_args(cls.model_fields["kind"].annotation)[0] for cls in (Add, Remove, Move, Swap, TableTop, User))
