"""Write data/ anew, or a contact sheet of what it holds.

python -m drawing                              data/items.csv, textures.csv and every picture
python -m drawing --more 24 --seed 11 --into more/    and as many random validation items of each symbol
                                               and table tops
python -m drawing --contact-sheet sheet.png    the items on table tops, a row a symbol
"""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image
from tqdm import tqdm

from drawing.designs import Design, designs, surfaces
from drawing.shading import SIDE

SURFACE_WIDTH_M = 1.0  # a table top's picture measures this
PROVENANCE = {"source": "drawn by python -m drawing", "licence": "MIT"}
WRITTEN = ("items", "textures", "items.csv", "textures.csv")

Tops = dict[str, tuple[str, Callable[[], np.ndarray]]]  # by name: the split and how to draw it


def write_data(directory: Path, items: list[Design], tops: Tops) -> None:
    """Draw items and table tops with their catalogues in the place of those in `directory`, once all are drawn."""
    part = directory / ".part"
    shutil.rmtree(part, ignore_errors=True)  # of a run that was killed
    new, old = part / "new", part / "old"
    try:
        old.mkdir(parents=True)
        _draw(new, items, tops)
        for name in WRITTEN:
            if (directory / name).exists():
                (directory / name).rename(old / name)
            (new / name).rename(directory / name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _draw(directory: Path, items: list[Design], tops: Tops) -> None:
    for folder in ("items", "textures"):
        (directory / folder).mkdir(parents=True)
    rows = []
    for design in tqdm(items, desc="items"):
        file = f"items/{design.name}.png"
        Image.fromarray(design.draw()).save(directory / file, optimize=True)
        rows.append(
            {
                "name": design.name, "symbol": design.symbol, "split": design.split,
                "width_m": round(design.width_m, 4), "shape": design.shape, "radius_m": design.radius_m,
                "half_length_m": design.half_length_m, "file": file, **PROVENANCE,
            }
        )  # fmt: skip
    pd.DataFrame(rows).to_csv(directory / "items.csv", index=False, lineterminator="\n")
    rows = []
    for name, (split, draw) in tqdm(tops.items(), desc="table tops"):
        file = f"textures/{name}.png"
        Image.fromarray(draw()).save(directory / file, optimize=True)
        rows.append({"name": name, "split": split, "width_m": SURFACE_WIDTH_M, "file": file, **PROVENANCE})
    pd.DataFrame(rows).to_csv(directory / "textures.csv", index=False, lineterminator="\n")


def contact_sheet(directory: Path) -> Image.Image:
    """Every item of `directory` on its table tops, a row a symbol, in the catalogue's order."""
    items = pd.read_csv(directory / "items.csv")
    tops = pd.read_csv(directory / "textures.csv")
    cell = SIDE // 2
    row, column = pd.factorize(items["symbol"])[0], items.groupby("symbol").cumcount()
    sheet = Image.new("RGB", ((int(column.max()) + 1) * cell, (int(row.max()) + 1) * cell))
    for i, (file, y, x) in enumerate(zip(items["file"], row, column, strict=True)):
        top = Image.open(directory / tops["file"][i % len(tops)]).crop((0, 0, cell, cell))
        item = Image.open(directory / file).resize((cell - 20, cell - 20), Image.Resampling.LANCZOS)
        top.paste(item, (10, 10), item)
        sheet.paste(top, (x * cell, y * cell))
    return sheet


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m drawing", description="Draw data/ or show what it holds.")
    parser.add_argument("--contact-sheet", type=Path, metavar="PNG", help="write a picture of every item instead")
    parser.add_argument("--more", type=int, default=0, metavar="N", help="random validation items and table tops, too")
    parser.add_argument("--seed", type=int, default=0, help="of what is random")
    parser.add_argument("--into", type=Path, default=Path("data"), metavar="DIR", help="where the catalogue goes")
    asked = parser.parse_args()
    if asked.more < 0 or (asked.more and asked.into.resolve() == Path("data").resolve()):
        parser.error(f"--more {asked.more} --into {asked.into}: expected a count from 1 and a folder other than data")
    if asked.seed < 0:
        parser.error(f"--seed {asked.seed}: expected a whole number from 0")
    if asked.contact_sheet and not (asked.into / "items.csv").is_file():
        parser.error(f"{asked.into} holds no items.csv: draw it first, or give its folder by --into")
    if asked.contact_sheet:
        contact_sheet(asked.into).save(asked.contact_sheet)
    else:
        write_data(asked.into, designs(asked.more, asked.seed), surfaces(asked.more, asked.seed))
