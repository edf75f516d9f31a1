"""Stage record: write a Rerun recording per variant, user and seed, an overview, and digests; keep some for git."""

import shutil
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.files import write_table
from pipeline.artifacts.models import compared
from pipeline.launch import launch
from pipeline.models.trained import check_weights
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Group, Several, need
from pipeline.runtime.writing import atomic_write
from pipeline.viewer.contents import Run, assemble, read_sources
from pipeline.viewer.digest import digest
from pipeline.viewer.run import write_overview, write_run


class Settings(Group):
    scenes: Count
    worst: Count
    repairs: Count
    training_scenes: Count
    map_side: Several


def agree(record: Settings, parameters: Any) -> None:
    """Reject different splits, since a recording shows repairs and interventions together."""
    same = f"repair.split = {parameters.repair.split!r}, since a recording shows both"
    need(parameters.intervene.split == parameters.repair.split, "intervene.split", parameters.intervene.split, same)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write {variant}-{user}-s{seed}.rrd of every model at main_n_demos, and overview.rrd, into `paths.runs`.

    A user without margins has no runs if another has some: all their paths are valid. The overview shows the first
    seed's models. `out_dir` gets recordings.csv, each recording's digest and facts, and what git keeps: the overview,
    and the run with the lowest accuracy of each variant that is `compared`. Their bytes differ from run to run, so a
    file of the same contents stays.
    """
    folder = Path(cfg.paths.runs) if out_dir == Path(cfg.paths.record) else out_dir / "runs"
    check_weights(cfg)
    caring = [user for user, margins in cfg.users.items() if any(margin is not None for margin in margins.values())]
    jobs = list(product(cfg.variants, caring or cfg.users))
    runs = [*chain(*map_jobs(partial(_assembled, cfg), jobs, cfg.workers, "contents of recordings"))]
    rows = []
    shutil.rmtree(folder, ignore_errors=True)  # remove recordings of earlier models
    for run in tqdm(runs, desc="recordings"):  # in one process: Rerun has hung next to torch workers
        path = folder / f"{run.name}.rrd"
        atomic_write(path, lambda part, run=run: write_run(part, run))
        who = {"run": run.name, "variant": run.variant, "user": run.user, "seed": run.seed}
        rows.append(who | {"sha256": digest(path)} | run.facts)
    shown = [run for run in runs if run.seed == cfg.protocol.seeds[0]]
    shown.sort(key=lambda run: not cfg.variants[run.variant].compared)
    path = folder / "overview.rrd"
    atomic_write(path, lambda part: write_overview(part, shown))
    table = pd.DataFrame([*rows, {"run": "overview", "sha256": digest(path)}])
    keep(table, compared(cfg), folder, out_dir)
    write_table(out_dir / "recordings.csv", table)
    write_table(folder / "recordings.csv", table)  # last: says that all are here, and of which results


def keep(table: pd.DataFrame, variants: list[str], folder: Path, out_dir: Path) -> None:
    """Copy the overview and the variants' worst runs, but where a file of the same contents is there."""
    digests, accuracies = table.set_index("run")["sha256"], table.set_index("run").groupby("variant")["accuracy"]
    names = ["overview", *accuracies.idxmin()[variants]]
    for path in out_dir.glob("*.rrd"):
        if path.stem not in names:
            path.unlink()
    for name in names:
        kept, new = out_dir / f"{name}.rrd", folder / f"{name}.rrd"
        if not kept.is_file() or digest(kept) != digests[name]:
            atomic_write(kept, lambda part, new=new: shutil.copyfile(new, part))


def _assembled(cfg: DictConfig, job: tuple[str, str]) -> list[Run]:
    """Return the contents of the recordings of one variant and user, by seed."""
    sources = read_sources(cfg)
    return [assemble(cfg, sources, *job, seed) for seed in cfg.protocol.seeds]


if __name__ == "__main__":
    launch(main, "record")
