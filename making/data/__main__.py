"""Write data/ from scratch, or a contact sheet of its contents.

python -m making.data                              data/items.csv, textures.csv and every image
python -m making.data --more 24 --seed 11 --into more/    additionally as many random validation items of each symbol
                                               and table tops
python -m making.data --contact-sheet sheet.png    the items on table tops, one row per symbol
"""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

from making.data.designs import Design, designs, surfaces
from making.data.shading import SIDE
from pipeline.world.images import read_image, write_png

SURFACE_WIDTH_M = 1.0  # width of a table top's image [m]
PROVENANCE = {"source": "drawn by python -m drawing", "licence": "MIT"}  # the words that data.dvc pins

Tops = dict[str, tuple[str, Callable[[], np.ndarray]]]  # name -> (split, function that draws it)


def write_data(directory: Path, items: list[Design], tops: Tops) -> None:
    """Draw items and table tops; once all are drawn, replace those in `directory` and their catalogues."""
    part = directory / ".part"
    shutil.rmtree(part, ignore_errors=True)  # left by an interrupted run
    try:
        _draw(part, items, tops)
        for path in part.iterdir():
            shutil.rmtree(directory / path.name, ignore_errors=True)  # a folder; a file is replaced
            path.rename(directory / path.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _draw(directory: Path, items: list[Design], tops: Tops) -> None:
    for folder in ("items", "textures"):
        (directory / folder).mkdir(parents=True)
    rows = []
    for design in tqdm(items, desc="items"):
        file = f"items/{design.name}.png"
        write_png(directory / file, design.draw())
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
        write_png(directory / file, draw())
        rows.append({"name": name, "split": split, "width_m": SURFACE_WIDTH_M, "file": file, **PROVENANCE})
    pd.DataFrame(rows).to_csv(directory / "textures.csv", index=False, lineterminator="\n")


def contact_sheet(directory: Path) -> np.ndarray:
    """Return an RGB image of all items in `directory` on its table tops, one row per symbol, in catalogue order."""
    items = pd.read_csv(directory / "items.csv")
    tops = pd.read_csv(directory / "textures.csv")
    cell = SIDE // 2
    row, column = pd.factorize(items["symbol"])[0], items.groupby("symbol").cumcount()
    sheet = np.zeros(((int(row.max()) + 1) * cell, (int(column.max()) + 1) * cell, 3), np.uint8)
    for i, (file, y, x) in enumerate(zip(items["file"], row, column, strict=True)):
        tile = sheet[y * cell : (y + 1) * cell, x * cell : (x + 1) * cell]
        tile[:] = read_image(directory / tops["file"][i % len(tops)])[:cell, :cell, :3]
        item = cv2.resize(read_image(directory / file), (cell - 20, cell - 20), interpolation=cv2.INTER_AREA)
        alpha = item[..., 3:] / 255
        tile[10:-10, 10:-10] = np.rint(alpha * item[..., :3] + (1 - alpha) * tile[10:-10, 10:-10])
    return sheet


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m making.data", description="Draw data/ or show what it holds.")
    parser.add_argument("--contact-sheet", type=Path, metavar="PNG", help="write an image of every item instead")
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
        write_png(asked.contact_sheet, contact_sheet(asked.into))
    else:
        write_data(asked.into, designs(asked.more, asked.seed), surfaces(asked.more, asked.seed))
