"""Read and check the catalogue in data/: items and table textures.

A cutout is a square RGBA image (straight alpha) of one item seen from above under even light. Its side is `width_m`
metres long, so its scale is known. The capsule footprint lies along the cutout's x axis.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pandas as pd
import pandera.errors
import pandera.pandas as pa
from jaxtyping import Int, UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.runtime.reading import read_csv
from pipeline.world.images import read_image
from pipeline.world.layout import SYMBOLS, Items, LayoutRules, Layouts, random_layouts

PULL = "dvc pull -r store data.dvc"  # the command that restores data/
MIN_ITEMS = {"train": 1, "unseen": 2, "validation": 2}  # items per symbol and split; two where models are evaluated
SHAPES = ("disc", "capsule")
MIN_SIDE_PX = 256  # smallest side of a cutout [px]
MIN_VISIBLE_ALPHA = 20  # smallest visible alpha, out of 255; a thin glass has 27
MIN_EXTENT, MAX_EXTENT = 0.75, 1.10  # allowed length and breadth of the visible pixels relative to the footprint's

LENGTH_M = pa.Check.in_range(0.0, 1.0, include_min=False)  # up to the table's side
NAMED = {
    "name": pa.Column(str, pa.Check.str_matches(r"^[a-z0-9-]+$"), unique=True),
    "split": pa.Column(str, pa.Check.isin(list(MIN_ITEMS))),
    "width_m": pa.Column(float, LENGTH_M, coerce=True),
    "file": pa.Column(str, pa.Check.str_endswith(".png")),
    "source": pa.Column(str, pa.Check.str_length(min_value=1)),
    "licence": pa.Column(str, pa.Check.str_length(min_value=1)),
}
FLAT = "a disc has half_length_m 0, a capsule more than 0"
WIDE = "the footprint is wider than the cutout: width_m must be at least 2 (radius_m + half_length_m)"
ITEMS = pa.DataFrameSchema(
    NAMED
    | {
        "symbol": pa.Column(str, pa.Check.isin(SYMBOLS)),
        "shape": pa.Column(str, pa.Check.isin(SHAPES)),
        "radius_m": pa.Column(float, LENGTH_M, coerce=True),
        "half_length_m": pa.Column(float, pa.Check.in_range(0.0, 0.5), coerce=True),
    },
    checks=[
        pa.Check(lambda t: (t["shape"] == "disc") == (t["half_length_m"] == 0), error=FLAT),
        pa.Check(lambda t: 2 * (t["radius_m"] + t["half_length_m"]) <= t["width_m"] * 1.001, error=WIDE),
    ],
    strict=True,
)
TEXTURES = pa.DataFrameSchema(NAMED, strict=True)


@dataclass(frozen=True)
class Catalogue:
    """All items and table textures: the rows of both tables, and their images in the same order."""

    items: pd.DataFrame
    cutouts: list[UInt8[Array, "side side 4"]]
    textures: pd.DataFrame
    surfaces: list[UInt8[Array, "rows columns 3"]]

    @property
    def footprints(self) -> Items:
        """Return the columns that layouts need, one entry per item (row of items.csv)."""
        symbol = np.array([SYMBOLS.index(s) for s in self.items["symbol"]])
        return Items(symbol, self.items["half_length_m"].to_numpy(), self.items["radius_m"].to_numpy())

    def pool(self, split: str) -> Int[Array, " pool"]:
        """Return the rows of items.csv that belong to `split`."""
        return np.flatnonzero(self.items["split"] == split)

    def texture_names(self, split: str) -> list[str]:
        """Return the names of the table textures of `split`, in the order of textures.csv."""
        return self.textures.loc[self.textures["split"] == split, "name"].tolist()


def random_scenes(
    rng: np.random.Generator, count: int, catalogue: Catalogue, split: str, rules: LayoutRules
) -> tuple[Layouts, pd.DataFrame]:
    """Draw scenes with items of `split` on training table tops; return layouts and the `texture` and `render_seed`."""
    layouts = random_layouts(rng, count, catalogue.footprints, catalogue.pool(split), rules)
    textures = rng.choice(catalogue.texture_names("train"), count)
    return layouts, pd.DataFrame({"texture": textures, "render_seed": rng.integers(2**31, size=count)})


def read_catalogue(data_dir: Path) -> Catalogue:
    """Read and check data/: items.csv, textures.csv and every image that they name.

    Raises InputError
    - if an image is missing, truncated, of the wrong size or without alpha;
    - for an unknown symbol, a duplicate name or a length out of range;
    - if a cutout does not fill its footprint, or a symbol has fewer items than MIN_ITEMS.
    """
    items = _read_table(data_dir / "items.csv", ITEMS)
    textures = _read_table(data_dir / "textures.csv", TEXTURES)
    for split, least in MIN_ITEMS.items():
        counts = items.loc[items["split"] == split, "symbol"].value_counts().reindex(SYMBOLS, fill_value=0)
        if short := [f"{count} of {symbol}" for symbol, count in counts.items() if count < least]:
            found = f"items.csv has too few {split} items ({', '.join(short)})"
            raise InputError(f"{found}: expected at least {least} of each symbol")
    if not (textures["split"] == "train").any():
        raise InputError("textures.csv has no train texture: add at least one")
    cutouts = [_read_cutout(data_dir / row.file, row) for row in items.itertuples()]
    surfaces = [read_image(data_dir / file)[..., :3] for file in textures["file"]]
    return Catalogue(items, cutouts, textures, surfaces)


def _read_table(path: Path, schema: pa.DataFrameSchema) -> pd.DataFrame:
    if not path.is_file():
        raise InputError(f"{path} is missing: get data/ with `{PULL}`, or draw it with `python -m making.data`")
    text = [name for name, column in schema.columns.items() if not column.coerce]
    try:
        return cast(pd.DataFrame, schema.validate(read_csv(path, text), lazy=True))
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not a readable csv file ({error}): restore it with `{PULL}`") from error
    except pandera.errors.SchemaErrors as error:
        raise InputError(f"{path}: {_first_failure(error)}") from error


def _first_failure(errors: pandera.errors.SchemaErrors) -> str:
    """Return the first failure as a sentence: the line, the value and what was expected."""
    cases = errors.failure_cases
    case = cases.sort_values("schema_context", kind="stable").iloc[0]  # a column's failure explains its rows'
    more = f" (and {len(cases) - 1} more)" if len(cases) > 1 else ""
    if case["check"] == "column_in_dataframe":
        return f"column {case['failure_case']!r} is missing: add it{more}"
    if case["check"] == "column_in_schema":
        return f"column {case['failure_case']!r} is unknown: remove it{more}"
    line = "" if pd.isna(case["index"]) else f"line {int(case['index']) + 2}, "
    column = case["column"] if case["schema_context"] == "Column" else "row"
    words = {"field_uniqueness": "a name no other line has", "not_nullable": "a value"}
    expected = words.get(case["check"], case["check"])
    return f"{line}{column}: got {case['failure_case']!r}, expected {expected}; correct this line{more}"


def _read_cutout(path: Path, row: Any) -> UInt8[Array, "side side 4"]:
    """Return an item's RGBA cutout; raise InputError unless it is square, has alpha and fills the footprint."""
    rgba = read_image(path)
    height, width, channels = rgba.shape
    if channels != 4:
        raise InputError(f"{path} has no alpha channel: cut the item out and save it as RGBA")
    if width != height or width < MIN_SIDE_PX:
        square = f"a cutout is square, at least {MIN_SIDE_PX} pixels a side"
        raise InputError(f"{path} is {width} x {height} pixels: {square}")
    alpha = rgba[..., 3]
    if alpha.min() == 255 or alpha.max() == 0:
        raise InputError(f"{path} has the same alpha everywhere: the table around the item must be transparent")
    _, _, length_px, breadth_px = cv2.boundingRect((alpha > MIN_VISIBLE_ALPHA).astype(np.uint8))
    footprint_m = {"long": 2 * (row.half_length_m + row.radius_m), "broad": 2 * row.radius_m}
    for pixels, (direction, expected_m) in zip((length_px, breadth_px), footprint_m.items(), strict=True):
        visible_m = pixels * row.width_m / width
        if not MIN_EXTENT <= visible_m / expected_m <= MAX_EXTENT:
            raise InputError(
                f"{path} shows an item {visible_m:.3g} m {direction}, but items.csv gives {row.name} a footprint "
                f"{expected_m:.3g} m {direction}: expected {MIN_EXTENT:g} to {MAX_EXTENT:g} times that; "
                "correct width_m, radius_m or half_length_m, or crop the cutout to the item"
            )
    return rgba
