"""Render a split of scenes.

python -m making.render --split validation_taught --seed 5 --into rendered/pictures/validation_taught

It runs in an environment of its own (requirements.txt beside this file), with PYTHONPATH=. and Python 3.11.
SOURCE.md in the folder says what was made and how.
"""

import argparse
import os
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import yaml
from tqdm import tqdm

from making.render.read import sheet
from pipeline.runtime.streams import stream
from pipeline.world.layout import EMPTY, SYMBOLS, Items, LayoutRules, Layouts, add_item, random_layouts

DESIGNS = 40  # random designs of each symbol in a split
SPLITS = {  # name: kinds of table top, shape and finish; scenes; whether with interventions
    "train": ("taught", 200, False),
    "validation_taught": ("taught", 60, True),
    "validation_held_out": ("held_out", 60, True),
    "test_taught": ("taught", 150, True),
    "test_held_out": ("sealed", 150, True),
}


def main(split: str, seed: int, scenes: int, into: Path) -> None:
    """Render `scenes` scenes of a split and write pictures, scenes.csv, items.csv and SOURCE.md into a folder."""
    import bpy  # pyright: ignore[reportMissingImports]

    from making.render import studio
    from making.render.kitchenware import design
    from making.render.tops import FAMILIES

    kinds, _, with_interventions = SPLITS[split]
    families = [*FAMILIES[kinds]]
    rules = LayoutRules.of(yaml.safe_load(Path("conf/scenes.yaml").read_text(encoding="utf-8"))["scenes"]["layout"])
    designs = [design(stream(seed, split, "design", s, i), s, kinds) for s in SYMBOLS for i in range(DESIGNS)]
    columns = [(SYMBOLS.index(d.symbol), d.half_length, d.radius) for d in designs]
    items = Items(*map(np.array, zip(*columns, strict=True)))
    pool = np.arange(len(designs))
    into.mkdir(parents=True, exist_ok=True)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Blender prints a line for each picture
    studio.set_up()
    scene_rows, item_rows, pictures = [], [], []
    for scene in tqdm(range(scenes), desc=split):
        rng = stream(seed, split, "layout", scene)
        layout = random_layouts(rng, 1, items, pool, rules)
        layouts = {"": layout}
        if with_interventions:
            layouts |= {s: add_item(rng, layout, i, items, pool, rules) for i, s in enumerate(SYMBOLS)}
        family = families[scene % len(families)]
        light, taken = _pictures(studio, designs, layouts, family, (seed, split, scene))
        pictures.append(taken)
        rounded = {"elevation_deg": round(light.elevation_deg, 1), "camera_m": round(light.camera_m, 2)}
        scene_rows.append({"scene": scene, "top": family, "kinds": kinds, "lamps": light.lamps, **rounded})
        for added, changed in layouts.items():
            item_rows += _item_rows(scene, added, changed, layout, designs)
    stacks = {name: np.stack([taken[name] for taken in pictures]) for name in pictures[0]}
    for name, stack in stacks.items():
        is_changed = name in SYMBOLS  # few pixels differ from the scene: their differences need a fifth of the space
        pixels = sheet(stack - stacks["scene"] if is_changed else stack)
        cv2.imwrite(str(into / f"{name}.png"), pixels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    pd.DataFrame(scene_rows).to_csv(into / "scenes.csv", index=False, lineterminator="\n")
    pd.DataFrame(item_rows).to_csv(into / "items.csv", index=False, lineterminator="\n")
    (into / "SOURCE.md").write_text(_source(split, seed, scenes, bpy.app.version_string), encoding="utf-8")


def _pictures(studio, designs, layouts: dict[str, Layouts], family: str, name: tuple) -> tuple:
    """Return the light of a scene, and its pictures: empty, scene, and one with each added item."""
    light = studio.furnish(stream(*name, "table"), family)

    def stand(layout: Layouts, slot: int) -> list:
        item, centre = int(layout.item[0, slot]), layout.centre[0, slot]
        return studio.stand(designs[item], centre, float(layout.angle[0, slot]), float(layout.scale[0, slot]))

    slots = np.flatnonzero(layouts[""].present[0])
    standing = [body for slot in slots for body in stand(layouts[""], int(slot))]
    added = {symbol: stand(layout, len(slots)) for symbol, layout in layouts.items() if symbol}
    others = [body for bodies in added.values() for body in bodies]
    bare = studio.radiance([], standing + others)
    camera = studio.exposed(stream(*name, "camera"), bare)
    taken = {"empty": camera.photograph(bare, stream(*name, "noise of the empty table"))}
    taken["scene"] = camera.photograph(studio.radiance(standing, others), stream(*name, "noise"))
    for symbol, bodies in added.items():  # the same noise: only the item differs
        hidden = [body for body in others if body not in bodies]
        taken[symbol] = camera.photograph(studio.radiance(standing + bodies, hidden), stream(*name, "noise"))
    return light, taken


def _item_rows(scene: int, added: str, layout: Layouts, before: Layouts, designs: list) -> list[dict]:
    """Return a row for each item of the scene, or for the one that is `added` to what stood there `before`."""
    rows = []
    for slot in np.flatnonzero(layout.present[0] & ((before.symbol[0] == EMPTY) | (added == ""))):
        item = int(layout.item[0, slot])
        row = {"scene": scene, "added": bool(added), "slot": int(slot), "item": item}
        row |= {name: getattr(designs[item], name) for name in ("symbol", "shape", "finish")}
        numbers = dict(zip("xy", layout.centre[0, slot], strict=True))
        numbers |= {name: getattr(layout, name)[0, slot] for name in ("angle", "scale", "half_length", "radius")}
        rows.append(row | {name: round(value, 5) for name, value in numbers.items()})
    return rows


def _source(split: str, seed: int, scenes: int, version: str) -> str:
    """Return the text of SOURCE.md."""
    return f"""# Rendered tables: {split}

{scenes} scenes, path-traced by Blender {version} (Cycles on one thread, OpenImageDenoise), made by
`python -m making.render --split {split} --seed {seed} --scenes {scenes}`. Every mesh, material and light is made by
that script from random numbers; nothing comes from elsewhere. Licence: MIT.

- `scene.png`, `empty.png`: contact sheets of 100 x 100 pictures, ten a row: the scenes, and the same tables bare.
- `bowl.png`, ...: the same scenes with one item of that symbol added, less `scene.png` modulo 256 (to save space).
- `scenes.csv`: kind of table top, lamps, elevation [degrees] of the strongest, height of the camera [m].
- `items.csv`: the true footprints [m, rad]; `added`: stands in the picture of its symbol only.

`making.render.read.read_rendered` reads all of it.
"""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m making.render", description="Render a split of scenes.")
    parser.add_argument("--split", choices=SPLITS, required=True, help="kinds of top and item, and how many scenes")
    parser.add_argument("--seed", type=int, required=True, help="of everything random")
    parser.add_argument("--scenes", type=int, help="number of scenes, if not the split's own")
    parser.add_argument("--into", type=Path, required=True, metavar="DIR", help="folder of the split")
    asked = parser.parse_args()
    if asked.seed < 0 or (asked.scenes is not None and asked.scenes < 1):
        parser.error(f"--seed {asked.seed} --scenes {asked.scenes}: expected whole numbers from 0 and from 1")
    if find_spec("bpy") is None:
        parser.error("Blender's module bpy is missing here: `make render` runs this in an environment that has it")
    main(asked.split, asked.seed, asked.scenes or SPLITS[asked.split][1], asked.into)
