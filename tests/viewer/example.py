"""Example runs, as large as the stage makes them, and readers of recordings."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from pipeline.viewer.contents import Demonstrations, Intervention, Learning, Repairs, Run, Shown
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


def a_map(rng: np.random.Generator) -> np.ndarray:
    return rng.random((SIDE, SIDE), dtype=np.float32)


def true_map(layout: Layouts) -> np.ndarray:
    return valid(layout, lattice(SIDE)[None], MARGINS).reshape(SIDE, SIDE)


def a_run(repairs: int = 3) -> Run:
    """As large as the stage makes them, with repairs of every end in each scene, and maps no compression helps."""
    rng, layout = np.random.default_rng(0), a_layout()
    demonstrations, repaired, interventions = [], [], []
    for scene in range(3):
        z, time = random_z_theta(rng, 9), np.linspace(0, 3, 150)
        samples = tuple(
            np.column_stack([time, path + rng.normal(0, 0.003, path.shape), 0 * time]).astype(np.float32)
            for path in curve(z, len(time))
        )
        labels = valid(layout, z[None], MARGINS)[0]
        demonstrations.append(Demonstrations(scene, an_image(rng), layout, z, labels, samples))
        steps = random_z_theta(rng, repairs, STEPS + 1).astype(np.float32)
        slacks = slack(layout, clearance(layout, steps.reshape(1, -1, 2)), MARGINS).reshape(repairs, STEPS + 1)
        ends = valid(layout, steps[None, :, -1].astype(float), MARGINS)[0]
        shown = tuple(range(0, 2 * repairs, 2)), steps, rng.normal(0, 9, slacks.shape), slacks, ends, 5
        repaired.append(Repairs(scene, an_image(rng), layout, a_map(rng), true_map(layout), *shown))
    for symbol in SYMBOLS:
        more, image = a_layout(), repaired[0].image.copy()
        more.symbol[0, 2], more.item[0, 2] = SYMBOLS.index(symbol), 2
        more.centre[0, 2], more.radius[0, 2], more.scale[0, 2] = rng.uniform(0.2, 0.8, 2), 0.05, 1.0
        image[40:52, 30:42] = 255
        learned, true, learned_mean, true_mean = rng.uniform(-1, 1, 4)
        interventions.append(
            Intervention(symbol, image, more, a_map(rng), true_map(more), learned, true, learned_mean, true_mean, 100)
        )
    losses = {term: rng.random(100) for term in ("reconstruction", "kl", "classification", "total")}
    by_n, by_step = ({at: a_map(rng) for at in points} for points in ((1, 5, 9), (0, 50, 100, 200, 400, 700, 1000)))
    learning = Learning(np.arange(0, 1000, 10), losses, by_n, by_step)
    names = ("full", "careful", 3, 9, "paper", "0123456789ab", 2040, "train: {rate: 0.003}\n")
    shown = tuple(Shown(x.scene, x.image, x.layout, x.predicted, x.truth) for x in repaired)
    facts = {"accuracy": 0.5, "repairs": 90, "unsafe_repairs": 7, "verdicts": 4, "verdicts_right": 3}
    parts = tuple(demonstrations[:2]), shown, tuple(repaired), tuple(interventions)
    return Run(*names, MARGINS, *parts, learning, facts)


def some_runs() -> list[Run]:
    """Two variants of two users in the same scenes; the second user cares for no item in them."""
    rng, runs = np.random.default_rng(1), []
    whole, none = a_run(repairs=1), dict.fromkeys(MARGINS) | {"glass": 0.042}
    for variant, (user, margins) in product(("full", "ae"), (("careful", MARGINS), ("normal", none))):
        truths = [shown.truth if user == "careful" else np.ones_like(shown.truth) for shown in whole.shown]
        pairs = zip(whole.shown, truths, strict=True)
        scenes = tuple(replace(shown, predicted=a_map(rng), truth=truth) for shown, truth in pairs)
        runs.append(replace(whole, variant=variant, user=user, margins=margins, shown=scenes))
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
