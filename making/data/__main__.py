"""Write data/ from scratch: items.csv, textures.csv and every image, `python -m making.data`."""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from making.data.designs import Design, designs, surfaces
from pipeline.world.images import write_png

SURFACE_WIDTH_M = 1.0  # width of a table top's image [m]
PROVENANCE = {"source": "drawn by python -m making.data", "licence": "MIT"}

Tops = dict[str, tuple[str, Callable[[], np.ndarray]]]  # name -> (split, function that draws it)


def write_data(directory: Path, items: list[Design], tops: Tops) -> None:
    """Draw items and table tops; once all are drawn, replace those in `directory` and their catalogues."""
    images = {f"items/{design.name}.png": design.draw() for design in tqdm(items, desc="items")}
    images |= {f"textures/{name}.png": draw() for name, (_, draw) in tqdm(tops.items(), desc="table tops")}
    for folder in ("items", "textures"):
        shutil.rmtree(directory / folder, ignore_errors=True)
        (directory / folder).mkdir(parents=True)
    for file, image in images.items():
        write_png(directory / file, image)
    rows = [
        {
            "name": design.name, "symbol": design.symbol, "split": design.split, "width_m": round(design.width_m, 4),
            "shape": "capsule" if design.half_length_m else "disc",
            "radius_m": design.radius_m, "half_length_m": design.half_length_m,
            "file": f"items/{design.name}.png", **PROVENANCE,
        }
        for design in items
    ]  # fmt: skip
    pd.DataFrame(rows).to_csv(directory / "items.csv", index=False, lineterminator="\n")
    rows = [
        {"name": name, "split": split, "width_m": SURFACE_WIDTH_M, "file": f"textures/{name}.png", **PROVENANCE}
        for name, (split, _) in tops.items()
    ]
    pd.DataFrame(rows).to_csv(directory / "textures.csv", index=False, lineterminator="\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m making.data", description="Draw data/.")
    parser.add_argument("--into", type=Path, default=Path("data"), metavar="DIR", help="where the catalogue goes")
    write_data(parser.parse_args().into, designs(), surfaces())
