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
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from pipeline.artifacts.files import read_json, write_json
from pipeline.audit.setting import setting, values
from pipeline.git import dvc, forget_repository, git
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.sweep.clone import code_digest, snapshot
from pipeline.sweep.job import Sweep, reason
from pipeline.sweep.launch import launch
from pipeline.sweep.page.write import write_summary
from pipeline.sweep.plan import Plan, make_plan
from pipeline.sweep.summary import read_jobs


def main(argv: list[str]) -> int:
    """Run or summarise a sweep; return 0, 1 if a job failed, 2 for a mistake in use, 130 after Ctrl-C."""
    try:
        if argv[:1] == ["summary"]:
            if len(argv) != 2:
                raise InputError(f"summary got {len(argv) - 1} folders: expected one, such as multirun/sweep/DATE_TIME")
            return _summarise(Path(argv[1]).resolve())
        return _sweep(_arguments(argv))
    except (InputError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted before any job started", file=sys.stderr)
        return 130


def is_stage(name: str) -> bool:
    """Return whether there is a stage or a study of that name."""
    return any((ROOT / path).is_file() for path in (f"pipeline/stages/{name}.py", f"studies/{name}/stage.py"))


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
    if not given.resume and (folder / "sweep.json").is_file():
        raise InputError(f"{folder} holds a sweep already: --resume it, or name another --folder")
    before = _read_record(folder) if given.resume else {}
    targets = given.stages.split(",") if given.stages else before.get("targets", ["evaluate"])
    objective = given.objective or before.get("objective")
    if unknown := [target for target in targets if not is_stage(target)]:
        raise InputError(f"stage {unknown[0]!r} is unknown: expected stages of dvc.yaml or folders of studies/")
    if "selection" in targets:
        raise InputError("stage 'selection' keeps recordings in git, which no sweep does: expected record, or another")
    commit = snapshot(ROOT)
    runs = [given.overrides]
    plans = [make_plan(_launched(run), targets) for run in runs]
    if before and plans[0].jobs is not None and not any(setting(job, before["fixed"]) for job in plans[0].jobs):
        # nothing but what all jobs share, or how to run them: the folder's own jobs
        launcher = [text for text in given.overrides if text.startswith("hydra")]
        runs = before["runs"]
        plans = [make_plan(_launched(run, launcher), targets) for run in runs]
    if any(plan.jobs is None for plan in plans) and objective is None:
        raise InputError("a sweeper that chooses needs --objective, e.g. --objective accuracy.full.new_items")
    if any(plan.jobs is None and "protocol=validation" not in plan.fixed for plan in plans):
        raise InputError("choices are made on validation data: add protocol=validation")
    record = {"commit": commit, "code": code_digest(ROOT, commit), "targets": targets, "objective": objective}
    record |= {"fixed": before.get("fixed", plans[0].fixed), "defaults": before.get("defaults", {})}
    record["runs"] = [*before.get("runs", []), *(run for run in runs if run not in before.get("runs", []))]
    for plan in plans:
        record["defaults"] |= plan.defaults
    if before:
        _check_fits(folder, before, record, plans)
    every = [job for plan in plans for job in plan.jobs or []]
    planned = {setting(job): job for job in [*before.get("jobs", []), *every]}
    cache = Path(dvc(ROOT, "cache", "dir").strip())
    sweep = Sweep(ROOT, folder, cache, commit, tuple(targets), tuple(record["fixed"]), objective, os.getpid())
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / ".lock", timeout=0):
            write_json(folder / "sweep.json", record | {"jobs": [*planned.values()]})
            if commit != (head := git(ROOT, "rev-parse", "HEAD").strip()):
                (folder / "uncommitted.diff").write_text(git(ROOT, "diff", head, commit))
                print(f"these jobs run uncommitted changes, kept in {folder}/uncommitted.diff", flush=True)
            shutil.rmtree(folder / "clones", ignore_errors=True)  # a killed sweep's
            for plan in plans:
                count = "jobs that the sweeper chooses" if plan.jobs is None else f"{len(plan.jobs)} jobs"
                print(f"{count}, up to {', '.join(targets)}, into {folder}", flush=True)
                launch(sweep, plan)
            shutil.rmtree(folder / "clones", ignore_errors=True)
            return _summarise(folder)
    except Timeout:
        raise InputError(f"another sweep is writing into {folder}: wait for it, or name another --folder") from None
    except OSError as error:
        raise InputError(reason(error, folder)) from error
    except KeyboardInterrupt:
        print(f"interrupted; `python -m pipeline.sweep --resume {folder}` runs the others", file=sys.stderr)
        return 130


def _read_record(folder: Path) -> dict:
    if not (folder / "sweep.json").is_file():
        raise InputError(f"{folder} holds no sweep: expected a folder with a sweep.json")
    record = read_json(folder / "sweep.json")
    if "runs" not in record:
        raise InputError(f"{folder} is a sweep of other code: check out commit {record['commit'][:10]} to go on")
    return record


def _launched(run: list[str], launcher: Sequence[str] = ()) -> list[str]:
    """Return a run's overrides with another launcher or sweeper, if `launcher` names one; joblib by default."""
    names = {text.partition("=")[0] for text in launcher}
    dropped = ("hydra.launcher.",) if "hydra/launcher" in names else ()
    kept = [text for text in run if text.partition("=")[0] not in names and not text.startswith(dropped)]
    every = [*launcher, *kept]
    return every if any(text.startswith("hydra/launcher=") for text in every) else ["hydra/launcher=joblib", *every]


def _check_fits(folder: Path, before: dict, record: dict, plans: list[Plan]) -> None:
    """Raise InputError unless jobs of `record` may stand beside those of the sweep that the folder holds."""
    if before["code"] != record["code"]:
        raise InputError(
            f"{folder} is a sweep of commit {before['commit'][:10]}, and the code has changed since: check that commit "
            "out to add to it, or start a sweep in another folder"
        )
    if before["targets"] != record["targets"]:
        raise InputError(f"{folder} is a sweep up to {', '.join(before['targets'])}: name another folder")
    given = [{*values(plan.fixed), *(key.lstrip("+") for key in plan.defaults)} for plan in plans]
    if missing := [text for text in before["fixed"] if not all({*values([text])} <= names for names in given)]:
        raise InputError(f"{folder} is a sweep with {' '.join(missing)}: give that, too, or name another folder")


def _summarise(folder: Path) -> int:
    """Write the summary, print where it is and which jobs failed or are missing; return the exit status."""
    record = _read_record(folder)
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
    forget_repository()
    sys.exit(main(sys.argv[1:]))
