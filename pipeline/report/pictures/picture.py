"""One figure with its two texts, and the arrays that figures are drawn from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jaxtyping import Bool, Float, Int, UInt8
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report.figures.maps import Maps
from pipeline.report.figures.repairs import Repair
from pipeline.report.figures.things import Seen, Things
from pipeline.report.style import pdf, svg
from pipeline.table.layout import Layouts


@dataclass(frozen=True)
class Picture:
    """One figure: SVG for a wide page, maybe another for a narrow one, PDF for a paper, and its two texts."""

    name: str
    caption: str
    alt: str
    wide: str
    narrow: str | None
    pdf: bytes


@dataclass(frozen=True)
class Drawn:
    """The arrays behind the pictures, all of one seed."""

    seed: int
    scenes: UInt8[Array, "shown 100 100 3"]  # training scenes whose demonstrations are drawn
    demos: dict[str, tuple[Float[Array, "shown n 2"], Bool[Array, "shown n"]]]  # by user
    maps: dict[str, Maps]  # by user
    pool: UInt8[Array, "scene 100 100 3"]  # scenes that were repaired in
    layouts: Layouts
    repairs: dict[str, dict[str, list[Repair]]]  # by variant, and user with something invalid
    failures: dict[str, list[Repair]]  # the worst searches of the best variant, by user; empty without any
    rebuilt: UInt8[Array, "picture 100 100 3"]
    originals: UInt8[Array, "picture 100 100 3"]
    trained_on: int  # of the originals, the first ones
    traversal: UInt8[Array, "latent value 100 100 3"]
    dimensions: Int[Array, " row"]
    values: list[float]
    added_to: UInt8[Array, "100 100 3"]
    added: UInt8[Array, "symbol 100 100 3"]
    worlds: dict[str, UInt8[Array, "training 100 100 3"]]  # training scenes of the confounded world and others
    whole: UInt8[Array, "example 100 100 3"]  # scenes of the worked counterfactuals
    without: UInt8[Array, "example slot 100 100 3"]  # ... without each item
    disturbed: dict[str, UInt8[Array, "100 100 3"]]  # one scene as it is, then under each disturbance
    placebos: Mapping[str, UInt8[Array, "symbol 100 100 3"]]  # by refuter
    added_texts: list[str]  # below the scene as it is and each added item
    added_user: str
    smallest: float  # smallest effect of interest
    things: Things  # found in `unseen`
    unseen: UInt8[Array, "scene 100 100 3"]
    unseen_layouts: Layouts
    seen: dict[str, Seen]  # by user with something invalid; empty without a variant that finds things


def picture(name: str, caption: str, alt: str, wide: Callable[[], Figure], narrow: Callable | None = None) -> Picture:
    return Picture(name, caption, alt, svg(wide), svg(narrow) if narrow else None, pdf(wide))
