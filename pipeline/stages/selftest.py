"""Stage selftest: how often the causal procedure errs on simulated effects, in regimes like the measured ones."""

from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from pipeline.artifacts.effects import read_effects
from pipeline.artifacts.files import write_json
from pipeline.causal.interventions import DIGITS
from pipeline.causal.precision import detectable, scenes_to_settle, seed_by_seed
from pipeline.causal.selftest import Regime, check, observed
from pipeline.causal.statistics import LEVEL
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.params import InputError
from pipeline.spec.training import job_seed
from pipeline.table.layout import SYMBOLS


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json: regime -> its standard deviations, and what `check` finds; how finely each effect is known."""
    s = cfg.selftest
    for name in ("families", "cells"):
        if not (isinstance(s[name], int) and s[name] >= 1):
            raise InputError(f"selftest.{name} is {s[name]!r}: expected a whole number from 1")
    if unknown := set(s.variants) - set(cfg.variants):
        raise InputError(f"selftest.variants names {', '.join(sorted(unknown))}: expected some of {list(cfg.variants)}")
    measured = read_effects(Path(cfg.paths.intervene), s.variants, cfg.evaluate.users)
    regimes = {v: observed(effects) for v, effects in measured.items()}
    regimes |= {name: Regime(**r) for name, r in s.stylised.items()}
    seeds, scenes = next(iter(measured.values())).shape[1:]
    ask = partial(_check, families=s.families, cells=s.cells, seeds=seeds, scenes=scenes, effects=list(s.effects))
    found = map_jobs(ask, list(regimes.items()), cfg.workers, "selftest")
    size = {"families": s.families, "cells": s.cells, "seeds": seeds, "scenes": scenes, "level": LEVEL}
    results = {name: asdict(r) | f for (name, r), f in zip(regimes.items(), found, strict=True)}
    precision = {"precision": {v: _precision(cfg, v) for v in cfg.variants}}
    write_json(out_dir / "metrics.json", size | precision | {"measured": list(s.variants), "regimes": results})


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


def _check(job: tuple[str, Regime], **size) -> dict:
    name, regime = job
    return check(np.random.default_rng(job_seed("selftest", name)), regime, **size)


if __name__ == "__main__":
    launch(main, "selftest")
