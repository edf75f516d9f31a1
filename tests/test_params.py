"""params.yaml is what conf/ composes, and no parameter out of its range gets past the door."""

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from dvc.utils.hydra import compose_and_dump
from omegaconf import OmegaConf
from pipeline.spec.search import METHODS, RESTARTS

from pipeline.config import Agreed, agreement
from pipeline.config.models import Objective
from pipeline.config.stages import Misspecify, Optimiser, Pictures, Search
from pipeline.models import baselines as nulls
from pipeline.models.registry import KINDS
from pipeline.params import COMPOSED, CONF, GRAPH, compose, load, render, validate
from pipeline.planning.repair import OPTIMISERS
from pipeline.runtime.errors import InputError
from pipeline.training.irl.fit import OBJECTIVES
from pipeline.world.layout import SYMBOLS
from studies.robustness.corruptions import PICTURES
from studies.rule_families.families import FORMS, OWN

ROOT = CONF.parent


def test_params_yaml_is_what_conf_composes():
    assert (ROOT / "params.yaml").read_text() == render(compose())


def test_dvc_composes_the_same_bytes(tmp_path: Path):
    compose_and_dump(tmp_path / "params.yaml", str(CONF), None, "config", str(ROOT / "plugins"), [])
    assert (tmp_path / "params.yaml").read_text() == render(compose())


def test_every_profile_and_protocol_composes():
    for group in ("profile", "protocol"):
        for file in sorted((CONF / group).glob("*.yaml")):
            compose([f"{group}={file.stem}"])


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("n=[0]", "parameter n is 0"),
        ("n=[11]", "parameter n is 11"),
        ("n=[1,3]", "main_n_demos is 9"),
        ("seeds=[]", r"seeds is \[\]: expected one at least"),
        ("seeds=[1,1]", "each one once"),
        ("checkpoints=[0,-1]", "checkpoints is -1: expected a whole number from 0"),
        ("checkpoints=[5,5]", "each one once"),
        ("checkpoints=null", "parameter checkpoints is None"),
        ("seeds=[100]", "none of `seeds`"),
        ("users.careful.glass=-0.01", "users.careful.glass is -0.01"),
        ("variant=fulll", "parameter variant is 'fulll'"),
        ("variants.full.kind=reward", "variants.full.stage is 'train': expected irl, which fits kind reward"),
        ("variants.irl_ranked.stage=train", "variants.irl_ranked.stage is 'train': expected irl"),
        ("variants.full.kind=tree", "variants.full.kind is 'tree': expected one of 'vae', 'reward', 'clearance'"),
        ("+variants.new={stage: irl}", "variants.new.kind is missing"),
        ("variants.full.alpha=null", "variants.full.alpha is None: expected a weight from 0"),
        ("~variants.path.model", "variants.path.model is missing"),
        ("~variants.irl_ranked.objective", "variants.irl_ranked.objective is missing"),
        ("+variants.path.model.leaves=3", "variants.path.model.leaves is 3: expected none of that name"),
        ("+variants.path.delta=1", "variants.path.delta is 1: expected none of that name"),
        ("train.steps=abc", "train.steps is 'abc': expected a whole number"),
        ("train.rate=null", "train.rate is None: expected a number"),
        ("train.model.hidden=-1", "train.model.hidden is -1: expected a whole number from 1"),
        ("train.engine=eager", "expected one of auto, stacked, batched, reference"),
        ("irl.sparsity=-1", "irl.sparsity is -1: expected a weight from 0"),
        ("irl.across=1", "irl.across is 1: expected true or false"),
        ("search.weight=true", "search.weight is True: expected a size above 0"),
        ("seed=55", "parameter seed is 55"),
        ("seed=100", r"parameter seed is 100: expected null or one of protocol.seeds, \[0, .* under protocol=test"),
        ("train.steps=0", "parameter train.steps is 0: expected a whole number from 1"),
        ("counterfactual.moved_scenes=200", "moved_scenes is 200: expected at most counterfactual.scenes = "),
        ("path.rate=0", "parameter path.rate is 0: expected a number above 0"),
        ("identify.stranger={bowl:null,plate:null,cutlery:null,glass:0.042}", "expected margins that no user has"),
        ("workers=0", "workers is 0"),
        ("scenes.shared=0", "scenes.shared is 0"),
        ("profile=none", "does not compose"),
        ("no_such_key=1", "does not compose"),
        ("n=9", "parameter n is 9: expected a list"),
        ("seeds=null", "parameter seeds is None: expected a list"),
        ("users=null", "parameter users is None: expected a mapping"),
        ("users.normal=3", "parameter users.normal is 3: expected a mapping"),
        ("variants.full=3", "parameter variants.full is 3: expected a mapping"),
        ("scenes=3", "parameter scenes is 3: expected a mapping"),
        ("paths.data=null", "parameter paths.data is None: expected a name"),
        ("protocol.seeds=[]", r"parameter protocol.seeds is \[\]: expected one at least"),
        ("repair.optimiser=newton", "repair.optimiser is 'newton': expected one of gradient, normalised, adam"),
        ("repair.rate=0", "repair.rate is 0: expected a size above 0"),
        ("search.weight=0", "search.weight is 0: expected a size above 0"),
        ("search.reach=-1", "search.reach is -1: expected a length above 0"),
        ("search.evaluations=4", "search.evaluations is 4: expected 5 at least, for multistart climbs"),
        ("search.climb=20", r"search.looks \+ search.climb is 31: expected at most the 30 evaluations"),
        (
            "variants.irl_ranked.objective=apprenticeship",
            "expected one of maxent, ranked",
        ),
        ("irl.color_jitter.gain=-1", "irl.color_jitter.gain is -1: expected a standard deviation from 0"),
        ("irl.color_jitter.other_table=1.5", "irl.color_jitter.other_table is 1.5: expected a chance from 0 to 1"),
        ("variants.full.alpha=-1", "variants.full.alpha is -1: expected a weight from 0"),
        ("variants.full.gamma=0", "variants.full.gamma is 0: expected a weight above 0"),
        ("demos.hand.speed_m_s=-1", "demos.hand.speed_m_s is -1: expected a size above 0"),
        ("demos.hand.tremor_hz=[8.0,60.0]", r"demos.hand.tremor_hz is \[8.0, 60.0\]: expected a band above 0"),
        ("evaluate.users=[someone]", r"evaluate.users is \['someone'\]: expected some of careful, normal, aggressive"),
        ("robustness.split=seen_scenes", "expected a split that all seeds share, one of new_scenes, new_items"),
        ("+robustness.pictures.fog=[1]", r"robustness.pictures.fog is \[1\]: expected none of that name"),
        (
            "robustness.pictures.shade=[1.5]",
            r"robustness.pictures.shade is .*1.5.*: expected numbers above 0, at most 1, the smallest first",
        ),
        ("+search.rivals.newton=null", "a name in search.rivals is 'newton': expected 'multistart', 'cem' or 'lbfgs'"),
        ("protocol.seeds=[55]", "parameter protocol.seeds is .55.: expected a list of some of"),
    ],
)
def test_a_parameter_out_of_range_is_named(override: str, says: str):
    with pytest.raises(InputError, match=says):
        validate(compose([override]), GRAPH)


def test_an_interval_over_validation_scenes_needs_two_of_them():
    alone = ["scenes.validation=1", "seeds=[0]", "validation_seeds=[100]"]
    validate(compose(alone), ["evaluate"])
    with pytest.raises(InputError, match=r"scenes\.validation is 1: expected 2 at least"):
        validate(compose([*alone, "protocol=validation"]), ["evaluate"])


def test_every_kind_of_model_has_settings_of_its_own():
    variants = Agreed.model_json_schema()["properties"]["variants"]["patternProperties"]
    assert set(next(iter(variants.values()))["discriminator"]["mapping"]) == set(KINDS)


def test_names_that_parameters_may_have_are_those_of_the_library():
    rivals = Search.model_json_schema()["properties"]["rivals"]["propertyNames"]["enum"]
    assert {*rivals, "bayesian"} == set(METHODS)
    assert list(Pictures.model_fields) == list(PICTURES)
    assert get_args(Optimiser) == OPTIMISERS and get_args(Objective) == OBJECTIVES
    assert agreement.RESTARTS == RESTARTS and agreement.OWN_FORM == OWN
    assert set(get_args(get_args(Misspecify.model_fields["forms"].annotation)[0])) == set(FORMS)
    assert agreement.NULLS == nulls.NULLS and agreement.NEAREST == nulls.NEAREST


def test_what_stages_need_of_others_is_asked_for_the_graph_but_not_for_another_stage_alone():
    cfg = load(ROOT / "params.yaml")
    cfg.n_demos = [9]
    with pytest.raises(InputError, match=r"ablate\.n is .1, 9.: expected some of 9"):
        validate(cfg, GRAPH)
    validate(cfg, ["train"])
    with pytest.raises(InputError, match=r"ablate\.n"):
        validate(cfg, ["ablate"])


@pytest.mark.parametrize("stage", ["intervene", "identify"])
def test_a_single_user_has_nobody_to_be_held_against(stage: str):
    cfg = load(ROOT / "params.yaml")
    cfg.users, cfg.evaluate.users = {"normal": cfg.users.normal}, ["normal"]
    with pytest.raises(InputError, match=r"users is .'normal'.: expected two at least"):
        validate(cfg, [stage])
    validate(cfg, ["train"])


@pytest.mark.parametrize("stage", ["repair", "search", "counterfactual"])
def test_somebody_must_mind_something(stage: str):
    cfg = load(ROOT / "params.yaml")
    nothing = dict.fromkeys(SYMBOLS)
    cfg.users, cfg.evaluate.users = {"aggressive": nothing, "calm": nothing}, ["aggressive"]
    with pytest.raises(InputError, match="expected one at least who minds an item"):
        validate(cfg, [stage])
    validate(cfg, ["train"])


def test_a_stage_that_needs_something_of_others_is_one():
    assert set(agreement.AGREEMENTS) <= {path.stem for path in (ROOT / "pipeline" / "stages").glob("*.py")}


def test_an_unknown_user_needs_a_margin_for_each_symbol():
    with pytest.raises(InputError, match=r"users\.hasty"):
        compose(["+users.hasty={glass: 0.01}"])


def test_a_stage_refuses_bad_parameters_before_any_work(tmp_path: Path):
    bad = OmegaConf.create((ROOT / "params.yaml").read_text())
    bad.n = [0]
    (tmp_path / "params.yaml").write_text(OmegaConf.to_yaml(bad))
    with pytest.raises(InputError, match="parameter n is 0"):
        load(tmp_path / "params.yaml")
    command = [sys.executable, "-m", "pipeline.stages.train", "--params", str(tmp_path / "params.yaml")]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 2
    assert run.stderr.strip().startswith("error: parameter n is 0")
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize("text", ["", "- 1\n", "seeds: [1", "a: ${b}\n"])
def test_a_file_that_is_no_parameters_is_refused(tmp_path: Path, text: str):
    (tmp_path / "params.yaml").write_text(text)
    with pytest.raises(InputError, match=r"params\.yaml"):
        load(tmp_path / "params.yaml")


def test_a_missing_file_says_how_to_make_it(tmp_path: Path):
    with pytest.raises(InputError, match=r"python -m pipeline\.params"):
        load(tmp_path / "params.yaml")


@pytest.mark.parametrize("key", ["irl.steps", "varaint", "variants.full.delta", "seed.first"])
def test_an_override_of_no_parameter_is_refused_by_name(key: str):
    with pytest.raises(InputError, match=f"has no parameter {key}:"):
        load(ROOT / "params.yaml", [f"{key}=3"])


@pytest.mark.parametrize("override", ["train.model.latent=3", "seeds=[0]", "profile=smoke", "protocol=validation"])
def test_an_override_that_would_change_only_a_name_is_refused(override: str):
    with pytest.raises(InputError, match=r"composed of .*: run `python -m pipeline\.params"):
        load(ROOT / "params.yaml", [override])


def test_what_other_parameters_are_composed_of_is_known():
    text = "\n".join(path.read_text() for path in CONF.rglob("*.yaml"))
    groups = {path.name for path in CONF.iterdir() if path.is_dir()} - {"variants"}
    targets = set(re.findall(r"\$\{(?!hydra)([\w.]+)\}", text))
    assert {*targets, *groups} == set(COMPOSED)


def test_a_user_whose_name_is_a_number_is_asked_for_in_quotes():
    cfg = OmegaConf.create((ROOT / "params.yaml").read_text().replace("\n  careful:\n    bowl", "\n  1:\n    bowl"))
    with pytest.raises(InputError, match="a name in users is 1: expected a name of letters"):
        validate(cfg)  # pyright: ignore[reportArgumentType]


def test_every_kind_of_parameter_can_be_overridden():
    overrides = ["seed=3", "n=[3,9]", "variant=ae", "variants.full.beta=0.5", "users.careful.glass=null"]
    cfg = load(ROOT / "params.yaml", overrides, ["train"])
    assert (cfg.seed, cfg.n_demos, cfg.variant, cfg.variants.full.beta) == (3, [3, 9], "ae", 0.5)
    assert cfg.users.careful.glass is None and load(ROOT / "params.yaml", ["seed=null"]).seed is None
