"""Sweep any parameter of the graph by Hydra's multirun, and summarise what it did.

python -m pipeline.sweep --multirun variants.full.beta=0,.002,.02 train.model.latent=2,15
python -m pipeline.sweep --multirun +experiment=beta       a sweep that conf/experiment/ names
python -m pipeline.sweep --resume FOLDER                   what is missing or failed; more values may follow
python -m pipeline.sweep summary FOLDER                    the page of a sweep again
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

from filelock import FileLock, Timeout
from tqdm import tqdm

from pipeline.artifacts.files import read_json, write_json
from pipeline.audit.revision import dvc, git
from pipeline.config.graph import ROOT, stage_entry
from pipeline.params import CONF, explained
from pipeline.runtime.errors import InputError
from pipeline.sweep.clone import code_digest, snapshot
from pipeline.sweep.job import Sweep, is_done, run_job
from pipeline.sweep.plan import Plan, make_plan
from pipeline.sweep.summary import read_jobs, write_summary

WATCH_S = 0.5  # between two looks at the jobs' files
# What Hydra writes itself stays out of the jobs' folders
QUIET = [
    "hydra.sweep.subdir=.",
    "hydra.output_subdir=null",
    "hydra/job_logging=disabled",
    "hydra/hydra_logging=disabled",
]


def main(argv: list[str]) -> int:
    """Run or summarise a sweep; return 0, 1 if a job failed, 2 for a mistake in use, 130 after Ctrl-C."""
    try:
        if argv[:1] == ["summary"]:
            if len(argv) != 2:
                raise InputError(f"summary of {len(argv) - 1} folders: expected one")
            return _summarise(Path(argv[1]).resolve())
        return _sweep(_arguments(argv))
    except (InputError, OSError, subprocess.CalledProcessError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted before any job started", file=sys.stderr)
        return 130


def _arguments(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m pipeline.sweep", description=__doc__, allow_abbrev=False)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--multirun", "-m", action="store_true", help="start a sweep")
    parser.add_argument("--folder", type=Path, help="of the sweep; by default multirun/sweep/DATE_TIME")
    parser.add_argument("--resume", type=Path, metavar="FOLDER", help="run what a sweep lacks")
    parser.add_argument("--stages", metavar="A,B", help="run the graph up to these stages or studies (evaluate)")
    parser.add_argument(
        "--objective", metavar="HEADLINE", help="what hydra/sweeper=optuna sees, e.g. accuracy.full.new_items"
    )
    given, overrides = parser.parse_known_args(argv)
    if wrong := [text for text in overrides if not re.match(r"[~+]|(?!-).*=", text)]:
        raise InputError(f"{wrong[0]!r}: expected an override such as train.steps=100,200, or an option of --help")
    if not given.multirun and given.resume is None:
        raise InputError("nothing to do: start with --multirun and overrides, or --resume FOLDER; --help says more")
    given.overrides = overrides
    return given


def _sweep(given: argparse.Namespace) -> int:
    folder = (given.resume or given.folder or Path("multirun/sweep") / time.strftime("%Y-%m-%d_%H-%M-%S")).resolve()
    before = read_json(folder / "sweep.json") if (folder / "sweep.json").is_file() else None
    if given.resume and before is None:
        raise InputError(f"{folder} holds no sweep: --resume wants a folder with a sweep.json")
    if before and not given.resume:
        raise InputError(
            f"{folder} holds a sweep already: --resume {given.folder} adds to it, or name another --folder"
        )
    commit = snapshot(ROOT)
    code = code_digest(ROOT, commit)
    if before and before["code"] != code:
        raise InputError(
            f"{folder} is a sweep of commit {before['commit'][:10]}, and the code has changed since: check that commit "
            "out to add to it, or start a sweep in another folder"
        )
    targets = (given.stages or ",".join((before or {}).get("targets", ["evaluate"]))).split(",")
    for target in targets:
        if stage_entry(target) is None:
            raise InputError(f"stage {target!r} is unknown: `dvc stage list --all` lists them")
    overrides = given.overrides or (before or {}).get("overrides", [])
    objective = given.objective or (before or {}).get("objective")
    if not any(text.startswith("hydra/launcher=") for text in overrides):
        overrides = ["hydra/launcher=joblib", *overrides]
    plan = make_plan(overrides, targets)
    _check_objective(plan, objective)
    fixed = (before or {}).get("fixed", plan.fixed)
    if missing := [text for text in fixed if text not in plan.fixed]:
        raise InputError(f"{folder} is a sweep with {' '.join(missing)}: give that, too, or name another folder")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0):
            cache = Path(dvc(ROOT, "cache", "dir").strip())
            sweep = Sweep(ROOT, folder, cache, commit, tuple(targets), tuple(fixed), objective)
            earlier = before or {"jobs": [], "defaults": {}}
            planned = {tuple(job): None for job in [*earlier["jobs"], *(plan.jobs or [])]}
            record = {
                "commit": commit,
                "code": code,
                "targets": targets,
                "overrides": overrides,
                "objective": objective,
            }
            record |= {"fixed": fixed, "defaults": earlier["defaults"] | plan.defaults, "jobs": [*map(list, planned)]}
            write_json(folder / "sweep.json", record)
            head = git(ROOT, "rev-parse", "HEAD").strip()
            if commit != head:
                (folder / "uncommitted.diff").write_text(git(ROOT, "diff", head, commit))
                print(f"runs uncommitted changes, kept in {folder}/uncommitted.diff", flush=True)
            print(
                f"{len(plan.jobs) if plan.jobs else 'chosen'} jobs up to {', '.join(targets)} into {folder}", flush=True
            )
            try:
                _launch(sweep, plan)
            except KeyboardInterrupt:
                print(f"interrupted; `python -m pipeline.sweep --resume {folder}` runs the others", file=sys.stderr)
                return 130
            shutil.rmtree(folder / "clones", ignore_errors=True)
            return _summarise(folder)
    except Timeout:
        raise InputError(f"another sweep is writing into {folder}: wait for it, or name another --folder") from None


def _check_objective(plan: Plan, objective: str | None) -> None:
    """Raise InputError unless a sweeper that chooses has an objective, on validation data."""
    if plan.jobs is not None:
        return
    if objective is None:
        raise InputError("a sweeper that chooses needs --objective, e.g. --objective accuracy.full.new_items")
    if "protocol=validation" not in plan.fixed:
        raise InputError("choices are made on validation data: add protocol=validation")


def _launch(sweep: Sweep, plan: Plan) -> None:
    """Run the jobs by Hydra's sweeper and launcher, with a progress bar."""
    import hydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.errors import HydraException

    def task(cfg) -> float:
        overrides = HydraConfig.get().overrides.task
        return run_job(sweep, [text for text in overrides if not text.startswith("hydra")])

    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors are reported here
    # jobs import the same code wherever they start
    os.environ["PYTHONPATH"] = os.pathsep.join([str(sweep.root), *filter(None, [os.environ.get("PYTHONPATH")])])
    chosen = ["hydra.sweeper.max_failure_rate=1"] if plan.jobs is None else []  # a failed job takes no other along
    sweep_dir = f"hydra.sweep.dir={sweep.folder}"
    sys.argv[1:] = ["--multirun", "hydra.job.name=sweep", sweep_dir, *QUIET, *chosen, *plan.overrides]
    try:
        with _progress(sweep, plan):
            hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(task)()
    except HydraException as error:
        raise InputError(explained(error)) from error


@contextmanager
def _progress(sweep: Sweep, plan: Plan) -> Iterator[None]:
    """Show how many jobs are done, and the remaining time, as their files tell."""
    planned = None if plan.jobs is None else [sweep.job_folder(job) for job in plan.jobs]
    started = time.time()
    done = 0 if planned is None else sum(map(is_done, planned))
    ended = Event()

    def count() -> tuple[int, int]:
        records = [
            read_json(path) for path in (sweep.folder / "jobs").glob("*/job.json") if path.stat().st_mtime > started
        ]
        states = [record["state"] for record in records]
        return sum(state in ("done", "failed") for state in states), states.count("failed")

    def watch() -> None:
        with tqdm(total=None if planned is None else len(planned) - done, desc="jobs", unit="job") as bar:
            while True:
                last = ended.wait(WATCH_S)
                number, failed = count()
                if number > bar.n:
                    bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
                    bar.update(number - bar.n)
                if last:
                    return

    thread = Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _summarise(folder: Path) -> int:
    """Write the summary, print where it is and which jobs failed or are missing; return the exit status."""
    record = read_json(folder / "sweep.json") if (folder / "sweep.json").is_file() else None
    if record is None:
        raise InputError(f"{folder} holds no sweep: expected a folder with a sweep.json")
    jobs = read_jobs(folder, record)
    broken = [job for job in jobs if job["state"] != "done"]
    for job in broken:
        print(f"{job['state']}: {job['name']}: {job.get('error', '')}", file=sys.stderr)
    if len(broken) == len(jobs):
        print(f"error: no job of {folder} is done", file=sys.stderr)
        return 1
    page = write_summary(folder, record, jobs)
    print(f"{len(jobs) - len(broken)} of {len(jobs)} jobs done; summary: {page}")
    if broken:
        print(f"`python -m pipeline.sweep --resume {folder}` runs the others", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
