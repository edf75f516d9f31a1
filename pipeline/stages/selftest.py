"""Stage selftest: how often the causal procedure errs, on effects drawn anew from the measured ones and simulated."""

from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from pipeline.artifacts.effects import read_effects
from pipeline.artifacts.files import write_json
from pipeline.causal.interventions import DIGITS
from pipeline.causal.precision import POWER, detectable, scenes_to_settle, seed_by_seed
from pipeline.causal.selftest import Regime, check, observed, resampled, stylised
from pipeline.causal.statistics import LEVEL, SMALLEST_EFFECT
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.streams import stream
from pipeline.table.layout import SYMBOLS


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json: regime -> its standard deviations, and what `check` finds; how finely each effect is known."""
    s = cfg.selftest
    measured = read_effects(Path(cfg.paths.intervene), list(cfg.variants), cfg.evaluate.users)
    regimes = {name: Regime(**r) for name, r in s.stylised.items()}
    _, seeds, scenes = next(iter(measured.values())).shape
    size = {"families": s.families, "cells": s.cells, "seeds": seeds, "scenes": scenes}
    fixed = {"level": LEVEL, "smallest_effect": SMALLEST_EFFECT, "enough_power": POWER}
    ask = partial(_check, families=s.families, cells=s.cells, effects=list(s.effects), seeds=seeds, scenes=scenes)
    found = map_jobs(ask, [*measured.items(), *regimes.items()], cfg.workers, "selftest")
    spreads = [asdict(r) for r in (*map(observed, measured.values()), *regimes.values())]
    results = dict(zip((*measured, *regimes), (s | f for s, f in zip(spreads, found, strict=True)), strict=True))
    precision = {"precision": {v: _precision(cfg, v) for v in cfg.variants}}
    write_json(out_dir / "metrics.json", size | fixed | precision | {"measured": list(measured), "regimes": results})


def _precision(cfg: DictConfig, variant: str) -> dict:
    """user -> symbol -> the smallest effect that would have been found, and scenes that would settle its verdict."""
    users, directory = sorted(cfg.users), Path(cfg.paths.intervene)
    effects, truth = (read_effects(directory, [variant], users, c)[variant] for c in ("effect", "true_effect"))
    numbers = iter(zip(detectable(effects), scenes_to_settle(effects), strict=True))
    cells = {user: {symbol: _cell(*next(numbers)) for symbol in sorted(SYMBOLS)} for user in users}
    alone = {"right": seed_by_seed(effects, truth.mean((1, 2))), "of": effects.shape[0] * effects.shape[1]}
    return {"cells": cells, "seed_by_seed": alone}


def _cell(smallest: float, scenes: int | None) -> dict[str, float | int | None]:
    return {"detectable": round(float(smallest), DIGITS), "scenes": scenes}


def _check(
    job: tuple[str, Regime | np.ndarray], families: int, cells: int, effects: list[float], seeds: int, scenes: int
) -> dict:
    """`check` with chance as in measured effects (cell, seed, scene), or as a regime has it."""
    name, source = job
    draw = stylised(source, cells, seeds, scenes) if isinstance(source, Regime) else resampled(source)
    return check(stream("selftest", name), draw, families, cells, effects)


if __name__ == "__main__":
    launch(main, "selftest")
