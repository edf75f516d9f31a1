"""Example runs, as large as the stage makes them, and readers of recordings."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from pipeline.viewer.contents import Demonstrations, Intervention, Learning, Repairs, Run
from pipeline.world.bezier import curve, lattice, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, empty
from pipeline.world.rules import clearance, slack, valid

SIDE, STEPS = 35, 30
MARGINS: dict[str, float | None] = {"bowl": 0.045, "plate": 0.045, "cutlery": 0.045, "glass": None}


def a_layout() -> Layouts:
    """A round bowl and a long piece of cutlery."""
    layout = empty(1, 4)
    layout.symbol[0, :2] = SYMBOLS.index("bowl"), SYMBOLS.index("cutlery")
    layout.item[0, :2] = 0, 1
    layout.centre[0, :2] = [[0.6, 0.4], [0.3, 0.7]]
    layout.angle[0, 1], layout.half_length[0, 1] = 0.7, 0.09
    layout.radius[0, :2] = 0.06, 0.013
    layout.scale[0, :2] = 1.0
    return layout


def an_image(rng: np.random.Generator) -> np.ndarray:
    """As hard to compress as a rendered table: some 18 kB as a PNG."""
    return rng.integers(100, 132, (100, 100, 3), dtype=np.uint8)


def a_run(repairs: int = 3) -> Run:
    """As large as the stage makes them, with repairs of every end in each scene, and maps no compression helps."""
    rng = np.random.default_rng(0)
    layout = a_layout()
    cells = lattice(SIDE)[None]
    demonstrations, repaired = [], []
    for scene in range(3):
        z = random_z_theta(rng, 9)
        time = np.linspace(0, 3, 150)
        samples = tuple(
            np.column_stack([time, path + rng.normal(0, 0.003, path.shape), 0 * time]).astype(np.float32)
            for path in curve(z, len(time))
        )
        truth = valid(layout, z[None], MARGINS)[0]
        demonstrations.append(Demonstrations(scene, an_image(rng), layout, z, truth, samples))
        steps = random_z_theta(rng, repairs, STEPS + 1).astype(np.float32)
        repaired.append(
            Repairs(
                scene=scene,
                image=an_image(rng),
                layout=layout,
                predicted=rng.random((SIDE, SIDE), dtype=np.float32),
                truth=valid(layout, cells, MARGINS).reshape(SIDE, SIDE),
                start=tuple(range(0, 2 * repairs, 2)),
                z=steps,
                p=rng.random((repairs, STEPS + 1), dtype=np.float32),
                slack=slack(layout, clearance(layout, steps.reshape(1, -1, 2)), MARGINS).reshape(repairs, STEPS + 1),
                ends_valid=valid(layout, steps[None, :, -1].astype(float), MARGINS)[0],
            )
        )
    interventions = tuple(_an_intervention(rng, symbol, repaired[0].image) for symbol in SYMBOLS)
    learning = Learning(
        np.arange(0, 1000, 10),
        {term: rng.random(100) for term in ("reconstruction", "kl", "classification", "total")},
        {n: rng.random((SIDE, SIDE), dtype=np.float32) for n in (1, 3, 5, 7, 9)},
        {step: rng.random((SIDE, SIDE), dtype=np.float32) for step in (0, 50, 100, 200, 400, 700, 1000)},
    )
    names = ("full", "careful", 3, 9, "paper", "0123456789ab", 2040, "train: {rate: 0.003}\n")
    return Run(*names, MARGINS, tuple(demonstrations[:2]), tuple(repaired), interventions, learning)


def _an_intervention(rng: np.random.Generator, symbol: str, before: np.ndarray) -> Intervention:
    layout, image = a_layout(), before.copy()
    layout.symbol[0, 2], layout.item[0, 2] = SYMBOLS.index(symbol), 2
    layout.centre[0, 2], layout.radius[0, 2], layout.scale[0, 2] = rng.uniform(0.2, 0.8, 2), 0.05, 1.0
    image[40:52, 30:42] = 255
    truth = valid(layout, lattice(SIDE)[None], MARGINS).reshape(SIDE, SIDE)
    predicted = rng.random((SIDE, SIDE), dtype=np.float32)
    learned, true, learned_mean, true_mean = rng.uniform(-1, 1, 4)
    return Intervention(symbol, image, layout, predicted, truth, learned, true, learned_mean, true_mean, 100)


def some_runs() -> list[Run]:
    """Two variants of two users in the same scenes; the second user cares for no item in them."""
    rng = np.random.default_rng(1)
    whole, none = a_run(repairs=1), dict.fromkeys(MARGINS) | {"glass": 0.042}
    runs = []
    for variant in ("full", "ae"):
        for user, margins in (("careful", MARGINS), ("normal", none)):
            repairs = tuple(
                replace(
                    shown,
                    predicted=rng.random((SIDE, SIDE), dtype=np.float32),
                    truth=shown.truth if user == "careful" else np.ones_like(shown.truth),
                )
                for shown in whole.repairs
            )
            runs.append(replace(whole, variant=variant, user=user, margins=margins, repairs=repairs))
    return runs


def read(path: Path, entity: str, component: str, timeline: str | None = None) -> list:
    """The rows of one component, in the order of the time line, which need not be named where there is but one."""
    return [value for _, value in read_timed(path, entity, component, timeline)]


def read_timed(path: Path, entity: str, component: str, timeline: str | None = None) -> list[tuple[Any, list]]:
    """The same rows, each with its time."""
    rows = []
    for chunk in RrdReader(path).stream().filter(content=f"/{entity}").to_chunks():
        batch = chunk.to_record_batch()
        on_it = not chunk.timeline_names or timeline in (None, *chunk.timeline_names)
        if component in batch.schema.names and on_it:
            times = batch[timeline or chunk.timeline_names[0]].to_pylist() if chunk.timeline_names else [-1]
            rows += zip(times, batch[component].to_pylist(), strict=True)
    return sorted(rows, key=lambda row: row[0])


def read_maps(path: Path, entity: str, side: int = SIDE, timeline: str | None = None) -> np.ndarray:
    """The classes [row, y, x] of an entity's maps, the largest y last."""
    buffers = [buffer for (buffer,) in read(path, f"{entity}/map", "SegmentationImage:buffer", timeline)]
    return np.array(buffers, np.uint8).reshape(-1, side, side)[:, ::-1]
