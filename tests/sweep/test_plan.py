"""What a sweep's command line asks for, and which mistakes are refused before any work is done."""

import importlib.util
from pathlib import Path

import pytest
from dvc.repo import Repo
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser

from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF, ROOT
from pipeline.sweep.job import Sweep
from pipeline.sweep.plan import make_plan
from pipeline.sweep.stages import address

EXPERIMENTS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))


def test_every_combination_is_a_job_and_defaults_are_known():
    plan = make_plan(["profile=smoke", "variants.full.beta=0,0.002", "train.model.latent=2,15"], ["evaluate"])
    assert plan.fixed == ["profile=smoke"]
    assert plan.jobs is not None and len(plan.jobs) == 4
    assert ["profile=smoke", "variants.full.beta=0.002", "train.model.latent=15"] in plan.jobs
    assert plan.defaults == {"variants.full.beta": 0.002, "train.model.latent": 15}


def test_seeds_are_fitted_together_in_each_job(capsys: pytest.CaptureFixture):
    plan = make_plan(["variants.full.beta=0,0.002", "seed=range(0,3)"], ["evaluate"])
    assert plan.fixed == ["seeds=[0,1,2]"] and plan.jobs is not None and len(plan.jobs) == 2
    assert "every job fits all of them" in capsys.readouterr().out


@pytest.mark.parametrize(("swept", "kept"), [("1,100,100.0,1e2", ["1", "100"]), ("0,0.0,-0.0", ["0"])])
def test_equal_values_are_one_job_for_hydra_too(swept: str, kept: list[str], capsys: pytest.CaptureFixture):
    plan = make_plan([f"variants.full.alpha={swept}"], ["evaluate"])
    assert plan.jobs == [[f"variants.full.alpha={value}"] for value in kept]
    batches = BasicSweeper.split_arguments(OverridesParser.create().parse_overrides(plan.overrides), None)
    assert batches == [plan.jobs] and "equal values are one setting" in capsys.readouterr().out


def test_a_job_has_one_folder_whatever_its_overrides_are_spelled_like():
    sweep = Sweep(ROOT, Path("swept"), Path("cache"), "0" * 40, ("evaluate",), ("clearance.rate=1.0",))
    folder = sweep.job_folder(["clearance.rate=1", "variants.full.alpha=1e2", "evaluate.bins=5"])
    assert folder == sweep.job_folder(["evaluate.bins=5", "variants.full.alpha=100", "clearance.rate=1.0"])
    assert folder == Path("swept/jobs/evaluate.bins=5,variants.full.alpha=100")


def test_a_parameter_whose_default_would_not_fit_the_others_can_be_swept():
    plan = make_plan(["n_demos=[1,3]", "main_n_demos=1,3", "+experiment=paper"], ["evaluate"])
    assert plan.jobs is not None and len(plan.jobs) == 2 and plan.defaults == {"main_n_demos": 9}


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("train.beta=0,1", "train.beta"),
        ("train.steps=10,-1", "train.steps is -1"),
        ("train.steps=10,,20", "extraneous input"),
        ("main_n_demos=9,4", "main_n_demos is 4"),
        ("seed=3", "seed=0,1,2"),
        ("repair.split=new_scenes,new_items", "intervene.split is 'new_items'"),
        ("+experiment=nonsense", "experiment/nonsense"),
    ],
)
def test_what_cannot_run_is_refused_with_a_sentence(override: str, message: str):
    with pytest.raises(InputError, match=message):
        make_plan([override], ["evaluate"])


def test_a_launcher_without_its_extra_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install '\.\[ray\]'"):
        make_plan(["hydra/launcher=ray_cluster", "train.steps=10,20"], ["evaluate"])


@pytest.mark.slow
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_and_all_its_values_are_valid(experiment: str):
    plan = make_plan([f"+experiment={experiment}"], ["evaluate"])
    assert plan.jobs is not None and len(plan.jobs) > 1 and None not in plan.defaults.values()


def test_dvc_finds_every_study_by_the_name_that_stages_takes():
    with Repo(str(ROOT)) as repo:
        for study in ROOT.glob("studies/*/dvc.yaml"):
            (stage,) = repo.stage.collect(address(study.parent.name))
            assert stage.name == study.parent.name
