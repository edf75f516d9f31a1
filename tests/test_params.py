"""params.yaml is what conf/ composes, and no wrong parameter reaches a stage."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from dvc.utils.hydra import compose_and_dump
from omegaconf import OmegaConf

from pipeline import params
from pipeline.config.settings import NEEDS, Settings, is_study
from pipeline.models.registry import KINDS
from pipeline.params import COMPOSED, CONF, GRAPH, compose, load, validate
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SYMBOLS
from tests.factories import composed, with_value

ROOT = CONF.parent


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A copy of conf/composed.yaml in place of the repository's."""
    path = tmp_path / "composed.yaml"
    path.write_text(params.COMPOSED_WITH.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(params, "COMPOSED_WITH", path)
    return path


def test_overrides_are_kept_and_checked_and_the_paper_returns(kept: Path, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert params.composed_with() == []
    assert params.main(["profile=smoke"]) == 0 and params.composed_with() == ["profile=smoke"]
    assert params.main(["--check"]) == 0
    assert params.main(["profile=paper"]) == 0 and params.main(["--check"]) == 0


def test_parameters_composed_without_the_kept_overrides_are_refused_and_others_are_not(kept: Path):
    kept.write_text("composed: [profile=smoke]\n", encoding="utf-8")
    smoke = params.compose(["profile=smoke"])
    params.refuse_recomposed(smoke)
    one_changed = params.compose(["profile=smoke", "train.steps=9"])
    one_changed.composed = ["profile=smoke"]  # as DVC composes `-S profile=smoke -S train.steps=9`
    params.refuse_recomposed(one_changed)
    dropped = params.compose(["train.steps=9"])
    dropped.composed = ["profile=smoke"]  # as DVC composes `-S train.steps=9`
    with pytest.raises(InputError, match=r"composed without profile=smoke.*-S profile=smoke"):
        params.refuse_recomposed(dropped)


def test_params_yaml_is_what_conf_and_dvc_compose(tmp_path: Path):
    text = (ROOT / "params.yaml").read_text()
    compose_and_dump(tmp_path / "params.yaml", str(CONF), None, "config", str(ROOT / "plugins"), [])
    assert text == OmegaConf.to_yaml(composed()) == (tmp_path / "params.yaml").read_text()


def test_a_params_yaml_edited_by_hand_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "params.yaml").read_text()
    (tmp_path / "params.yaml").write_text(text)
    assert params.main(["--check"]) == 0
    (tmp_path / "params.yaml").write_text(text.replace("workers: 2", "workers: 3"))
    assert params.main(["--check"]) == 1
    assert "error: params.yaml is not what conf/ composes: run `python -m pipeline.params`" in capsys.readouterr().err


@pytest.mark.parametrize(
    "choice",
    sorted(f"{p.parent.name}={p.stem}" for g in ("profile", "protocol", "source") for p in (CONF / g).glob("*")),
)
def test_every_profile_protocol_and_source_composes_for_graph_and_studies(choice: str):
    cfg = compose([choice])
    if "validation" not in choice:
        validate(cfg, [*GRAPH, *(name for name in cfg.studies if is_study(name) and choice != "profile=demo")])


def test_the_smoke_profile_composes_with_the_wide_source():
    cfg = compose(["profile=smoke", "source=wide"])
    assert cfg.scenes.shared == 12 and cfg.scenes.source == compose(["source=wide"]).scenes.source


@pytest.mark.parametrize(
    ("override", "names", "expected"),
    [
        ("n_demos=[0]", "parameter n_demos is 0", "whole number from 1 to 10"),
        ("n_demos=[1,3]", "parameter main_n_demos is 9", "one of n_demos"),
        ("readings.families=[[0.5]]", "readings.families", "two numbers [m]"),
        ("readings.clear_cm=[8,4]", "readings.clear_cm", "ascending whole numbers"),
        ("seeds=[1,1]", "parameter seeds is [1, 1]", "each one once"),
        ("seeds=[0]", "protocol.seeds is [0]", "at least 2 seeds"),
        ("seeds=[100]", "validation_seeds", "none of `seeds`"),
        ("seed=55", "parameter seed is 55", "null or one of protocol.seeds"),
        ("variant=fulll", "parameter variant is 'fulll'", "one of full, ae"),
        ("variants.full.kind=reward", "variants.full.stage is 'train'", "irl, which fits kind reward"),
        ("variants.full.kind=tree", "variants.full.kind is 'tree'", "one of 'vae', 'reward', 'clearance'"),
        ("+variants.new={stage: irl}", "missing parameter 'variants.new.kind'", "conf/"),
        ("variants.full.alpha=null", "variants.full.alpha is None", "weight from 0"),
        ("+train.step=3", "unknown parameter 'train.step'", ""),
        ("train.steps=abc", "train.steps is 'abc'", "whole number"),
        ("train.engine=eager", "train.engine is 'eager'", "'auto', 'simd', 'cuda' or 'reference'"),
        ("users.careful.glass=-0.01", "users.careful.glass is -0.01", "margin from 0 to 1 [m]"),
        ("+users.hasty={glass: 0.01}", "users.hasty", "a margin for each of"),
        ("+users.truth={}", "name 'truth' in users", "none of truth, ideal, z"),
        ("demos.hand.tremor_hz=[8.0,60.0]", "demos.hand.tremor_hz is [8.0, 60.0]", "band above 0"),
        ("evaluate.users=[someone]", "evaluate.users is ['someone']", "some of careful, normal, aggressive"),
        ("intervene.split=new_scenes", "intervene.split is 'new_scenes'", "repair.split = 'new_items'"),
        ("record.first=[nobody]", "record.first is ['nobody']", "some of full"),
        ("scenes.layout.items_per_scene=[2,4]", "items_per_scene", "from 0 to 3, one less than scenes.layout.slots"),
        ("scenes.layout.glasses_chance=[0.5,0.4]", "glasses_chance", "chances from 0 that add up to 1"),
        ("scenes.layout.centre_low=0.9", "scenes.layout.centre_high is 0.88", "a place from centre_low"),
        ("source=photographed", "does not compose", "source/photographed"),
        ("+scenes.source.fog=1", "unknown parameter 'scenes.source.fog'", ""),
        ("scenes.source.exposure=[1.2,0.8]", "scenes.source.exposure is [1.2, 0.8]", "two numbers from 0, the smaller"),
        ("scenes.source.refraction=[0,2]", "scenes.source.refraction is [0, 2]", "two numbers from 0 to 1"),
        ("scenes.source.patterns=[tartan]", "scenes.source.patterns is ['tartan']", "some of stripe, check"),
        ("evaluate.comparisons.1.splits=[new_items]", "evaluate.comparisons", "only in seen scenes"),
        ("evaluate.comparisons.4.family=paper", "evaluate.comparisons", "27 tests in family paper"),
        ("repair.split=seen_scenes", "repair.split", "a split that all seeds share, one of new_scenes, new_items"),
        ("repair.optimiser=newton", "repair.optimiser", "'gradient'"),
        ("variants.irl_ranked.objective=apprenticeship", "irl_ranked.objective", "'maxent' or 'ranked'"),
        ("questions.add_bowl.symbol=spoon", "questions.add_bowl.symbol is 'spoon'", "one of bowl"),
        ("questions.add_bowl.kind=break", "questions.add_bowl", "add"),
        ("+questions.swap={kind: swap, symbol: bowl, to: bowl}", "questions.swap.to is 'bowl'", "another symbol"),
        ("+questions.truth={kind: add, symbol: bowl}", "name 'truth' in questions", "none of truth, ideal, z"),
        ("users=null", "users is None", ""),
        ("questions.another_user.to=nobody", "questions.another_user.to is 'nobody'", "one of careful"),
        ("profile=none", "does not compose", "profile/none"),
        ("no_such_key=1", "unknown parameter 'no_such_key'", "conf/"),
        ("users.careful={mug: 0.1}", "unknown parameter 'users.careful.mug'", ""),
        ("users.careful={bowl: 0.1}", "users.careful is {'bowl': 0.1}", "a margin for each of bowl, plate"),
    ],
)
def test_a_wrong_parameter_is_named_with_what_was_expected(override: str, names: str, expected: str):
    name = override.partition("=")[0]
    anew = name in COMPOSED or name[0] == "~" or name == "no_such_key"
    with pytest.raises(InputError) as refused:
        validate(compose([override]) if anew else with_value(composed(), override.removeprefix("+")), GRAPH)
    assert names in str(refused.value) and expected in str(refused.value)


OUT_OF_RANGE = """
scenes.root_seed=-1 scenes.root_seed=1.5 scenes.layout.slots=0
scenes.layout.items_per_scene=[] scenes.layout.clear_of_items=-0.5 scenes.layout.scale_low=0 demos.queries_new=0
scenes.source.pattern_chance=2 scenes.source.white_balance=-1
demos.queries_new=True demos.ends_within_m='abc' demos.poor_above_m=-1.0 demos.hand.tremor_m=-1.0 train.steps=0
variants.full.beta=-1 variants.irl_ranked.steps=0 irl.color_jitter.other_table=2 clearance.steps=0 clearance.rate=0
evaluate.bins=0 repair.steps=0 repair.starts=0 repair.distance_penalty=0 intervene.paths=0 record.scenes=0
record.repairs=0 record.training_scenes=0 record.map_side=0
"""


@pytest.mark.parametrize("override", OUT_OF_RANGE.split())
def test_a_value_out_of_range_is_named(override: str):
    with pytest.raises(InputError, match=re.escape(override.replace("=", " is ") + ": expected")):
        validate(with_value(composed(), override), GRAPH)


@pytest.mark.parametrize(
    "study", sorted(path.stem for path in (CONF / "studies").glob("*.yaml") if is_study(path.stem))
)
def test_a_study_s_unknown_parameter_is_named(study: str):
    with pytest.raises(InputError, match=f"unknown parameter 'studies.{study}.no_such'"):
        validate(with_value(composed(), f"studies.{study}.no_such=1"), [study])


def test_an_interval_over_validation_scenes_needs_two_of_them():
    one_scene = "scenes.validation=1"
    validate(with_value(composed(), one_scene), ["evaluate"])
    with pytest.raises(InputError, match=r"scenes\.validation is 1: expected at least 2"):
        validate(with_value(composed("protocol=validation"), one_scene), ["evaluate"])


def test_names_in_the_parameters_are_those_of_the_library():
    variants = Settings.model_json_schema()["properties"]["variants"]["patternProperties"]
    assert set(next(iter(variants.values()))["discriminator"]["mapping"]) == set(KINDS)
    assert set(NEEDS) <= {path.stem for path in (ROOT / "pipeline" / "stages").glob("*.py")}


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


def test_broken_yaml_is_one_line(tmp_path: Path):
    for name in ("pipeline", "studies", "conf"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    (tmp_path / "conf/train.yaml").write_text("train: [1\n")
    command = [sys.executable, "-m", "pipeline.params"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and "Traceback" not in done.stderr


@pytest.mark.parametrize("key", ["varaint", "variants.full.delta"])
def test_an_override_of_an_unknown_parameter_is_refused_by_name(key: str):
    with pytest.raises(InputError, match=f"unknown parameter '{key}'"):
        load(ROOT / "params.yaml", [f"{key}=3"])


@pytest.mark.parametrize("override", ["train.model.latent=3", "profile=smoke"])
def test_an_override_of_what_others_were_composed_of_is_refused(override: str):
    with pytest.raises(InputError, match=r"composed of .*`python -m pipeline\.params"):
        load(ROOT / "params.yaml", [override])


def test_what_other_parameters_are_composed_of_is_known():
    text = "\n".join(path.read_text() for path in CONF.rglob("*.yaml"))
    others = {"variants", "studies", "questions", "experiment", "hydra"}
    groups = {path.name for path in CONF.iterdir() if path.is_dir()} - others
    sources = set(re.findall(r"\$\{(?!hydra)([\w.]+)\}", text))
    assert {*sources, *groups} == set(COMPOSED)
