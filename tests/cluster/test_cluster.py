"""Launchers for clusters give the serial run's bytes, also when a node is lost; `make test-cluster`."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from tests.sweep.running import SMALL, clone_of_working_tree, command, environment, jobs, results, sweep

JOBS = 10
SERIAL = [5, 14]  # values that are run serially, too
RAY = str(Path(sys.executable).parent / "ray")


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clone_of_working_tree(tmp_path_factory.mktemp("cluster") / "repository")


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some of the jobs one after the other, in a repository whose cache nobody shares."""
    alone = clone_of_working_tree(tmp_path_factory.mktemp("serial") / "repository")
    ended = sweep(alone, *swept(SERIAL, "hydra/launcher=basic"), "--folder", "serial")
    assert ended.returncode == 0, ended.stderr[-3000:]
    return alone / "serial"


@pytest.fixture
def cluster(tmp_path: Path, repository: Path) -> Iterator[tuple[str, psutil.Process]]:
    """A Ray cluster of two nodes with one core each: its address, and the second node's process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    env = environment(repository) | {"RAY_AUTH_MODE": "disabled"}
    start = [RAY, "start", "--block", "--num-cpus=1", "--disable-usage-stats", "--object-store-memory=80000000"]
    head = [*start, "--head", f"--port={address.partition(':')[2]}", "--node-ip-address=127.0.0.1"]
    nodes = []
    for arguments in ([*head, "--include-dashboard=false"], [*start, f"--address={address}"]):
        log = (tmp_path / f"node-{len(nodes)}.txt").open("w")
        nodes.append(psutil.Popen(arguments, env=env, stdout=log, stderr=log, start_new_session=True))
        wait_for(lambda log=log: "Ray runtime started" in Path(log.name).read_text(), nodes[-1])
    yield address, nodes[1]
    for node in nodes:
        end(node)


def wait_for(condition, process: psutil.Process, seconds: float = 120) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert process.is_running() and time.monotonic() < until
        time.sleep(0.5)


def end(process: psutil.Process) -> None:
    """Kill a process and all that it started."""
    with_children = [*process.children(recursive=True), process] if process.is_running() else []
    for each in with_children:
        with suppress(psutil.NoSuchProcess):
            each.kill()


def swept(values: list[int], *launcher: str) -> list[str]:
    return ["--multirun", *SMALL, f"evaluate.bins={','.join(map(str, values))}", *launcher]


def test_a_ray_cluster_that_loses_a_node_does_every_job_with_the_serial_run_s_bytes(repository, serial, cluster):
    address, node = cluster
    launcher = ["hydra/launcher=ray_cluster", f"hydra.launcher.ray.init.address={address}"]
    arguments = command(*swept(list(range(5, 5 + JOBS)), *launcher), "--folder", "on_ray")
    env = environment(repository) | {"RAY_AUTH_MODE": "disabled"}
    log = (repository / "on_ray.txt").open("w")
    running = psutil.Popen(arguments, cwd=repository, env=env, stdout=log, stderr=log)
    folder = repository / "on_ray"
    states = lambda: [job["state"] for job in jobs(folder).values()]  # noqa: E731
    wait_for(lambda: states().count("done") >= 3 and states().count("running") == 2, running, 900)
    end(node)
    assert running.wait(timeout=3600) == 0, Path(log.name).read_text()[-3000:]
    done = jobs(folder)
    assert len(done) == JOBS and {job["state"] for job in done.values()} == {"done"}
    for job in (f"evaluate.bins={value}" for value in SERIAL):
        assert results(folder, job) == results(serial, job)


def test_slurm_s_job_file_asks_for_what_conf_says(repository: Path, tmp_path: Path):
    """A `sbatch` that only keeps its job file: no Slurm here."""
    fake = tmp_path / "sbatch"
    fake.write_text(f'#!/bin/sh\ncp "$1" {tmp_path}/job.sh\nexit 1\n')
    fake.chmod(0o755)
    (tmp_path / "srun").symlink_to(fake)
    env = environment(repository) | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    arguments = command(*swept([5, 6], "hydra/launcher=slurm"), "--folder", "on_slurm")
    subprocess.run(arguments, cwd=repository, env=env, capture_output=True)
    job = (tmp_path / "job.sh").read_text()
    assert "#SBATCH --array=0-1" in job and "#SBATCH --mem=4GB" in job and "#SBATCH --time=600" in job


def test_optuna_tries_settings_on_validation_data_alone(repository: Path):
    small = [text for text in SMALL if not text.startswith("clearance.steps=")]
    values = [*small, "protocol=validation", "validation_seeds=[100,101]", "clearance.steps=choice(1,40)"]
    optuna = ["hydra/sweeper=optuna", "hydra.sweeper.n_trials=2", "hydra.sweeper.n_jobs=2"]
    optuna += ["hydra.sweeper.direction=maximize", "--objective", "accuracy.clearance.new_items"]
    ended = sweep(repository, "--multirun", *values, *optuna, "--folder", "by_optuna")
    assert ended.returncode == 0, ended.stderr[-3000:]
    tried = {name: job["state"] for name, job in jobs(repository / "by_optuna").items()}
    assert tried and tried.items() <= {"clearance.steps=1": "done", "clearance.steps=40": "done"}.items()
    assert (repository / "by_optuna" / "index.html").is_file()
    refused = sweep(repository, "--multirun", *small, "clearance.steps=choice(1,40)", *optuna, "--folder", "x")
    assert refused.returncode == 2 and "protocol=validation" in refused.stderr
