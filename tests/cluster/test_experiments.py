"""Every experiment that conf/experiment/ names runs; `make test-cluster`."""

from pathlib import Path

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser

from pipeline.artifacts.files import read_table
from pipeline.runtime.places import CONF
from tests.sweep.running import clone_of_working_tree, jobs, sweep

EXPERIMENTS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))
STAGES = {"paper": "evaluate,repair,intervene", "label_noise": "shift"}
SMALL = ["profile=smoke", "~variants.ae", "~variants.irl_maxent", "~variants.irl_ranked", "hydra.launcher.n_jobs=2"]


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clone_of_working_tree(tmp_path_factory.mktemp("experiments") / "repository")


def first_and_last(experiment: str) -> list[str]:
    """Two values of the first swept parameter, one of every other."""
    swept = yaml.safe_load((CONF / "experiment" / f"{experiment}.yaml").read_text())["hydra"]["sweeper"]["params"]
    parser = OverridesParser.create()
    values = {key: [*parser.parse_override(f"{key}={text}").sweep_string_iterator()] for key, text in swept.items()}
    first = next(iter(values))
    return [f"{key}={','.join((x[0], x[-1])) if key == first else x[0]}" for key, x in values.items()]


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_runs_to_a_page_that_compares_its_settings(repository: Path, experiment: str):
    arguments = [*SMALL, f"+experiment={experiment}", *first_and_last(experiment)]
    stages = ["--stages", STAGES.get(experiment, "evaluate")]
    ended = sweep(repository, "--multirun", *arguments, *stages, "--folder", experiment)
    assert ended.returncode == 0 and "2 of 2 jobs done" in ended.stdout, ended.stderr[-3000:]
    assert len(jobs(repository / experiment)) == 2 and (repository / experiment / "index.html").is_file()
    assert len(read_table(repository / experiment / "differences.parquet"))
