"""Sweep any parameter of the graph by Hydra's multirun, and summarise what it did.

python -m pipeline.sweep --multirun variants.full.beta=0,.002,.02 train.model.latent=2,15
python -m pipeline.sweep --multirun +experiment=beta       a sweep that conf/experiment/ names
python -m pipeline.sweep --resume FOLDER                   what is missing or failed; other values may follow
python -m pipeline.sweep summary FOLDER                    the page of a sweep again
"""

import argparse
import os
import re
import shlex
import shutil
import socket
import sys
import time
from pathlib import Path
from typing import Any

import yaml
from filelock import FileLock, Timeout

from pipeline.artifacts.files import read_json, write_json
from pipeline.git import dvc, forget_repository, git
from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import ROOT
from pipeline.sweep.job import Sweep, snapshot
from pipeline.sweep.plan import launch, make_plan
from pipeline.sweep.summary import read_jobs, write_summary


def main(argv: list[str]) -> int:
    """Run or summarise a sweep; return 0, or 1 if a job failed. Raise InputError for a mistake in use."""
    sys.path.insert(0, str(ROOT))  # for studies/, which no installation has, from any folder
    if argv[:1] == ["summary"] and argv[1:]:
        return _summarise(Path(argv[1]).resolve())
    parser = argparse.ArgumentParser(prog="python -m pipeline.sweep", description=__doc__, allow_abbrev=False)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--multirun", "-m", action="store_true", help="start a sweep")
    parser.add_argument("--folder", type=Path, help="of the sweep; by default multirun/sweep/DATE_TIME")
    parser.add_argument("--resume", type=Path, metavar="FOLDER", help="run what a sweep lacks")
    parser.add_argument("--stages", metavar="A,B", help="run the graph up to these stages or studies (evaluate)")
    parser.add_argument("--objective", metavar="HEADLINE", help="that Optuna sees, e.g. accuracy.full.new_items")
    given, overrides = parser.parse_known_args(argv)
    if wrong := [text for text in overrides if not re.match(r"[~+]|(?!-).*=", text)]:
        raise InputError(f"{wrong[0]!r}: expected an override such as train.steps=100,200, or an option of --help")
    if given.multirun == bool(given.resume) or (given.resume and (given.folder or given.stages or given.objective)):
        raise InputError("expected --multirun, options and overrides, or --resume FOLDER and overrides; see --help")
    if given.resume:
        folder, record = given.resume.resolve(), _record(given.resume)
        relaunched = any(text.startswith("hydra/launcher=") for text in overrides)
        left_out = (*overrides, *(("hydra/launcher=", "hydra.launcher.") if relaunched else ()))
        runs = [[*(text for text in run if not text.startswith(left_out)), *overrides] for run in record["runs"]]
    else:
        folder = (given.folder or Path(time.strftime("multirun/sweep/%Y-%m-%d_%H-%M-%S"))).resolve()
        if (folder / "sweep.json").is_file():
            raise InputError(f"{folder} holds a sweep already: --resume it, or name another --folder")
        runs = [overrides]
        record = {"commit": snapshot(ROOT), "targets": (given.stages or "evaluate").split(",")}
        record |= {"objective": given.objective, "defaults": {}, "runs": [], "jobs": []}
    known = {*yaml.safe_load((ROOT / "dvc.yaml").read_bytes())["stages"], *(p.name for p in ROOT.glob("studies/*"))}
    if unknown := [target for target in record["targets"] if target not in known]:
        raise InputError(f"stage {unknown[0]!r} is unknown: expected stages of dvc.yaml or folders of studies/")
    plans = [make_plan(run, record["targets"]) for run in runs]
    record.setdefault("fixed", plans[0].fixed)
    for run, plan in zip(runs, plans, strict=True):
        if plan.jobs is None and (record["objective"] is None or "protocol=validation" not in plan.fixed):
            raise InputError("Optuna chooses on validation data: add protocol=validation and an --objective")
        record["defaults"] = plan.defaults | record["defaults"]  # those of the sweep's own commit count
        record["jobs"] += [job for job in plan.jobs or [] if job not in record["jobs"]]
        record["runs"] += [] if run in record["runs"] else [run]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0):
            write_json(folder / "sweep.json", record)
            if record["commit"] != (head := git(ROOT, "rev-parse", "HEAD").strip()) and not given.resume:
                changes = git(ROOT, "diff-tree", "-p", "--binary", head, record["commit"])
                (folder / "uncommitted.diff").write_text(changes, encoding="utf-8")
                print(f"these jobs run uncommitted changes, kept in {folder}/uncommitted.diff", flush=True)
            _drop_clones(folder / "clones")
            sweep = Sweep(ROOT, folder, Path(dvc(ROOT, "cache", "dir").strip()), record, os.getpid())
            for plan in plans:
                count = "as the sweeper chooses" if plan.jobs is None else len(plan.jobs)
                print(f"jobs: {count}; up to {', '.join(record['targets'])}; into {folder}", flush=True)
                launch(sweep, plan)
            shutil.rmtree(folder / "clones", ignore_errors=True)
            return _summarise(folder)
    except Timeout as error:
        raise InputError(f"another sweep is writing into {folder}: wait for it, or name another --folder") from error


def _drop_clones(folder: Path) -> None:
    """Delete the clones of processes of this machine that ended: on a cluster, jobs outlive a killed sweep."""
    for clone in folder.glob("*"):
        host, _, process = clone.name.rpartition("-")
        try:
            if host == socket.gethostname():
                os.kill(int(process), 0)
        except (ProcessLookupError, PermissionError):  # it is another user's by now
            shutil.rmtree(clone, ignore_errors=True)


def _record(folder: Path) -> dict[str, Any]:
    """Return what a sweep wrote of itself; raise InputError if the folder holds none."""
    if not (folder / "sweep.json").is_file():
        raise InputError(f"{folder} holds no sweep: name the folder that its first line said")
    return read_json(folder / "sweep.json")


def _summarise(folder: Path) -> int:
    """Write the summary, print where it is and which jobs failed or are missing; return the exit status."""
    record = _record(folder)
    jobs = read_jobs(Sweep(ROOT, folder, ROOT, record))
    broken = [job for job in jobs if job["state"] != "done"]
    for job in broken:
        print(f"{job['state']}: {job['name']}: {job.get('error', '')} ({job['path']}/log.txt)", file=sys.stderr)
    if len(broken) == len(jobs):
        print(f"error: no job of {folder} is done", file=sys.stderr)
        return 1
    write_summary(folder, record, jobs)
    print(f"{len(jobs) - len(broken)} of {len(jobs)} jobs done; summary: {folder}/index.html")
    if broken:
        print(f"`python -m pipeline.sweep --resume {shlex.quote(str(folder))}` runs the others", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    forget_repository()
    try:
        with reported(OSError, yaml.YAMLError):
            sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted: `--resume FOLDER` runs the others; on Slurm, `scancel` these jobs first", file=sys.stderr)
        sys.exit(130)
