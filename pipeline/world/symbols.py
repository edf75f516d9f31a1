"""The symbols O of the paper: the kinds of item that users' rules name, and the appearance of each kind.

No other module lists them. To add a symbol, add a row to TABLE, its items to data/items.csv, and each user's margin for
it to conf/users.yaml.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Symbol:
    """One kind of item; the defaults suit an opaque, flat object."""

    name: str
    concavity: float = 0.0  # gain in brightness of a hollow item on the side away from the lamp
    shadow: float = 0.34  # share of the lamp's light that its shadow blocks
    height_m: float = 0.009  # height that shifts its shadow away from the lamp [m]
    transparent: bool = False  # the table shows through, but the rim casts the shadow of a solid item


TABLE = (
    Symbol("bowl", concavity=0.16, shadow=0.42, height_m=0.016),
    Symbol("plate", concavity=0.05, shadow=0.34, height_m=0.009),
    Symbol("cutlery", concavity=0.0, shadow=0.30, height_m=0.005),
    Symbol("glass", concavity=0.04, shadow=0.13, height_m=0.018, transparent=True),
)  # layouts store a symbol as its position in this order: append, never reorder

SYMBOLS = tuple(symbol.name for symbol in TABLE)
