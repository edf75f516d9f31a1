"""Run the stages up to a target in a job's clone by `dvc repro`, each in one job at a time.

python -m pipeline.sweep.stages evaluate --overrides train.steps=100 ...

DVC's run cache restores what another job has computed. Jobs that start together would both miss it. So a file lock in
the cache guards each stage with its parameters. The second job takes another stage meanwhile, and then restores.
"""

import hashlib
import os
import signal
import sys
import time
from collections.abc import Iterable
from graphlib import TopologicalSorter
from pathlib import Path
from threading import Thread

from dvc.cli import main as dvc
from dvc.repo import Repo
from filelock import FileLock, Timeout

from pipeline.params import main as compose
from pipeline.runtime.errors import reported

POLL_S = 0.2  # between two looks at stages that other jobs are running


def run_stages(targets: list[str]) -> int:
    """Run or restore every stage that `targets` need; return DVC's exit status, that of the first stage that fails."""
    needs, locks = _graph(targets)
    order, ready = TopologicalSorter(needs), list[str]()
    order.prepare()
    while order.is_active():
        ready += order.get_ready()
        for stage in ready:
            command = ["pull", "--remote", "store"] if stage.endswith(".dvc") else ["repro", "--single-item"]
            try:
                with FileLock(locks[stage], timeout=0):
                    if status := dvc([*command, stage]):
                        return status
            except Timeout:
                continue
            ready.remove(stage)
            order.done(stage)
            break
        else:
            time.sleep(POLL_S)
    return 0


def _graph(targets: Iterable[str]) -> tuple[dict[str, set[str]], dict[str, Path]]:
    """Return what each stage needs, and its lock, the same in all jobs with the same parameters up to this stage.

    A stage without parameters has its own lock in each clone, as DVC caches no run of it. People who share a cache have
    locks of their own, as they may not write another's.
    """
    with Repo() as repo:
        folder, graph = Path(repo.cache.local.path).parents[1] / f"sweep-locks-{os.getuid()}", repo.index.graph
        folder.mkdir(parents=True, exist_ok=True)
        own = {path.parent.name: f"{path}:{path.parent.name}" for path in Path("studies").glob("*/dvc.yaml")}
        wanted = [stage for target in targets for stage in repo.stage.collect(own.get(target, target))]
        for stage in wanted:  # in DVC's graph a stage points to what it needs
            wanted += [needed for needed in graph.successors(stage) if needed not in wanted]
        needs = {stage.addressing: {needed.addressing for needed in graph.successors(stage)} for stage in wanted}
        read = {stage.addressing: str([dep.read_params() for dep in stage.params]) for stage in wanted}
    locks, upstream = {}, {}
    for stage in TopologicalSorter(needs).static_order():
        upstream[stage] = {(stage, read[stage])}.union(*(upstream[needed] for needed in needs[stage]))
        place = Path.cwd() if read[stage] == "[]" and not stage.endswith(".dvc") else ""
        locks[stage] = folder / hashlib.sha256(f"{sorted(upstream[stage])} {place}".encode()).hexdigest()
    return needs, locks


def end_with_parent() -> None:
    """End this process and the stage that it runs when its parent ends, even if that was killed."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(0.5)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    Thread(target=end_with_parent, daemon=True).start()
    split = sys.argv.index("--overrides")
    with reported():
        compose(sys.argv[split + 1 :])
    sys.exit(run_stages(sys.argv[1:split]))
