"""A made-up run, as large as the stage makes them, for the tests of recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

from pipeline.recording.contents import Demonstrations, Repairs, Run
from pipeline.table.bezier import curve, lattice, random_z_theta
from pipeline.table.layout import SYMBOLS, Layouts, empty
from pipeline.table.rules import valid

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


def a_run(repairs: int = 4) -> Run:
    """As large as the stage makes them: three scenes of each kind, images that no compression helps."""
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
        image = rng.integers(0, 256, (100, 100, 3), dtype=np.uint8)
        truth = valid(layout, z[None], MARGINS)[0]
        demonstrations.append(Demonstrations(scene, image, layout, z, truth, samples))
        steps = random_z_theta(rng, repairs, STEPS + 1).astype(np.float32)
        repaired.append(
            Repairs(
                scene=scene,
                image=rng.integers(0, 256, (100, 100, 3), dtype=np.uint8),
                layout=layout,
                predicted=rng.random((SIDE, SIDE), dtype=np.float32),
                truth=valid(layout, cells, MARGINS).reshape(SIDE, SIDE),
                start=tuple(range(0, 2 * repairs, 2)),
                z=steps,
                p=rng.random((repairs, STEPS + 1), dtype=np.float32),
                ends_valid=valid(layout, steps[None, :, -1].astype(float), MARGINS)[0],
            )
        )
    return Run("full", "careful", 3, 9, MARGINS, tuple(demonstrations), tuple(repaired))


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


def read(path: Path, entity: str, component: str) -> list:
    """The rows of one component, in the order of the time line where there is one."""
    rows = []
    for chunk in RrdReader(path).stream().filter(content=f"/{entity}").to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            times = batch[chunk.timeline_names[0]].to_pylist() if chunk.timeline_names else [-1]
            rows += zip(times, batch[component].to_pylist(), strict=True)
    return [value for _, value in sorted(rows, key=lambda row: row[0])]
