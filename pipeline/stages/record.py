"""Stage record: write a Rerun recording per variant, user and seed, an overview, and a digest of each file."""

import shutil
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.files import read_table, write_table
from pipeline.launch import launch
from pipeline.models.trained import check_weights
from pipeline.runtime.settings import Count, Group, Several, need
from pipeline.runtime.writing import atomic_write
from pipeline.viewer.contents import assemble, read_sources
from pipeline.viewer.digest import digest
from pipeline.viewer.run import write_overview, write_run


class Settings(Group):
    scenes: Count
    repairs: Count
    training_scenes: Count
    map_side: Several


def agree(record: Settings, parameters: Any) -> None:
    """Reject different splits, since a recording shows repairs and interventions together."""
    same = f"repair.split = {parameters.repair.split!r}, since a recording shows both"
    need(parameters.intervene.split == parameters.repair.split, "intervene.split", parameters.intervene.split, same)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write runs/{variant}-{user}-s{seed}.rrd of every model at main_n_demos, runs/overview.rrd and recordings.csv.

    A user without margins has no runs if another has some: all their paths are valid. The overview shows the first
    seed's models. recordings.csv holds each recording's digest, and the accuracy of runs.
    """
    check_weights(cfg)
    sources = read_sources(cfg)
    table = read_table(Path(cfg.paths.evaluate) / "accuracy.parquet")
    table = table[(table["split"] == cfg.repair.split) & (table["n_demos"] == cfg.main_n_demos)]
    accuracy = table.set_index(["variant", "user", "seed"])["accuracy"]
    caring = [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]
    rows, compared = [], []
    shutil.rmtree(out_dir / "runs", ignore_errors=True)  # remove recordings of earlier models
    models = list(product(cfg.variants, caring or cfg.users, cfg.protocol.seeds))
    for variant, user, seed in tqdm(models, desc="recordings"):  # one process: Rerun has hung next to torch workers
        run = assemble(cfg, sources, variant, user, seed)
        path = out_dir / "runs" / f"{run.name}.rrd"
        atomic_write(path, lambda part, run=run: write_run(part, run))
        right = accuracy[variant, user, seed]
        rows.append({"run": run.name, "variant": variant, "sha256": digest(path), "accuracy": right})
        if seed == cfg.protocol.seeds[0]:
            compared.append(run)
    compared.sort(key=lambda run: not cfg.variants[run.variant].compared)
    path = out_dir / "runs" / "overview.rrd"
    atomic_write(path, lambda part: write_overview(part, compared))
    write_table(out_dir / "recordings.csv", pd.DataFrame([*rows, {"run": "overview", "sha256": digest(path)}]))


if __name__ == "__main__":
    launch(main, "record")
