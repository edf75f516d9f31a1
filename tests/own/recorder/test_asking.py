"""`ask`: all is written before the first trial, nothing shown tells a condition, and no answer is lost."""

import json
import shutil
from base64 import b64encode
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from pipeline import library
from pipeline.artifacts.files import write_json
from pipeline.own import asked, fitting, trials
from pipeline.own.__main__ import main as own
from pipeline.own.asked import Sitting, sittings
from pipeline.own.folder import Folder
from pipeline.own.recorder import designing
from pipeline.own.recorder.asking import Asking, main, outlook
from pipeline.own.recorder.designing import Designing
from pipeline.own.recorder.placing import Placing
from pipeline.runtime.errors import InputError
from tests.own.folders import add_kind, answer, edit, make_folder, whole

pytestmark = pytest.mark.slow  # thousands of places are tried for each sitting


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A folder of which Ana's sitting has begun, with a kind that no scene has room for."""
    path = make_folder(tmp_path_factory.mktemp("asked") / "table")
    add_kind(path, "cup,blue.png,0.12\ntray,blue.png,0.95\n")
    shutil.copytree(path / "kinds" / "cup", path / "kinds" / "tray")
    folder = whole(path)
    Asking(folder, "Ana", 10.0).begin(user="Ana")
    return folder


@pytest.fixture
def folder(begun: Folder) -> Folder:
    for file in (begun.path / "asked").glob("*.csv"):
        file.unlink()
    return begun


def test_the_sitting_is_written_before_the_first_trial_and_each_answer_before_the_next(folder: Folder):
    content = json.loads((folder.path / "asked" / "001.json").read_text())
    assert {"questions", "rule", "trials", "seed", "user", "digest"} <= content.keys()
    assert content["no_room_for"] == ["tray"] and "tray" not in {trial["condition"] for trial in content["trials"]}
    asking = Asking(folder, None, 10.0)
    told = answer(asking, 7)
    rows = pd.read_csv(folder.path / "asked" / "001.csv")
    assert rows["valid"].tolist() == [True, False] * 3 + [True] and (rows["response_ms"] == 900).all()
    again = Asking(folder, None, 10.0)  # after a kill
    assert again.begin(user="Ana") == told and told["answered"] == 7
    assert again.undo(user="Ana")["trial"] == rows["trial"].iloc[-1]


def test_items_are_near_the_path_as_the_plan_says_and_free_of_the_path_itself(folder: Folder):
    plan = sittings(folder.path)[folder.path / "asked" / "001.json"].plan
    cups = plan[plan["condition"] == "cup"]
    near = cups["near"].astype(bool)
    assert len(cups) > 30 and cups["clearance_m"].min() >= 0
    assert (cups.loc[near, "clearance_m"] <= 0.04).all() and (cups.loc[~near, "clearance_m"] > 0.04).all()


def test_nothing_that_is_shown_tells_the_condition(folder: Folder):
    asking, shown = Asking(folder, None, 10.0), {}
    plan, told = asking.kept["Ana"].plan, asking.begin(user="Ana")
    for _ in range(30):
        picture = asking.image("001", told["trial"])
        shown.setdefault(plan["condition"][told["trial"]], []).append((set(told), len(told["points"]), picture))
        told = asking.answer(user="Ana", trial=told["trial"], valid=True, response_ms=900.0)
    assert {"unchanged", "sticker", "cup"} <= shown.keys()
    assert len({frozenset(keys) for several in shown.values() for keys, *_ in several}) == 1
    sizes = {picture[16:24] for several in shown.values() for *_, picture in several}  # width and height of a PNG
    assert len(sizes) == 1, "pictures differ in what they show alone"
    points = {count for several in shown.values() for _, count, _ in several}
    assert points == {fitting.REPAIRED_POINTS}, "a path as a hand drew it is no repair"


def test_repairs_come_with_their_original_and_a_detour_that_look_alike(folder: Folder):
    bad = folder.demos[(folder.demos["user"] == "Ana") & ~folder.demos["valid"]].head(2)[["user", "scene", "demo"]]
    tables = folder.path / "report" / "tables"
    tables.mkdir(parents=True)
    write_json(tables.parent / "metrics.json", {"state": asked.digest(folder.path, "demonstrations.csv")})
    bad.assign(p_before=0.1, p_after=0.9, moved_m=0.1).to_parquet(tables / "repaired.parquet")
    line = np.linspace((0.1, 0.1), (0.5, 0.5), fitting.REPAIRED_POINTS)
    parts = [pd.DataFrame(line, columns=["x", "y"]).assign(**row) for row in bad.to_dict("records")]
    pd.concat(parts).to_parquet(tables / "repaired_paths.parquet")
    made = trials.repairs(folder, "Ana", np.random.default_rng(0))
    edit(folder.path, lambda table: table.assign(t=table["t"] + "0"))
    assert not trials.repairs(folder, "Ana", np.random.default_rng(0)), "of a report on other demonstrations"
    shutil.rmtree(tables.parent)
    assert sorted(path["role"] for path in made.values()) == sorted(["unrepaired", "repair", "detour"] * 2)
    assert {len(path["points"]) for path in made.values()} == {fitting.REPAIRED_POINTS}


def test_two_windows_two_people_and_a_time_that_is_over(folder: Folder):
    asking = Asking(folder, None, 10.0)
    told = asking.begin(user="Ana")
    asking.answer(user="Ana", trial=told["trial"], valid=True, response_ms=1000.0)
    with pytest.raises(InputError, match="another window"):
        asking.answer(user="Ana", trial=told["trial"], valid=False, response_ms=1000.0)
    answer(asking, 3, "Jürgen")
    assert [(s.user, len(s.answers)) for s in sittings(folder.path).values()] == [("Ana", 1), ("Jürgen", 3)]
    assert Asking(folder, None, 0.01).begin(user="Ana")["trial"] is None
    told = asking.begin(user="Ana")
    asking.answer(user="Ana", trial=told["trial"], valid=True, response_ms=-5e9)  # a clock that was set back
    assert min(asking.kept["Ana"].response_ms) == 0
    (folder.path / "asked" / "002.json").unlink()


def test_a_changed_folder_keeps_old_answers_apart(folder: Folder, tmp_path: Path):
    path = tmp_path / "table"
    shutil.copytree(folder.path, path)
    add_kind(path, "cup,blue.png,0.10\ntray,blue.png,0.95\n")
    changed = whole(path)
    (path / "asked" / "001.csv").write_text("trial,valid,response_ms\n0,True,900\n")
    assert asked.given(folder).kept == [] and asked.given(changed) == ([], 1)
    asking = Asking(changed, None, 10.0)
    assert asking.apart == 1 and asking.begin(user="Ana")["answered"] == 0 and (path / "asked" / "002.json").is_file()


def test_what_a_sitting_settles_is_said_beforehand_and_is_what_it_asks(folder: Folder):
    few, *_ = [line for line in outlook(folder, "table", 10.0) if line.startswith("Ana")]
    assert few == "Ana calls paths valid in 4 scenes: fewer than 7 make no effect certain"
    for minutes in (10.0, 60.0):  # a kind that changes nothing in 13 pairs is asked no more
        assert any("more than 22% of answers" in line for line in outlook(folder, "table", minutes))


def test_folders_that_leave_nothing_to_ask_are_refused(tmp_path: Path):
    folder = whole(path := make_folder(tmp_path / "table"))
    with pytest.raises(InputError, match="nothing to ask Ana: add cut-outs"):
        Asking(folder, None, 10.0).begin(user="Ana")
    with pytest.raises(InputError, match="there is nothing to ask Ana"):
        Designing(folder, None, 10.0).begin(user="Ana")
    with pytest.raises(InputError, match="no item was judged yet"):
        Placing(folder, None, 10.0)
    with pytest.raises(InputError, match="no user 'Bob'"):
        Asking(folder, "Bob", 10.0)
    for name in ("unchanged", "sticker", "extra"):
        with pytest.raises(InputError, match=f"kinds/{name}: .*another name"):
            Asking(replace(folder, cutouts={name: []}), None, 10.0)
    with pytest.raises(InputError, match="--minutes is 0"):
        main([str(path), "--minutes", "0"])
    (path / "asked").mkdir()
    (path / "asked" / "001.json").write_text("{")
    with pytest.raises(InputError, match=r"001\.json or 001\.csv in asked/ cannot be read"):
        Sitting.read(path / "asked" / "001.json")


@pytest.mark.parametrize(
    ("rows", "why"),
    [("0,FALSCH,9\n", "valid is 'FALSCH'"), ("999,True,9\n", "not of this sitting"), ("0,True,9\n" * 2, "two answers")],
)
def test_answers_that_somebody_edited_are_refused_before_a_model_is_fitted(folder: Folder, rows: str, why: str, capsys):
    (folder.path / "asked" / "001.csv").write_text("trial,valid,response_ms\n" + rows)
    with pytest.raises(InputError, match=rf"001\.json or 001\.csv in asked/ cannot be read .*{why}"):
        own(["check", str(folder.path)])


def test_what_a_system_lays_beside_the_pictures_changes_no_trial(folder: Folder):
    others = [folder.path / "scenes" / "Thumbs.db", folder.path / "kinds" / "cup" / "._blue.png"]
    before = asked.digest(folder.path)
    for file in others:
        file.write_bytes(b"x")
    assert asked.digest(folder.path) == before
    for file in others:
        file.unlink()


def test_the_report_sets_answers_beside_the_models_and_counts_what_was_accepted(folder: Folder, monkeypatch):
    monkeypatch.setitem(library.TRAINING["clearance"], "steps", 5)
    monkeypatch.setattr(fitting, "SHARES", (1.0,))
    asking = Asking(folder, "Ana", 10.0)
    answer(asking, 30, accepts=lambda trial: asking.kept["Ana"].plan["condition"][trial] != "cup")
    fitted = {"Ana": fitting.fit_user(fitting.UserData.of("Ana", folder))}
    placing = Placing(folder, "Ana", 10.0)
    told, photograph = placing.begin(user="Ana"), (folder.path / "scenes" / "tea.png").read_bytes()

    def take(picture: bytes) -> dict:
        return placing.take(user="Ana", trial=told["trial"], picture=f"data:;base64,{b64encode(picture).decode()}")

    with pytest.raises(InputError, match="photograph cannot be read"):
        take(b"no picture")
    small = cv2.imencode(".png", np.zeros((50, 50, 3), np.uint8))[1].tobytes()
    with pytest.raises(InputError, match=r"50 x 50 pixels: expected \d+ x \d+"):
        take(small)
    with pytest.raises(InputError, match="photograph the table first"):
        placing.answer(user="Ana", trial=told["trial"], valid=False, response_ms=900.0)
    assert "a real cup" in told["note"] and placing.begin(user="Ana") == told, "nothing was stored"
    composited = placing.image("001-real", told["trial"])
    shown = take(photograph)
    assert shown["trial"] == told["trial"] and "wanted" not in shown
    assert placing.image("001-real", told["trial"]) != composited
    placing.answer(user="Ana", trial=told["trial"], valid=False, response_ms=900.0)
    assert Placing(folder, "Ana", 10.0).begin(user="Ana")["answered"] == 1, "after a kill"
    made = asked.tables(folder, fitted, asked.given(folder).kept)
    assert made["asked_real"][["kind", "count", "share"]].to_numpy().tolist() == [["cup", 1, 1.0]]
    effects = made["asked_effects"].set_index("kind")
    assert effects["varied"].all()
    assert effects.loc["cup", "effect"] == -1 and effects.loc["sticker", "effect"] == 0
    assert -1 <= effects.loc["cup", "model_effect"] <= 1
    agreed = made["asked_agreement"].set_index("who")
    assert agreed.loc["self", "share"] == 1 and agreed.loc["ceiling", "share"] == 1
    repairs = made["asked_repairs"].set_index("role")
    assert repairs.loc["valid", "share"] == 1 and repairs.loc["valid", "ci_low"] < 1
    for answers in (5, 30):  # gives up after five; always yes
        (folder.path / "asked" / "001.csv").unlink()
        answer(Asking(folder, "Ana", 10.0), answers, accepts=lambda _: True)
        effects = asked.tables(folder, fitted, asked.given(folder).kept)["asked_effects"]
        assert (effects["verdict"] == "undecided").all() and not effects["varied"].any()


def test_design_asks_what_separates_the_rules_and_draws_it(folder: Folder, monkeypatch, capsys):
    monkeypatch.setitem(library.TRAINING["clearance"], "steps", 5)
    monkeypatch.setattr(designing, "PLACES", 40)
    asking = Designing(folder, "Ana", 10.0)
    told = asking.begin(user="Ana")
    assert "a cup" in told["note"] and told["note"] in capsys.readouterr().out
    drawn = cv2.imread(str(folder.path / "asked" / "001-design.png"))
    assert drawn is not None and drawn.tobytes() != asking.image("001-design", told["trial"])
    before = asking.rules("Ana").known()[1][0]
    near = asking.kept["Ana"].plan["clearance_m"]
    while told["trial"] is not None:
        told = asking.answer(user="Ana", trial=told["trial"], valid=bool(near[told["trial"]] > 0.03), response_ms=900.0)
    after = asking.rules("Ana").known()[1][0]
    assert after[3] > before[3] and "cup: keeps" in told["known"][1]
    assert Designing(folder, "Ana", 10.0).begin(user="Ana") == told, "after a kill"
    assert list(sittings(folder.path)) == [folder.path / "asked" / "001.json"], "design is no sitting of its own"
