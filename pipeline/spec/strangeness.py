"""Does a picture look like those a model was taught with? Asked of pixels alone, without any label.

Full conformal prediction (Vovk, Gammerman and Shafer, 2005): the picture is scored among its model's training pictures
as each of them is, and is strange if it scores highest. If it came as they did, the chance of that is at most one in
their number and one, whatever the score. The score was chosen on other tops and items (docs/choices.md, "Strange").
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array

from pipeline.spec.specification import to_bytes, to_tensor
from pipeline.spec.things import find, layers, whitening
from pipeline.table.layout import SIDE

FURTHEST = 1e9  # from a thing to those of other pictures, if they have none


@dataclass(frozen=True)
class Looks:
    """What each picture is compared by."""

    spread: Float[Array, "picture 3"]  # log of how much the table varies: widely, in thin lines, from pixel to pixel
    things: list[Float32[Array, "_ feature"]]  # features of what stands out from it

    @classmethod
    def of(cls, images: UInt8[Array, "picture 100 100 3"]) -> "Looks":
        """Those of pictures."""
        seen = to_tensor(images)
        found = find(seen)
        spread = np.array([_spread(picture) for picture in to_bytes(seen)]).reshape(-1, 3)
        return cls(spread, [of[there] for of, there in zip(found.features, found.present, strict=True)])


def strange(own: Looks, others: Looks) -> Bool[Array, " picture"]:
    """Whether each of the `others` is further from a model's `own` pictures than every one of those from the rest."""
    told = []
    for spread, things in zip(others.spread, others.things, strict=True):
        odd = oddness(Looks(np.vstack([own.spread, spread]), [*own.things, things]))
        told.append(odd[-1] > odd[:-1].max())
    return np.array(told, bool)


def oddness(looks: Looks) -> Float[Array, " picture"]:
    """How unlike the others each picture is, in units of the mean: by its table or by its things, whichever is more.

    By its table: the distance to the nearest other spread. By its things: the sum, over them, of the distance to the
    nearest thing of another picture, each feature in its standard deviations.
    """
    apart = np.linalg.norm(looks.spread[:, None] - looks.spread, axis=-1)
    np.fill_diagonal(apart, np.inf)
    of_table = apart.min(1)
    whose = np.repeat(np.arange(len(looks.things)), [len(of) for of in looks.things])
    every = np.concatenate(looks.things)
    every = every / np.maximum(every.std(0), 1e-9) if len(every) else every
    unlike = np.linalg.norm(every[:, None] - every, axis=-1)
    unlike[whose[:, None] == whose] = np.inf
    of_things = np.bincount(whose, unlike.min(1, initial=FURTHEST), len(looks.things))
    return np.maximum(of_table / max(of_table.mean(), 1e-9), of_things / max(of_things.mean(), 1e-9))


@lru_cache(maxsize=4096)  # every model's pictures are compared with the same ones
def _spread(picture: bytes) -> Float[Array, "3"]:
    """Of an 8-bit picture: log of the table's standard deviation, the geometric mean over directions of colour."""
    pixels = np.frombuffer(picture, np.uint8).reshape(SIDE, SIDE, 3)
    wide, _, thin, fine = layers(pixels.transpose(2, 0, 1) / np.float32(255))
    return np.array([-np.linalg.slogdet(whitening(layer))[1] / 3 for layer in (wide, thin, fine)])
