"""A small full set of what the report reads: two seeds, made-up numbers under the stages' own names."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig, OmegaConf
from PIL import Image

from pipeline.artifacts.demos import write_demos
from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.models import model_dir
from pipeline.artifacts.scenes import SceneSet, layout_table, write_scenes
from pipeline.causal.interventions import study
from pipeline.params import compose
from pipeline.recording.screenshot import Screenshot, write_png
from pipeline.spec.registry import build
from pipeline.table.bezier import random_z_theta
from pipeline.table.layout import SYMBOLS, Items, Layouts, add_item, random_layouts
from tests.examples import RULES
from tests.report_answers import write_answers
from tests.stages.inputs import save_model

SCENES, STARTS, STEPS = 4, 6, 5
SMALL = [
    "profile=smoke", "report.map_side=10", "report.scenes=2", "report.reconstructed=2", "report.panel_scenes=2",
    "report.panel_side=8",
]  # fmt: skip
NULLS = ("null_nearest", "null_position")
FINE = {"detectable": 0.04, "scenes": 300}  # how finely an effect is known
ITEMS = Items(np.arange(4), np.array([0.0, 0.0, 0.09, 0.0]), np.array([0.06, 0.07, 0.013, 0.045]))


def write_all(folder: Path) -> DictConfig:
    """Write every artefact below `folder`; the parameters that find them come back."""
    cfg = compose(SMALL)
    for stage in cfg.paths:
        OmegaConf.update(cfg, f"paths.{stage}", str(folder / stage))
    rng = np.random.default_rng(0)
    layouts = _scenes(cfg, rng)
    _demos(cfg, rng)
    _evaluate(cfg, rng)
    _repair(cfg, rng)
    _intervene(cfg, rng, layouts[cfg.protocol.splits[cfg.intervene.split]])
    write_answers(cfg, rng)
    _record(cfg)
    for variant in cfg.variants:
        steps = pd.DataFrame({"step": [0, 10, 20], "total": [0.7, 0.5, 0.3]})
        keys = product(cfg.seeds, cfg.users, cfg.n)
        curves = [steps.assign(seed=seed, user=user, n=n) for seed, user, n in keys]
        write_table(model_dir(cfg, variant) / "curves.parquet", pd.concat(curves))
    for variant, user in product(cfg.variants, cfg.users):
        save_model(cfg, variant, build(cfg.variants[variant]), user, cfg.seeds[0])
    return cfg


def _record(cfg: DictConfig) -> None:
    """Digests of recordings; a picture of the overview as it is, and one of a run as it no longer is."""
    runs = [f"{v}-{user}-s{seed}" for v, user, seed in product(cfg.variants, cfg.users, cfg.seeds)]
    rows = [{"run": run, "sha256": f"of {run}", "agreement": 0.5} for run in runs]
    table = pd.DataFrame([*rows, {"run": "overview", "sha256": "of overview"}])
    write_table(Path(cfg.paths.record) / "recordings.csv", table)
    Path(cfg.paths.pictures).mkdir()
    for name, recording, contents in (("overview", "overview", "of overview"), ("learning", runs[0], "of another")):
        shot = Screenshot(Image.new("RGB", (64, 36), "teal"), recording, contents)
        write_png(Path(cfg.paths.pictures) / f"{name}.png", shot)


def _scenes(cfg: DictConfig, rng: np.random.Generator) -> dict[str, Layouts]:
    pools = [*(f"train-s{seed}" for seed in cfg.seeds), "new_scenes", "new_items"]
    layouts = {pool: random_layouts(rng, SCENES, ITEMS, np.arange(4), RULES) for pool in pools}
    images = {pool: _pictures(rng) for pool in pools}
    looks = {pool: pd.DataFrame({"texture": ["oak"] * SCENES, "render_seed": range(SCENES)}) for pool in pools}
    write_scenes(Path(cfg.paths.scenes), SceneSet(images, layouts, looks))
    cell = {"truth": 0.44, "paper": 0.43, "difference": 0.01}
    p_valid = {user: dict.fromkeys(("none", *SYMBOLS), cell) for user in cfg.users}
    metrics = {"p_valid": p_valid, "largest_difference": 0.01, "layouts": 100, "paths": 50}
    write_json(Path(cfg.paths.scenes) / "metrics.json", metrics)
    return layouts


def _pictures(rng: np.random.Generator) -> np.ndarray:
    """Grey tables with four squares each, for the path model to find."""
    pictures = rng.integers(110, 130, (SCENES, 100, 100, 3), dtype=np.uint8)
    for i in range(4):
        pictures[:, 40:49, 8 + 24 * i : 17 + 24 * i] = (200, 40, 60 * i)
    return pictures


def _demos(cfg: DictConfig, rng: np.random.Generator) -> None:
    index = product(cfg.seeds, sorted(cfg.users), range(SCENES), range(10))
    demos = pd.DataFrame(list(index), columns=["seed", "user", "scene", "demo"])
    z = random_z_theta(rng, len(demos))
    valid = (rng.random(len(demos)) < 0.5) | (demos["user"] == "aggressive")
    demos = demos.assign(z_x=z[:, 0], z_y=z[:, 1], valid=valid, residual_m=0.001)
    demos = demos.assign(poor_fit=False, duration_s=1.0, samples=0)
    write_demos(Path(cfg.paths.demos), demos, np.zeros((0, 4)), np.zeros(len(demos) + 1))


def _splits(cfg: DictConfig, variant: str) -> list[str]:
    return [s for s, pool in cfg.protocol.splits.items() if variant != "null_nearest" or pool is None]


def _evaluate(cfg: DictConfig, rng: np.random.Generator) -> None:
    folder, variants = Path(cfg.paths.evaluate), [*cfg.variants, *NULLS]
    keys = [
        (v, user, n, seed, split)
        for v in variants
        for user, n, seed in product(cfg.users, cfg.n, cfg.seeds)
        for split in _splits(cfg, v)
    ]
    scores = pd.DataFrame(keys, columns=["variant", "user", "n", "seed", "split"])
    scores = scores.assign(accuracy=0.5 + 0.4 * rng.random(len(keys)), auroc=0.7, brier=0.2, ece=0.1, count=50)
    write_table(folder / "accuracy.parquet", scores)
    curve = scores.groupby(["variant", "split", "n"])["accuracy"].agg(["mean", "min", "max"]).reset_index()
    write_table(folder / "accuracy.csv", curve.rename(columns={"min": "q1", "max": "q3"}))
    summary: dict = {}
    for row in curve.itertuples():
        cell = {"mean": row.mean, "q1": row.min, "q3": row.max, "seeds": len(cfg.seeds)}
        summary.setdefault(row.variant, {}).setdefault(row.split, {})[f"n{row.n}"] = cell
    errors = {v: {split: {"ece": 0.1, "brier": 0.2, "bias": 0.02} for split in _splits(cfg, v)} for v in variants}
    metrics = {"accuracy": summary, "accuracy_all_users": summary, "calibration": errors}
    cell = {"ci_low": 0.6, "ci_high": 0.8, "scenes": 20, "few": 1, "worst": 0.25, "worst_by_chance": 0.1}
    shared = [split for split, pool in cfg.protocol.splits.items() if pool is not None]
    metrics["in_new_scenes"] = dict.fromkeys([*cfg.variants, "null_position"], dict.fromkeys(shared, cell))
    write_json(folder / "metrics.json", metrics)
    bins = [(v, s, 0.0, 0.5, 40, 0.3, 0.2) for v in variants for s in _splits(cfg, v)]
    columns = ["variant", "split", "low", "high", "count", "confidence", "frequency"]
    write_table(folder / "calibration.parquet", pd.DataFrame(bins, columns=columns))
    against = [(a, s) for a in [*list(cfg.variants)[1:], "null_position"] for s in cfg.protocol.splits]
    against.append(("null_nearest", "seen_scenes"))
    tests = pd.DataFrame([(cfg.report.shown[0], a, s, cfg.study_n) for a, s in against])
    tests.columns = ["variant", "against", "split", "n"]
    beyond = [("path", a, s, cfg.study_n) for a in ("full", "irl_ranked") for s in cfg.protocol.splits]
    tests = pd.concat(
        [tests.assign(family="paper"), pd.DataFrame(beyond, columns=list(tests.columns)).assign(family="path")]
    )
    tests = tests.assign(mean=0.7, mean_against=0.6, difference=0.1, p=0.002, seeds=len(cfg.seeds), p_holm=0.04)
    write_table(folder / "comparisons.csv", tests.assign(significant=True))


def _repair(cfg: DictConfig, rng: np.random.Generator) -> None:
    tables, paths, metrics = [], {}, {}
    place = pd.DataFrame({"scene": np.repeat(np.arange(3), 2), "start": np.tile([0, 1], 3)})
    for user, seed in product(cfg.users, cfg.seeds):
        if user == "aggressive":
            continue
        for method in (*cfg.variants, "null_constant", "null_random", "oracle"):
            valid = rng.random(STARTS) < 0.7
            accepted = pd.array(valid if method in cfg.variants else [None] * STARTS, dtype="boolean")
            tables.append(place.assign(method=method, seed=seed, user=user, valid_end=valid, accepted=accepted))
        for variant in cfg.variants:
            z = random_z_theta(rng, STARTS, STEPS + 1)
            paths[f"{variant}-{user}-s{seed}"] = z.astype(np.float32)
    cell = {"success": 0.7, "success_q1": 0.6, "success_q3": 0.8, "fooled": 0.2, "abstained": 0.1}
    cell |= {"displacement_m": 0.3, "displacement_ratio": 1.5, "null_constant": 0.8, "null_random": 0.4, "oracle": 1.0}
    cell |= {f"{name}_displacement_ratio": 3.0 for name in ("null_constant", "null_random", "oracle")}
    for variant, user in product(cfg.variants, cfg.users):
        idle = user == "aggressive"
        shown = dict.fromkeys(cell) if idle else cell
        counts = {"seeds": len(cfg.seeds), "starts": 0 if idle else STARTS, "vacuous": idle}
        metrics.setdefault(variant, {})[user] = shown | counts
    write_table(Path(cfg.paths.repair) / "repairs.parquet", pd.concat(tables))
    write_arrays(Path(cfg.paths.repair) / "paths.npz", paths)
    write_json(Path(cfg.paths.repair) / "metrics.json", metrics)
    near: dict = {name: cell[name] for name in ("success", "success_q1", "success_q3", "fooled", "abstained")}
    near |= {"displacement_ratio": 1.4, "displacement_ratio_valid": 1.5, "starts": STARTS}
    near |= {"success_ci": [0.55, 0.85], "fooled_ci": [0.1, 0.3]}
    near["by_threshold"] = [
        {"above": t, "accepted": 1 - t / 2, "fooled": 0.2 - t / 10, "invalid": 0.1} for t in (0.5, 0.9)
    ]
    users = [u for u in cfg.users if u != "aggressive"]
    found = {model: {u: {"bayesian": near} for u in users} for model in (*cfg.variants, "truth")}
    write_json(Path(cfg.paths.search) / "metrics.json", found)
    z = random_z_theta(rng, 4, 1)[:, 0]
    ends = pd.DataFrame({"method": next(iter(cfg.variants)), "search": "bayesian", "scene": [0, 1, 1, 2]})
    ends = ends.assign(start=[0, 0, 1, 0], accepted=True, valid_end=[False, False, False, True], p_end=0.9)
    ends = ends.assign(clearance_m=[-0.002, -0.001, -0.008, 0.01], z0_x=z[:, 0], z0_y=z[:, 1], z_x=0.5, z_y=0.6)
    rows = [ends.assign(user=user, seed=cfg.seeds[0]) for user in users]
    write_table(Path(cfg.paths.search) / "searches.parquet", pd.concat(rows, ignore_index=True))


def _intervene(cfg: DictConfig, rng: np.random.Generator, layouts: Layouts) -> None:
    folder, users = Path(cfg.paths.intervene), list(cfg.users)
    keys = product(cfg.variants, cfg.seeds, users, range(SCENES), SYMBOLS, [0])
    rows = pd.DataFrame(list(keys), columns=["variant", "seed", "user", "scene", "symbol", "placement"])
    rows = rows.assign(baseline=0.5, intervened=0.4, effect=-0.1)
    rows = rows.assign(true_baseline=0.5, true_intervened=0.3, true_effect=-0.2)
    write_table(folder / "effects.parquet", rows)
    added = rng.integers(0, 255, (len(SYMBOLS), 1, SCENES, 100, 100, 3), dtype=np.uint8)
    write_arrays(folder / "images.npz", {"images": added})
    with_items = [add_item(rng, layouts, symbol, ITEMS, np.arange(4), RULES) for symbol in range(4)]
    tables = [layout_table(f"{symbol}-0", x) for symbol, x in zip(SYMBOLS, with_items, strict=True)]
    write_table(folder / "layouts.parquet", pd.concat(tables, ignore_index=True))

    def cells(count: int) -> list[dict]:
        truth = np.where(np.arange(count) < count // 2, 0.3, 0.5)[:, None].repeat(SCENES, 1)
        before = np.full((count, len(cfg.seeds), SCENES), 0.5)
        return study(before, before - 0.01 * rng.random(before.shape), truth * 0 + 0.5, truth)

    effects: dict = {}
    exchanges: dict = {}
    for variant in cfg.variants:
        found, pairs = iter(cells(len(users) * len(SYMBOLS))), iter(cells(len(users) * (len(users) - 1)))
        effects[variant] = {user: {symbol: next(found) for symbol in SYMBOLS} for user in users}
        exchanges[variant] = {user: {other: next(pairs) for other in users if other != user} for user in users}
    tally = {"cells": 12, "right": 6, "false_causes": 0, "missed_causes": 6, "inconclusive": 0}
    metrics = {"interventions": effects, "specifications": exchanges, "verdicts": dict.fromkeys(cfg.variants, tally)}
    graph = {"S": [], "O": [], "Z_theta": [], "I": ["O"], "Z_I": ["I"], "V": ["S", "Z_I", "Z_theta"]}
    size = {"scenes": SCENES, "paths": 16, "placements": 1, "seeds": 2, "scm": graph}
    write_json(folder / "metrics.json", metrics | size)
    said = {"effect": 0.9, "no effect": 0.0, "inconclusive": 0.1}
    regime = {"by_seed": 0.01, "by_scene": 0.1, "rest": 0.1, "skewed": False, "family_wise_error": 0.04}
    regime |= {"false_causes": 0.01, "coverage": 0.95, "power": {"0.05": dict.fromkeys(said, 1 / 3), "0.1": said}}
    size = {"families": 20, "cells": 12, "seeds": len(cfg.seeds), "scenes": SCENES, "level": 0.05}
    size |= {"smallest_effect": 0.05, "enough_power": 0.8}
    size |= {"measured": list(cfg.variants)}
    known = {user: dict.fromkeys(SYMBOLS, FINE) for user in users}
    size |= {"precision": {v: {"cells": known, "seed_by_seed": {"right": 20, "of": 24}} for v in cfg.variants}}
    regimes = {name: regime for name in (*cfg.variants, "both alike")}
    write_json(Path(cfg.paths.selftest) / "metrics.json", size | {"regimes": regimes})
