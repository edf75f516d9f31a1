"""The command `specs` is a door: each verb says what its module says."""

import subprocess
import sys

import pytest

from pipeline.cli import MODULES


def specs(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "import sys; from pipeline.cli import main; sys.exit(main())", *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_help_names_every_verb_on_one_screen_and_version_is_the_packages():
    told = specs("--help").stdout
    assert all(f"specs {verb}" in told for verb in MODULES) and told.count("\n") < 24
    assert specs("--version").stdout.count(".") == 2
    assert "report" in specs("--completion", "bash").stdout


@pytest.mark.parametrize(
    "arguments", [("check", "nowhere"), ("report", "nowhere"), ("sweep", "--nothing"), ("nonsense",)]
)
def test_a_mistake_ends_in_a_sentence_and_not_in_0(arguments: tuple[str, ...]):
    done = specs(*arguments)
    assert done.returncode in (1, 2) and "error: " in done.stderr and "Traceback" not in done.stderr
