"""Run the stages up to a target in the current folder: each once, whichever of several jobs comes first.

python -m pipeline.sweep.stages evaluate --overrides train.steps=100 ...

DVC's run cache restores what another job has computed. Jobs that start together would both miss it, so a file lock in
the cache guards each stage and content: who comes second waits, or takes another stage meanwhile, and then restores.
"""

import hashlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from threading import Thread

POLL_S = 0.2  # between two looks at stages that other jobs are running


def run_stages(targets: list[str]) -> dict[str, dict]:
    """Run or restore every stage that `targets` need; return what became of each: {"ran": bool, "seconds": float}."""
    from dvc.repo import Repo
    from dvc.repo.reproduce import plan_repro
    from filelock import FileLock, Timeout

    done: dict[str, dict] = {}
    with Repo() as repo:
        locks = Path(repo.cache.local.path).parents[1] / "sweep-locks"
        locks.mkdir(parents=True, exist_ok=True)
        graph = repo.index.graph
        plan = plan_repro(graph, [stage for target in targets for stage in repo.stage.collect(address(target))])
        sources = [stage for stage in plan if stage.is_data_source]
        with FileLock(locks / "data"):
            if sources:  # DVC takes no targets for all
                repo.pull(targets=[stage.addressing for stage in sources], remote="store")
        pending = [stage for stage in plan if not stage.is_data_source]
        while pending:
            for stage in pending:
                if set(graph.successors(stage)) & set(pending):  # in DVC's graph a stage points to what it needs
                    continue
                key = content_key(stage)
                try:
                    with FileLock(locks / key, timeout=0):
                        start = time.perf_counter()
                        cached = (Path(repo.stage_cache.cache_dir) / key[:2] / key).is_dir()  # a run with this key
                        with repo.lock:  # `repo.reproduce` would read every dvc.yaml again for each stage
                            stage.reproduce()
                            stage.dump(update_pipeline=False)
                except Timeout:
                    continue
                done[stage.addressing] = {"ran": not cached, "seconds": round(time.perf_counter() - start, 2)}
                print(f"{stage.addressing}: {'restored' if cached else 'ran'}", flush=True)
                pending.remove(stage)
                break
            else:
                time.sleep(POLL_S)
    return done


def address(target: str) -> str:
    """Return what DVC calls a stage: a study's is in a file of its own."""
    path = f"studies/{target}/dvc.yaml"
    return f"{path}:{target}" if Path(path).is_file() else target


def content_key(stage) -> str:
    """Return DVC's key of a stage in its run cache: command, parameters and the content of all that it reads.

    DVC caches no run of a stage whose outputs stay in place, as git keeps them: its key is this clone's own.
    The stage keeps what its lock says of these, or DVC would take it for unchanged whatever its parameters are now.
    """
    from dvc.stage.cache import _get_stage_hash

    if any(out.persist for out in stage.outs):
        return hashlib.sha256(f"{Path.cwd()}:{stage.addressing}".encode()).hexdigest()
    locked = [dict(vars(dep)) for dep in stage.deps]
    stage.save_deps()
    key = _get_stage_hash(stage)
    for dep, state in zip(stage.deps, locked, strict=True):
        vars(dep).clear()
        vars(dep).update(state)
    return key


def end_with_parent() -> None:
    """End this process and the stage that it runs when its parent ends, even if that was killed."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os.killpg(0, signal.SIGKILL)

    Thread(target=watch, daemon=True).start()


def main(arguments: list[str]) -> int:
    """Compose the parameters, run the stages and write stages.json; return the exit status."""
    from pipeline.params import main as compose
    from pipeline.runtime.errors import InputError

    end_with_parent()
    split = arguments.index("--overrides")
    try:
        compose(arguments[split + 1 :])
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}")
        return 2
    Path("stages.json").write_text(json.dumps(run_stages(arguments[:split])))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
