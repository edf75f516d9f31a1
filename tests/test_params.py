"""params.yaml is what conf/ composes, and no wrong parameter reaches a stage."""

import re
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
import yaml
from dvc.utils.hydra import compose_and_dump
from omegaconf import OmegaConf

from pipeline import params
from pipeline.launch import FITTED, load
from pipeline.models.trained import KINDS
from pipeline.params import GRAPH, compose, validate
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF, ROOT
from pipeline.world.layout import SYMBOLS
from tests.factories import composed, with_value


@pytest.fixture
def own_conf(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A copy of conf/ in place of the repository's, in a folder of its own."""
    for path in CONF.rglob("*.yaml"):
        copy = tmp_path / path.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    monkeypatch.setattr(params, "CONF", tmp_path / "conf")
    monkeypatch.setattr(params, "COMPOSED", tmp_path / "conf" / "composed.yaml")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "conf"


def composed_by_dvc(conf: Path, *overrides: str) -> dict:
    """What `dvc exp run -S` makes of conf/."""
    compose_and_dump(Path("dvc.yaml"), str(conf), None, "config", str(ROOT / "plugins"), list(overrides))
    return yaml.safe_load(Path("dvc.yaml").read_text())


def test_params_yaml_is_what_conf_and_dvc_compose(tmp_path: Path):
    text = (ROOT / "params.yaml").read_text()
    compose_and_dump(tmp_path / "params.yaml", str(CONF), None, "config", str(ROOT / "plugins"), [])
    assert text == OmegaConf.to_yaml(composed()) == (tmp_path / "params.yaml").read_text()


def test_overrides_are_kept_for_all_that_composes_conf_until_others_are_given(own_conf: Path):
    given = ["profile=smoke", "~variants.ae", "~variants.irl_maxent", "train.steps=9"]
    assert params.main(given) == 0 == params.main(["--check"])
    by_dvc, text = composed_by_dvc(own_conf, "evaluate.bins=5"), Path("params.yaml").read_text()
    assert by_dvc == yaml.safe_load(text.replace("bins: 10", "bins: 5"))
    assert (by_dvc["profile"], by_dvc["train"]["steps"]) == ("smoke", 9) and not {"ae", "irl_maxent"} & set(
        by_dvc["variants"]
    )
    assert by_dvc["graph"]["train"] == ["full", "classifier"]
    assert params.main([]) == 0 and Path("params.yaml").read_text() == text
    assert params.main(["profile=paper"]) == 0
    assert Path("params.yaml").read_text() == (ROOT / "params.yaml").read_text()
    assert (own_conf / "composed.yaml").read_text() == (CONF / "composed.yaml").read_text()


@pytest.mark.parametrize("given", ["train.steps=-1", "~seeds", "profile=none", "train.steps=1,2", "no_such=1"])
def test_an_override_that_is_refused_leaves_all_as_it_was(own_conf: Path, given: str):
    with pytest.raises(InputError):
        params.main([given])
    assert not Path("params.yaml").exists()
    assert (own_conf / "composed.yaml").read_text() == (CONF / "composed.yaml").read_text()


def test_an_edit_of_conf_or_of_params_yaml_is_found(own_conf: Path, capsys: pytest.CaptureFixture[str]):
    assert params.main([]) == 0
    text = Path("params.yaml").read_text()
    Path("params.yaml").write_text(text.replace("workers: 2", "workers: 3"))
    assert params.main(["--check"]) == 1
    assert "error: params.yaml is not what conf/ composes: run `python -m pipeline.params`" in capsys.readouterr().err
    Path("params.yaml").write_text(text)
    scenes = own_conf / "scenes.yaml"
    scenes.write_text(scenes.read_text().replace("per_seed: ", "per_seed: 1"))
    assert params.main(["--check", "--out", "out.txt"]) == 1 and not Path("out.txt").exists()


@pytest.mark.parametrize(
    "choice",
    sorted(f"{p.parent.name}={p.stem}" for g in ("profile", "protocol") for p in (CONF / g).glob("*")),
)
def test_every_profile_and_protocol_composes_for_graph_and_studies(choice: str):
    cfg = compose([choice])
    if "validation" not in choice:
        validate(cfg, [*GRAPH, *(cfg.studies if choice != "profile=demo" else ())])


@pytest.mark.parametrize(
    ("override", "names", "expected"),
    [
        ("n_demos=[0]", "parameter n_demos.0 is 0", "greater than or equal to 1"),
        ("n_demos=[1,3]", "parameter main_n_demos is 9", "one of n_demos"),
        ("seeds=[1,1]", "parameter seeds is [1, 1]", "each one once"),
        ("protocol.seeds=[0]", "protocol.seeds is [0]", "at least 2 seeds"),
        ("seeds=[100]", "validation_seeds", "none of `seeds`"),
        ("seed=55", "parameter seed is 55", "null or one of protocol.seeds"),
        ("variants.full.kind=reward", "variants.full.kind is 'reward'", "'vae'"),
        ("variants.full.stage=repair", "variants.full.stage is 'repair'", "one of train, irl, clearance"),
        ("train.step=3", "parameter train.step is 3", "not permitted"),
        ("train.steps=abc", "train.steps is 'abc'", "valid integer"),
        ("users.hasty={glass: 0.01}", "users.hasty", "a margin for each of"),
        ("users.truth={}", "users.truth", "none of truth, ideal, z"),
        ("demos.hand.tremor_hz=[8.0,60.0]", "demos.hand.tremor_hz is [8.0, 60.0]", "band above 0"),
        ("evaluate.users=[someone]", "evaluate.users is ['someone']", "some of careful, normal, aggressive"),
        ("intervene.split=new_scenes", "intervene.split is 'new_scenes'", "repair.split = 'new_items'"),
        ("scenes.layout.items_per_scene=[2,4]", "items_per_scene", "from 0 to 3, one less than scenes.layout.slots"),
        ("scenes.source.exposure=[1.2,0.8]", "scenes.source.exposure is [1.2, 0.8]", "the smaller number first"),
        ("evaluate.comparisons.4.family=paper", "evaluate.comparisons", "27 tests in family paper"),
        ("questions.another_user.to=nobody", "questions.another_user.to is 'nobody'", "one of careful"),
        ("no_such_key=1", "unknown parameter 'no_such_key'", ""),
        *((f"studies.{p.stem}.no_such=1", f"studies.{p.stem}.no_such is 1", "") for p in CONF.glob("studies/*.yaml")),
    ],
)
def test_a_wrong_parameter_is_named_with_what_was_expected(override: str, names: str, expected: str):
    with pytest.raises(InputError) as refused:
        validate(with_value(composed(), override), GRAPH)
    assert names in str(refused.value) and expected in str(refused.value)


def test_kinds_and_groups_in_the_parameters_are_those_of_the_library():
    modules = {stage: import_module(f"pipeline.stages.{stage}") for stage in GRAPH}
    assert all(hasattr(module, "Settings") for module in modules.values())
    kinds = {get_args(modules[stage].Variant.model_fields["kind"].annotation)[0] for stage in FITTED}
    assert kinds == set(KINDS)


def test_a_stage_is_not_refused_for_what_another_needs():
    cfg = load(ROOT / "params.yaml")
    cfg.users, cfg.evaluate.users = {"aggressive": dict.fromkeys(SYMBOLS)}, ["aggressive"]
    validate(cfg, ["train"])
    with pytest.raises(InputError, match="expected at least one user with a margin"):
        validate(cfg, ["repair"])


@pytest.mark.parametrize("text", [None, "", "- 1\n", "seeds: [1", "a: ${b}\n"])
def test_a_file_that_holds_no_parameters_is_refused(tmp_path: Path, text: str | None):
    if text is not None:
        (tmp_path / "params.yaml").write_text(text)
    with pytest.raises(InputError, match=r"(?s)params\.yaml .*python -m pipeline\.params"):
        load(tmp_path / "params.yaml")


@pytest.mark.parametrize("key", ["varaint", "variants.full.delta"])
def test_an_override_of_an_unknown_parameter_is_refused_by_name(key: str):
    with pytest.raises(InputError, match=re.escape(f"unknown parameter '{key}'")):
        load(ROOT / "params.yaml", [f"{key}=3"])
