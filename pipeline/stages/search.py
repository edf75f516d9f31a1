"""Stage search: repairs that stay near their start, by several methods, beside what knowing the truth would give."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from omegaconf import DictConfig

from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.repairs import MEASURES, Starts, check_pool, draw_starts, measures, rows
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.causal.statistics import quartiles
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.params import need
from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.search import METHODS, Found, Near, search
from pipeline.spec.specification import to_tensor
from pipeline.spec.things import FEATURES
from pipeline.streams import job_seed
from pipeline.table.layout import SYMBOLS, Layouts
from pipeline.table.rules import Margins

SURE = 20.0  # log-odds of what is known
TRUTH = "truth"  # a model that was told the footprints and the margins: what the search itself loses


@dataclass(frozen=True)
class Job:
    """One model's searches from every invalid start of its user."""

    cfg: DictConfig
    variant: str
    seed: int
    starts: Starts
    images: np.ndarray
    methods: dict[str, int | None]  # method -> how many starts, None for all


def main(cfg: DictConfig, out_dir: Path) -> None:
    """searches.parquet and metrics.json of all variants, users, seeds and methods at study_n."""
    near(cfg)
    rivals = _rivals(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    images = scenes.images[check_pool(cfg, scenes)]
    check_weights(cfg)
    _, starts = draw_starts(cfg, scenes)
    jobs = [
        Job(cfg, variant, seed, s, images, {"probe": None} | (rivals if variant == cfg.search.rivals_of else {}))
        for variant in [*cfg.variants, TRUTH]
        for s in starts.values()
        if len(s.z)
        for seed in (cfg.protocol.seeds if variant != TRUTH else cfg.protocol.seeds[:1])
    ]
    tables = [t for found in map_jobs(run, jobs, cfg.workers, "searches") for t in found]
    write_table(out_dir / "searches.parquet", pd.concat(tables, ignore_index=True))
    write_json(out_dir / "metrics.json", _metrics(tables))


def run(job: Job) -> list[pd.DataFrame]:
    """A table of ends for each of the job's methods."""
    s, found = job.starts, []
    with torch.no_grad():
        if job.variant == TRUTH:
            model, percept = told(s.layouts, s.margins)
        else:
            model = load_model(job.cfg, job.variant, s.user, job.seed, job.cfg.study_n)
            percept = model.perceive(to_tensor(job.images))
    for method, count in job.methods.items():
        some = s.first(count)
        seed = job_seed(job.cfg.scenes.generator, "search", job.seed, s.user, method)
        ends = search(model, percept[some.at[0]], some.z[:, None], method, near(job.cfg), seed)
        found.append(_rows(some, job, method, ends))
    return found


def told(layouts: Layouts, margins: Margins) -> tuple[ClearanceModel, torch.Tensor]:
    """A path model that was told what is true, and its percepts: what the user cares about, widened by the margins."""
    model = ClearanceModel(members=1)
    with torch.no_grad():
        model.weight.zero_()
        model.weight[:, 0] = model.clear[:] = SURE
        model.evidence.fill_(SURE)
        model.width.fill_(-SURE)
    margin = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])[layouts.symbol]
    cares = np.isfinite(margin)
    parts = (
        layouts.ends.reshape(*cares.shape, 4), (layouts.radius + np.where(cares, margin, 0.0))[..., None],
        np.zeros((*cares.shape, len(FEATURES))), cares[..., None],
    )  # fmt: skip
    return model.eval(), torch.from_numpy(np.concatenate(parts, -1, dtype=np.float32))


def near(cfg: DictConfig) -> Near:
    """conf/search as the library takes it; InputError for a value out of range."""
    s = cfg.search
    return Near(s.evaluations, float(s.weight), s.probes, float(s.reach), float(s.step))


def _rivals(cfg: DictConfig) -> dict[str, int | None]:
    """The methods beside `probe`; InputError for one that does not exist."""
    rivals = dict(cfg.search.rivals)
    known = [m for m in METHODS if m != "probe"]
    need(cfg, "search.rivals", set(rivals) <= set(known), f"some of {', '.join(known)}")
    there = not rivals or cfg.search.rivals_of in cfg.variants
    need(cfg, "search.rivals_of", there, f"one of {', '.join(cfg.variants)}")
    return rivals


def _rows(starts: Starts, job: Job, method: str, ends: Found) -> pd.DataFrame:
    """The table of stage repair, and by which method."""
    p = np.stack([np.full(len(starts.z), np.nan, np.float32), ends.p[:, 0]], axis=1)
    return rows(starts, job.variant, job.seed, ends.z[:, 0], p).drop(columns="p_start").assign(search=method)


def _metrics(tables: list[pd.DataFrame]) -> dict:
    """variant -> user -> method -> means over seeds and quartiles (`_q1`, `_q3`), seeds and starts."""
    by_seed: dict[tuple[str, str, str], list[dict[str, float]]] = {}
    for t in tables:
        first = t.iloc[0]
        key = (first["method"], first["user"], first["search"])
        by_seed.setdefault(key, []).append(measures(t) | {"starts": len(t)})
    out: dict = {}
    for (variant, user, method), values in by_seed.items():
        cell: dict = {"seeds": len(values), "starts": values[0]["starts"]}
        for name in MEASURES:
            spread = quartiles(np.array([v[name] for v in values]))
            cell |= {name: spread["mean"], f"{name}_q1": spread["q1"], f"{name}_q3": spread["q3"]}
        out.setdefault(variant, {}).setdefault(user, {})[method] = cell
    return out


if __name__ == "__main__":
    launch(main, "search")
