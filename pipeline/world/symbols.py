"""The symbols: the kinds of item that users' rules name, and how each kind looks under a lamp.

This is the only place that lists them. To add a kind, add one row to TABLE, its items to data/items.csv, and every
user's margin for it to conf/users.yaml.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Symbol:
    """One kind of item; the defaults suit an opaque, flat object."""

    name: str
    bowed: float = 0.0  # share of brightness by which a hollow item is brighter on the side away from the lamp
    shadow: float = 0.34  # share of the lamp's light that its shadow loses
    height_m: float = 0.009  # shift of its shadow away from the lamp [m]
    transparent: bool = False  # the table shows through, yet the rim casts a shadow like a solid item's


TABLE = (
    Symbol("bowl", bowed=0.16, shadow=0.42, height_m=0.016),
    Symbol("plate", bowed=0.05, shadow=0.34, height_m=0.009),
    Symbol("cutlery", bowed=0.0, shadow=0.30, height_m=0.005),
    Symbol("glass", bowed=0.04, shadow=0.13, height_m=0.018, transparent=True),
)  # layouts store a symbol as its place in this order: append, never reorder

SYMBOLS = tuple(symbol.name for symbol in TABLE)
