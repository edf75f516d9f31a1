"""The command `specs` is a door: each verb says what its module says."""

import subprocess
import sys

import pytest
import yaml

from pipeline import __version__
from pipeline.cli import MODULES
from pipeline.runtime.places import ROOT


def specs(*arguments: str, before: str = "") -> subprocess.CompletedProcess[str]:
    """Run as from the script that pip installs: nothing of the current folder can be imported."""
    command = [
        sys.executable,
        "-Pc",
        f"import sys; {before}from pipeline.cli import main; sys.exit(main())",
        *arguments,
    ]
    return subprocess.run(command, capture_output=True, text=True)


def test_help_names_every_verb_on_one_screen_and_version_is_the_packages():
    told = specs("--help").stdout
    assert all(f"specs {verb}" in told for verb in MODULES) and told.count("\n") < 24
    assert specs("--version").stdout.strip() == __version__


def test_the_version_is_the_citations_and_the_changelogs():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    heading = f"({__version__}, {citation['date-released']})"
    assert citation["version"] == __version__ and heading in (ROOT / "CHANGELOG.md").read_text()


def test_bash_completes_verbs():
    shell = f"{specs('--completion', 'bash').stdout}\ncomplete -p specs"
    assert all(verb in subprocess.check_output(["bash", "-ec", shell], text=True) for verb in MODULES)


@pytest.mark.parametrize(
    ("verb", "package", "extra"),
    [("report", "matplotlib", "own"), ("import", "pandas", "import"), ("sweep", "hydra", "pipeline")],
)
def test_a_verb_whose_packages_are_not_installed_names_its_extra(verb: str, package: str, extra: str):
    done = specs(verb, "nowhere", before=f"sys.modules[{package!r}] = None; ")
    assert done.returncode == 1 and done.stderr.startswith("error: ") and f" needs {package}" in done.stderr
    assert f"pip install 'causal-specifications[{extra}]'" in done.stderr and "Traceback" not in done.stderr


def test_an_installed_package_says_that_a_verb_works_in_a_clone():
    before = "import pathlib, pipeline.runtime.places as places; places.ROOT = pathlib.Path('nowhere'); "
    assert "works in a clone of the repository" in specs("sweep", before=before).stderr


@pytest.mark.slow
def test_a_sweep_of_the_installed_command_checks_parameters_of_studies_too():
    assert "studies.shift.scenes" in specs("sweep", "--multirun", "studies.shift.scenes=0").stderr


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("check", "nowhere"), ("report", "nowhere"), ("sweep", "--none"), ("nonsense",)])
def test_a_mistake_ends_in_a_sentence_and_not_in_0(arguments: tuple[str, ...]):
    done = specs(*arguments)
    assert done.returncode in (1, 2) and "error: " in done.stderr and "Traceback" not in done.stderr
