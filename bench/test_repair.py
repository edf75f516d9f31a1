"""A path model fitted, and a thousand repairs by it at once, against the same repairs one start at a time."""

import time

import numpy as np
import pytest
import torch
from pipeline.spec.search import Near, search

from pipeline.models.base import to_tensor, untrained
from pipeline.models.clearance.clearance import ClearanceModel, fit
from pipeline.params import compose
from pipeline.perception.objects import _detect
from pipeline.runtime.parallel import one_thread
from pipeline.training.loop import Schedule
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import LayoutRules, random_layouts
from pipeline.world.render import read_palette, render_scenes
from pipeline.world.rules import valid

TRAINING, SCENES, STARTS, FEW = 20, 100, 10, 20  # scenes; scenes and starts in each; starts one at a time


@pytest.mark.benchmark(group="repair")
def test_a_thousand_repairs_at_once(benchmark):
    """Seconds to fit a model, milliseconds a repair with and without looking for what lies on the table."""
    one_thread()
    cfg, (catalogue, palette) = compose(), read_palette("data")
    rng, rules = np.random.default_rng(0), LayoutRules.of(cfg.scenes.layout)
    layouts = random_layouts(rng, TRAINING + SCENES, catalogue.footprints, catalogue.pool("train"), rules)
    images = render_scenes(layouts, ["oak"] * len(layouts), range(len(layouts)), palette)
    z = random_z_theta(rng, TRAINING, cfg.main_n_demos)
    labels = valid(layouts[:TRAINING], z, dict(cfg.users.careful))
    model = untrained(ClearanceModel, cfg.variants.path.model, 0)
    assert isinstance(model, ClearanceModel)
    begin = time.perf_counter()
    fit([model], [images[:TRAINING]], [z], [labels], Schedule.of(cfg.clearance), [0])
    fitted = time.perf_counter() - begin

    near = Near(**{k: cfg.search[k] for k in ("evaluations", "weight", "looks", "climb", "reach", "step")})
    starts = random_z_theta(rng, SCENES * STARTS, 1)
    with torch.no_grad():
        _detect.cache_clear()
        begin = time.perf_counter()
        percept = model.perceive(to_tensor(images[TRAINING:])).repeat_interleave(STARTS, 0)
        perceived = time.perf_counter() - begin
        benchmark.pedantic(lambda: search(model, percept, starts, "bayesian", near, 0), rounds=3, warmup_rounds=1)
        begin = time.perf_counter()
        for i in range(FEW):
            search(model, percept[i : i + 1], starts[i : i + 1], "bayesian", near, 0)
        alone = (time.perf_counter() - begin) / FEW
    together = benchmark.stats.stats.min / len(starts)
    benchmark.extra_info["results"] = {
        "train_seconds_path": fitted,
        "repair_ms": 1e3 * together,
        "repair_ms_perceived": 1e3 * (together + perceived / len(starts)),
        "repair_speedup_one_by_one": alone / together,
    }
    assert alone / together > 5
