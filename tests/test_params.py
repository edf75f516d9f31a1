"""params.yaml is what conf/ composes, and no wrong parameter reaches a stage."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from dvc.utils.hydra import compose_and_dump
from omegaconf import OmegaConf

from pipeline import params
from pipeline.params import GRAPH, compose, validate
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF, ROOT
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


def test_params_yaml_is_what_conf_and_dvc_compose(tmp_path: Path):
    text = (ROOT / "params.yaml").read_text()
    compose_and_dump(tmp_path / "params.yaml", str(CONF), None, "config", str(ROOT / "plugins"), [])
    assert text == OmegaConf.to_yaml(composed()) == (tmp_path / "params.yaml").read_text()


@pytest.mark.slow
def test_overrides_are_kept_for_all_that_composes_conf_until_others_are_given(own_conf: Path):
    given = ["profile=smoke", "~variants.ae", "~variants.irl_maxent", "train.steps=9"]
    assert params.main(given) == 0 == params.main(["--check"])
    dvc_s = Path("dvc.yaml")  # what `dvc exp run -S` makes of conf/
    compose_and_dump(dvc_s, str(own_conf), None, "config", str(ROOT / "plugins"), ["evaluate.bins=5"])
    by_dvc, text = yaml.safe_load(dvc_s.read_text()), Path("params.yaml").read_text()
    assert by_dvc == yaml.safe_load(text.replace("bins: 10", "bins: 5"))
    assert (by_dvc["profile"], by_dvc["train"]["steps"]) == ("smoke", 9)
    assert not {"ae", "irl_maxent"} & by_dvc["variants"].keys()
    assert by_dvc["graph"]["train"] == ["full", "classifier"]
    assert params.main([]) == 0 and Path("params.yaml").read_text() == text
    assert params.main(["profile=paper"]) == 0
    assert Path("params.yaml").read_text() == (ROOT / "params.yaml").read_text()
    assert (own_conf / "composed.yaml").read_text() == (CONF / "composed.yaml").read_text()


@pytest.mark.parametrize("name", ["null", "no", "3"])
def test_a_name_that_yaml_reads_as_something_else_is_no_silent_omission(own_conf: Path, name: str):
    config = (own_conf / "config.yaml").read_text()
    (own_conf / "config.yaml").write_text(config.replace("users.normal: normal", f"users.normal: {name}"))
    with pytest.raises(InputError, match="put the name in quotes"):
        params.main([])


@pytest.mark.parametrize("given", ["train.steps=-1", "profile=none"])
def test_an_override_that_is_refused_leaves_all_as_it_was(own_conf: Path, given: str):
    with pytest.raises(InputError):
        params.main([given])
    assert not Path("params.yaml").exists()
    assert (own_conf / "composed.yaml").read_text() == (CONF / "composed.yaml").read_text()


@pytest.mark.parametrize("text", ["stage: train", "- stage", ""])
def test_a_variant_that_does_not_say_whether_it_is_compared_is_refused(own_conf: Path, text: str):
    (own_conf / "variants" / "mine.yaml").write_text(text)
    for given in ([], ["--check"]):
        with pytest.raises(InputError, match=r"conf/variants/mine\.yaml has no `compared`: add `compared: true` or"):
            params.main(given)


@pytest.mark.parametrize("name", ["null", "1e5", "my variant", "full.v2", "truth", "position_only"])
def test_a_variant_s_name_is_text_that_no_table_uses_for_something_else(own_conf: Path, name: str):
    (own_conf / "variants" / f"{name}.yaml").write_text((own_conf / "variants/full.yaml").read_text())
    with pytest.raises(InputError, match=f"variants is '{name}': expected another name"):
        params.main([])


@pytest.mark.parametrize("text", ["", "::: {", "<<<<<<< HEAD\ncomposed: []", "composed: []"])
def test_a_damaged_composed_yaml_is_named_with_what_restores_it(own_conf: Path, text: str):
    (own_conf / "composed.yaml").write_text(text)
    with pytest.raises(InputError, match=r"composed\.yaml is missing or damaged .*: `git checkout conf/"):
        params.main([])


def test_a_user_s_file_that_nothing_reads_is_named(own_conf: Path, capsys: pytest.CaptureFixture[str]):
    (own_conf / "users/null.yaml").write_text((own_conf / "users/careful.yaml").read_text())
    assert params.main([]) == 0
    assert 'conf/users/null.yaml is not read: add `- users@users.null: "null"` to conf/' in capsys.readouterr().err


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


def test_a_folder_below_the_project_s_gets_no_params_yaml(tmp_path: Path):
    run = subprocess.run([sys.executable, "-m", "pipeline.params"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 2 and f"run it in {ROOT}" in run.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "choice", sorted(f"{p.parent.name}={p.stem}" for g in ("profile", "protocol") for p in (CONF / g).glob("*"))
)
def test_every_profile_and_protocol_composes_for_graph_and_studies(choice: str):
    cfg = compose([choice])
    if "validation" not in choice:
        validate(cfg, [*GRAPH, *(cfg.studies if choice != "profile=demo" else ())])


@pytest.mark.parametrize(
    ("override", "names", "expected"),
    [
        ("n_demos=[0]", "parameter n_demos.0 is 0", "greater than or equal to 1"),
        ("protocol.seeds=[100]", "protocol.seeds is [100]", "at least 2 seeds"),
        ("seed=55", "parameter seed is 55", "null or one of protocol.seeds"),
        ("variants.full.kind=reward", "variants.full.kind is 'reward'", "'vae'"),
        ("train.steps=abc", "train.steps is 'abc'", "valid integer"),
        ("users.hasty={glass: 0.01}", "users.hasty", "a margin for each of"),
        ("evaluate.users=[someone]", "evaluate.users is ['someone']", "some of careful, normal, aggressive"),
        ("scenes.layout.items_per_scene=[2,4]", "items_per_scene", "from 0 to 3, one less than scenes.layout.slots"),
        ("evaluate.comparisons.8.against=[a,b,c,d,e,f,g,h,i]", "evaluate.comparisons", "27 tests in family clearance"),
        *((f"studies.{p.stem}.no_such=1", f"studies.{p.stem}.no_such is 1", "") for p in CONF.glob("studies/*.yaml")),
    ],
)
def test_a_wrong_parameter_is_named_with_what_was_expected(override: str, names: str, expected: str):
    with pytest.raises(InputError) as refused:
        validate(with_value(composed(), override), GRAPH)
    assert names in str(refused.value) and expected in str(refused.value)
