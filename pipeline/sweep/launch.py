"""Hand the jobs of a sweep to Hydra's sweeper and launcher, and show how far they are."""

import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from tqdm import tqdm

from pipeline.artifacts.files import read_json
from pipeline.launch import explained
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF
from pipeline.sweep.job import Sweep, is_done, reason, run_job
from pipeline.sweep.plan import Plan

WATCH_S = 0.5  # between two looks at the jobs' files
# Hydra writes no files and no lines of its own: jobs do
QUIET = ["hydra.sweep.subdir=.", "hydra.output_subdir=null"]
QUIET += [f"hydra/{kind}_logging=disabled" for kind in ("job", "hydra")]


def launch(sweep: Sweep, plan: Plan) -> None:
    """Run the jobs of a plan; raise InputError if Hydra refuses the command line, or its launcher fails."""

    def task(_) -> float:
        value = run_job(sweep, [text for text in HydraConfig.get().overrides.task if not text.startswith("hydra")])
        if plan.jobs is None and math.isnan(value):
            raise InputError("the job failed")  # a sweeper that is told NaN ends
        return value

    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors are reported by us
    paths = [str(sweep.root), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)  # processes that launchers start import the same code
    chosen = ["hydra.sweeper.max_failure_rate=1"] if plan.jobs is None else []  # a failed job takes no other along
    ray = ["hydra.launcher.ray.init.address=local"] if "hydra/launcher=ray" in plan.overrides else []  # one of its own
    quoted = str(sweep.folder).replace("'", "\\'")
    folder = ["hydra.job.name=sweep", f"hydra.sweep.dir='{quoted}'"]
    sys.argv[1:] = ["--multirun", *folder, *QUIET, *chosen, *ray, *plan.overrides]
    try:
        with _progress(sweep, plan):
            hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(task)()
    except HydraException as error:
        raise InputError(explained(error)) from error
    except Exception as error:  # such as a Ray that does not start; jobs' own failures are in their job.json
        if plan.jobs is None and "No trials are completed" in str(error):
            return  # all jobs failed, and the summary says why
        why = f"{type(error).__name__}: {reason(error, sweep.folder)}"
        raise InputError(f"the launcher failed ({why}): `--resume {sweep.folder}` runs what is missing") from error


@contextmanager
def _progress(sweep: Sweep, plan: Plan) -> Iterator[None]:
    """Show how many jobs are done or failed, as their files tell, and the remaining time."""
    started, ended = time.time(), Event()
    total = None if plan.jobs is None else sum(not is_done(sweep.job_folder(job)) for job in plan.jobs)

    def watch() -> None:
        with tqdm(total=total, desc="jobs", unit="job") as bar:
            last = False
            while not last:
                last = ended.wait(WATCH_S)
                new = [path for path in sweep.folder.glob("jobs/*/job.json") if path.stat().st_mtime > started]
                number = sum(read_json(path)["state"] in ("done", "failed") for path in new)
                if number > bar.n:
                    bar.update(number - bar.n)

    thread = Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
