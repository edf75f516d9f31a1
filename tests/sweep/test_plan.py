"""What a sweep's command line asks for, and which mistakes are refused before any work is done."""

from pathlib import Path

import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF, ROOT
from pipeline.sweep.job import Sweep
from pipeline.sweep.plan import canonical, make_plan, value_of

pytestmark = pytest.mark.slow  # composes conf/ for each case
EXPERIMENTS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))


@pytest.mark.parametrize(
    ("arguments", "fixed", "jobs"),
    [
        (["profile=smoke", "train.steps=5,6"], ["profile=smoke"], [["train.steps=5"], ["train.steps=6"]]),
        (["variants.full.alpha=1,100,100.0,1e2"], [], [["variants.full.alpha=1"], ["variants.full.alpha=100"]]),
        (["variants.full.alpha=1e2"], ["variants.full.alpha=100"], [[]]),
        (["evaluate.bins=5,6", "evaluate.bins=7,8"], [], [["evaluate.bins=7"], ["evaluate.bins=8"]]),
    ],
)
def test_every_combination_is_one_job_for_hydra_too(arguments: list[str], fixed: list[str], jobs: list[list[str]]):
    plan = make_plan(arguments, ["evaluate"])
    assert plan.fixed == fixed and plan.jobs == [[*fixed, *job] for job in jobs]
    parsed = OverridesParser.create().parse_overrides(plan.overrides)
    (batch,) = BasicSweeper.split_arguments(parsed, None)
    assert [[text for text in job if not text.startswith("hydra")] for job in batch] == plan.jobs


def test_defaults_are_known_and_need_not_fit_the_others():
    plan = make_plan(["n_demos=[1,3]", "main_n_demos=1,3", "+experiment=paper"], ["evaluate"])
    assert plan.jobs is not None and len(plan.jobs) == 2 and plan.defaults == {"main_n_demos": "9"}


def test_a_job_s_folder_is_named_by_what_it_does_not_share():
    sweep = Sweep(ROOT, Path("swept"), Path("cache"), {"fixed": ["clearance.rate=1.0"]})
    folder = sweep.job_folder(["clearance.rate=1.0", "variants.full.alpha=100", "evaluate.bins=5"])
    assert folder == Path("swept/jobs/evaluate.bins=5,variants.full.alpha=100")


def test_a_value_s_text_is_read_as_the_value_whatever_its_letters():
    for value in ("Zoë", "夕食", "NA", "1e5", "null", 'x"y', "x\\ny", "x\\", "a, b", ["مرحبا", None, 2]):
        (read,) = OverridesParser.create().parse_overrides([f"a={canonical(value)}"])
        assert canonical(read.value()) == canonical(value) and value in (read.value(), getattr(read.value(), "text", 0))


def test_a_group_is_known_by_what_stands_where_it_is_put():
    cfg = OmegaConf.create({"users": {"careful": {"glass": 1e-1, "bowl": None}}})
    assert value_of(cfg, "users@users.careful") == "{bowl:null,glass:0.1}"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("train.beta=0,1", "train.beta"),
        ("train.steps=10,-1", "train.steps is -1"),
        ("train.steps=10,,20", "extraneous input"),
        ("main_n_demos=9,4", "main_n_demos is 4"),
        ("repair.split=new_scenes,new_items", "intervene.split is 'new_items'"),
        ("users@users.careful=glob(*)", "name the values"),
        ("questions=null", "must be a string or a list"),
        ("+experiment=nonsense", "experiment/nonsense"),
        ("+experiment=beta,label_noise", "beta sweeps, too: name one"),
        ("hydra/launcher=nowhere", "make venv-cluster"),
    ],
)
def test_what_cannot_run_is_refused_with_a_sentence(override: str, message: str):
    with pytest.raises(InputError, match=message):
        make_plan([override], ["evaluate"])


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_and_all_its_values_are_valid(experiment: str):
    plan = make_plan([f"+experiment={experiment}"], ["evaluate"])
    assert plan.jobs is not None and len(plan.jobs) > 1 and "null" not in plan.defaults.values()
