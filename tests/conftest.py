"""Checks every annotated shape and type of the package while the tests run.

Hypothesis tries the same examples in every run; `--hypothesis-profile=default` draws new ones.
"""

import sys
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook
from omegaconf import DictConfig

from pipeline.git import forget_repository

sys.dont_write_bytecode = False  # the hook would compile what it loads, and torch and scipy with it, in every run
install_import_hook("pipeline", "beartype.beartype")
forget_repository()  # that of a hook which runs the tests
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """As in every stage's process; two threads that wait for each other on a busy machine take minutes for seconds."""
    from pipeline.runtime.parallel import one_thread

    one_thread()


@pytest.fixture(scope="module")
def out(request: pytest.FixtureRequest, cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the module's stage writes by `cfg`; it fails if it reads a parameter that dvc.yaml does not list for it."""
    from tests.stages.facts import run_as_listed

    return run_as_listed(request.module.main, cfg, tmp_path_factory.mktemp("out"))
