"""Time fitting a clearance model and a thousand repairs by it: all starts of a scene at once, and one at a time."""

import time
import timeit
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.models.base import untrained
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.params import compose
from pipeline.planning.nearest import by_model, nearest
from pipeline.training.clearance.fit import fit
from pipeline.training.loop import Schedule
from pipeline.world.bezier import bezier, random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import LayoutRules, random_layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid
from tests.factories import as_controls

TRAINING, SCENES, STARTS, ALONE = 20, 100, 10, 20  # scenes; scenes and starts per scene; starts one at a time
POINTS = 200  # of a path that is given as a polyline


@pytest.mark.benchmark(group="repair")
def test_a_thousand_repairs(benchmark):
    """Measure seconds per fit and milliseconds per repair, with and without object detection."""
    cfg, catalogue = compose(), read_catalogue(Path("data"))
    rng, rules = np.random.default_rng(0), LayoutRules.of(cfg.scenes.layout)
    layouts = random_layouts(rng, TRAINING + SCENES, catalogue.footprints, catalogue.pool("train"), rules)
    images = render_scenes(layouts, ["oak"] * len(layouts), range(len(layouts)), Palette(catalogue))
    z = random_z_theta(rng, TRAINING, cfg.main_n_demos)
    labels = valid(layouts[:TRAINING], z, dict(cfg.users.careful))
    model = untrained(ClearanceModel, cfg.variants.clearance.model, 0)
    assert isinstance(model, ClearanceModel)
    begin = time.perf_counter()
    fit([model], [images[:TRAINING]], [z], [labels], Schedule.of(cfg.clearance), [0])
    fitted = time.perf_counter() - begin

    begin = time.perf_counter()
    log_valid = by_model(model, images[TRAINING:])
    perceived = time.perf_counter() - begin
    settings = float(cfg.repair.distance_penalty), cfg.repair.lattice_side, cfg.repair.refinements
    starts, scenes = random_z_theta(rng, SCENES * STARTS), np.repeat(np.arange(SCENES), STARTS)
    benchmark.pedantic(lambda: nearest(log_valid, scenes, starts, *settings), rounds=3, warmup_rounds=1)
    begin = time.perf_counter()
    for i in range(ALONE):
        nearest(log_valid, scenes[i : i + 1], starts[i : i + 1], *settings)
    alone = (time.perf_counter() - begin) / ALONE
    z, percept = random_z_theta(rng, SCENES, STARTS), model.see(images[TRAINING:])
    kinds = [torch.from_numpy(x).float() for x in (z, bezier(as_controls(z), POINTS))]
    with torch.no_grad():
        rounds = [[timeit.timeit(partial(model.logit, percept, x), number=1) for x in kinds] for _ in range(99)]
    together = benchmark.stats.stats.min / len(starts)
    benchmark.extra_info["results"] = {
        "train_seconds_clearance": fitted,
        "repair_ms": 1e3 * together,
        "repair_ms_perceived": 1e3 * (together + perceived / len(starts)),
        "repair_speedup_one_by_one": alone / together,
        "curve_over_parabola": float(np.median([curve / parabola for parabola, curve in rounds])),  # turn by turn
        "detect_ms": 1e3 * perceived / SCENES,
    }
