"""Stage record: write one Rerun recording per variant, user and seed, an overview, and a digest of each file."""

import shutil
from itertools import product
from pathlib import Path

import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.files import write_table
from pipeline.artifacts.trained import check_weights
from pipeline.launch import launch
from pipeline.runtime.writing import atomic_write
from pipeline.viewer.assemble import assemble, read_sources
from pipeline.viewer.digest import digest
from pipeline.viewer.overview import write_overview
from pipeline.viewer.run import write_run


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write runs/{variant}-{user}-s{seed}.rrd of every model at main_n_demos, overview.rrd and recordings.csv.

    The overview shows the first seed's models. recordings.csv holds each recording's digest and, for runs, the share of
    map cells on which model and truth agree.
    """
    check_weights(cfg)
    sources = read_sources(cfg)
    caring = [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]
    rows, compared = [], []
    shutil.rmtree(out_dir / "runs", ignore_errors=True)  # remove recordings of earlier models
    models = list(product(cfg.variants, cfg.users, cfg.protocol.seeds))
    for variant, user, seed in tqdm(models, desc="recordings"):  # one process: Rerun has hung next to torch workers
        run = assemble(cfg, sources, variant, user, seed)
        path = out_dir / "runs" / f"{run.name}.rrd"
        atomic_write(path, lambda part, run=run: write_run(part, run))
        rows.append({"run": run.name, "sha256": digest(path), "agreement": run.agreement})
        if seed == cfg.protocol.seeds[0] and user in (caring or cfg.users):
            compared.append(run)
    compared.sort(key=lambda run: (*cfg.record.first, run.variant).index(run.variant))
    path = out_dir / "overview.rrd"
    atomic_write(path, lambda part: write_overview(part, compared))
    rows.append({"run": "overview", "sha256": digest(path)})
    write_table(out_dir / "recordings.csv", pd.DataFrame(rows))


if __name__ == "__main__":
    launch(main, "record")
