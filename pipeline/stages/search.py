"""Stage search: repairs that stay near their start, by several methods, beside what knowing the truth would give."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from omegaconf import DictConfig

from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.repairs import Starts, check_pool, draw_starts, rows
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.causal.repairs import by_threshold, summary
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.search import Found, Near, search
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
    rivals = dict(cfg.search.rivals)
    scenes = read_scenes(Path(cfg.paths.scenes))
    images = scenes.images[check_pool(cfg, scenes)]
    check_weights(cfg)
    _, starts = draw_starts(cfg, scenes)
    jobs = [
        Job(cfg, variant, seed, s, images, {"bayesian": None} | (rivals if variant == cfg.search.rivals_of else {}))
        for variant in [*cfg.variants, TRUTH]
        for s in starts.values()
        if len(s.z)
        for seed in (cfg.protocol.seeds if variant != TRUTH else cfg.protocol.seeds[:1])
    ]
    tables = [t for found in map_jobs(run, jobs, cfg.workers, "searches") for t in found]
    write_table(out_dir / "searches.parquet", pd.concat(tables, ignore_index=True))
    write_json(out_dir / "metrics.json", _metrics(tables, list(cfg.search.thresholds)))


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
    """conf/search as the library takes it."""
    s = cfg.search
    return Near(s.evaluations, float(s.weight), s.looks, s.climb, float(s.reach), float(s.step))


def _rows(starts: Starts, job: Job, method: str, ends: Found) -> pd.DataFrame:
    """The table of stage repair, and by which method."""
    p = np.stack([np.full(len(starts.z), np.nan, np.float32), ends.p[:, 0]], axis=1)
    return rows(starts, job.variant, job.seed, ends.z[:, 0], p).drop(columns="p_start").assign(search=method)


def _metrics(tables: list[pd.DataFrame], thresholds: list[float]) -> dict:
    """variant -> user -> method -> `summary` over seeds, `by_threshold`, seeds and starts."""
    by_seed: dict[tuple[str, str, str], list[pd.DataFrame]] = {}
    for t in tables:
        first = t.iloc[0]
        by_seed.setdefault((first["method"], first["user"], first["search"]), []).append(t)
    out: dict = {}
    for (variant, user, method), of in by_seed.items():
        cell = summary(of) | {"seeds": len(of), "starts": len(of[0]), "by_threshold": by_threshold(of, thresholds)}
        out.setdefault(variant, {}).setdefault(user, {})[method] = cell
    return out


if __name__ == "__main__":
    launch(main, "search")
