"""A folder gives a report: the numbers are in it, names are harmless, an interrupted run goes on."""

import html
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import ruamel.yaml
import yaml

from pipeline import library
from pipeline.own import fitting
from pipeline.own.__main__ import main
from pipeline.own.export import yaml_text
from pipeline.own.frame import Frame
from pipeline.own.recorder.asking import Asking
from pipeline.own.report import on_the_table
from pipeline.runtime.places import ROOT
from tests.own import folders
from tests.own.folders import USERS, add_kind, answer, edit, make_folder, whole

EXAMPLE = ROOT / "examples" / "table"
HOSTILE = {"Ana": '<script>alert("x")</script>', "Jürgen": "=HYPERLINK(1)$_{2}"}


def fewer_steps(patch: pytest.MonkeyPatch, steps: int) -> None:
    patch.setitem(library.TRAINING["clearance"], "steps", steps)
    patch.setattr(fitting, "WORKERS", 1)  # other processes would not know


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the example folder, after a tenth of the training."""
    folder = tmp_path_factory.mktemp("own") / "table"
    shutil.copytree(EXAMPLE, folder, ignore=shutil.ignore_patterns("report", ".*"))
    with pytest.MonkeyPatch.context() as patch:
        fewer_steps(patch, 100)
        assert main([str(folder)]) == 0
    return folder / "report"


def table(report: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(report / "tables" / f"{name}.parquet")


@pytest.mark.slow
def test_the_report_of_the_example_says_what_its_users_do(example: Path):
    """Ana keeps away from everything, Jürgen from glasses; nobody needs to be certain of the rest."""
    scores = table(example, "scores").query("share == 1").set_index(["user", "predictor"])
    page, metrics = (example / "index.html").read_text(), json.loads((example / "metrics.json").read_text())
    text = re.sub(r"<[^>]+>", "", page)
    for user in USERS:
        model, blind = (scores.loc[(user, name)] for name in ("clearance", "position_only"))
        assert model.accuracy > 0.8 and model.accuracy > blind.accuracy + 0.15
        assert model.ci_low < model.accuracy < model.ci_high and model.demonstrations == 96
        assert f"{100 * metrics['users'][user]['accuracy']:.0f}\u00a0% right" in text
    verdicts = table(example, "interventions").set_index(["user", "kind"])["verdict"]
    assert (verdicts["Ana"] == "effect").all() and verdicts["Jürgen", "glass"] == "effect"
    assert (verdicts["Jürgen"].drop("glass") != "effect").all()
    parts = table(example, "by_detector").set_index(["user", "kind", "part"])["effect"]
    assert parts["Jürgen", "glass", "rule"] < -0.05 and abs(parts["Jürgen", "glass", "detection"]) < 0.03
    distances = table(example, "distances").set_index(["user", "kind"])["radius_m"]
    assert distances["Jürgen", "glass"] == pytest.approx(0.042, abs=0.015)
    assert (metrics["scenes"], metrics["demonstrations"], metrics["recall"]) == (14, 192, 1.0)
    assert "The detector alone would find 100\u00a0% of these 34 items" in text
    assert list(table(example, "disagreement").query("not shown")["scene"].unique()) != []
    assert "Accuracy" in pd.read_csv(example / "tables" / "learning.csv"), "the csv below a table is that table"
    links = set(re.findall(r'(?:src|href|data)="([^"#:]+)"', page))
    assert links and all((example / link).is_file() for link in links)


@pytest.mark.parametrize("name", ["1e5", "010", "null", "y", "2024-01-01", "a: b", "مها", 'say "x\\"', "0o17", "🙂"])
def test_readers_of_both_yaml_versions_see_the_names_that_a_person_gave(name: str):
    known = {name: {"verdict": "effect"}, "never_tested": [name]}
    assert yaml.safe_load(yaml_text(known)) == ruamel.yaml.YAML(typ="safe").load(yaml_text(known)) == known


@pytest.mark.slow
def test_what_planners_read_says_what_the_report_says(example: Path):
    users = yaml.safe_load((example / "specification.yaml").read_text())["users"]
    kept = table(example, "distances").set_index(["user", "kind"])["radius_m"]
    said = users["Jürgen"]["kinds"]["glass"]
    assert said["verdict"] == "effect"
    assert said["keep_away"]["radius_m"] == pytest.approx(kept["Jürgen", "glass"], abs=1e-4)
    assert "keep_away" not in users["Jürgen"]["kinds"]["bowl"]
    for number, user in enumerate(USERS, 1):
        told = yaml.safe_load((example / "keep_out" / f"user_{number}-scene_1.yaml").read_text())
        mask = cv2.imread(str(example / "keep_out" / told["image"]), cv2.IMREAD_UNCHANGED)
        assert mask is not None and mask.shape == (50, 50) and set(np.unique(mask)) == {0, 254}, user
        assert told["resolution"] * 50 == pytest.approx(1.0)


@pytest.mark.slow
def test_repaired_paths_come_back_from_the_bag(example: Path):
    reader = pytest.importorskip("rosbags.highlevel")
    paths = table(example, "repaired_paths")
    with reader.AnyReader([example / "repaired"]) as bag:
        read = [bag.deserialize(raw, connection.msgtype) for connection, _, raw in bag.messages()]
    assert len(read) == len(paths.drop_duplicates(["user", "scene", "demo"]))
    rows = table(example, "repaired")
    for message in read:
        row = rows.iloc[message.header.stamp.sec - 2]
        own = paths[(paths["user"] == row.user) & (paths["scene"] == row.scene) & (paths["demo"] == row.demo)]
        places = [[p.pose.position.x, p.pose.position.y] for p in message.poses]
        np.testing.assert_allclose(places, own[["x", "y"]])


def test_control_points_are_written_in_metres_on_the_table():
    points = pd.DataFrame([[0.5, 1.0, 0.1]], columns=["c0_x", "c0_y", "residual_m"])
    np.testing.assert_allclose(on_the_table(points, Frame((0.8, 0.4))), [[0.4, 0.8, 0.1]])


@pytest.mark.slow
def test_the_example_folder_is_what_its_script_writes(tmp_path: Path):
    into = f"from pathlib import Path; make_table.OUT = Path({str(tmp_path)!r})"
    code = f"from examples import make_table; {into}; make_table.main()"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
    listed = subprocess.run(["git", "ls-files", "."], cwd=EXAMPLE, capture_output=True, text=True, check=True)
    files = [name for name in listed.stdout.splitlines() if not name.startswith("report/")]
    assert [name for name in files if (tmp_path / name).read_bytes() != (EXAMPLE / name).read_bytes()] == []


@pytest.mark.slow
def test_names_are_harmless_and_what_a_folder_cannot_tell_is_left_out_and_said(tmp_path: Path, monkeypatch):
    folder = make_folder(tmp_path / "<b>&table")
    edit(folder, lambda table: table.assign(user=table["user"].map(HOSTILE)))
    fewer_steps(monkeypatch, 20)
    assert main([str(folder)]) == 0
    page = (folder / "report" / "index.html").read_text()
    assert "<script>" not in page and "&lt;script&gt;" in page and "<b>&table" not in page
    for file in (folder / "report" / "tables").glob("*.csv"):
        cells = pd.read_csv(file, dtype=str, keep_default_na=False).to_numpy().ravel()
        assert not [cell for cell in cells if cell.startswith(("=", "@"))], file
    assert "'=HYPERLINK" in (folder / "report" / "tables" / "scores.csv").read_text()
    assert "Nobody outlined any item" in page and "There are no cut-outs in kinds/" in page
    assert not (folder / "report" / "tables" / "interventions.csv").exists()


@pytest.mark.slow
def test_the_page_says_what_people_answered_who_quit_early_or_have_odd_names(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(folders, "SCENES", tuple("abcdefgh"))
    path = make_folder(tmp_path / "table")
    edit(path, lambda table: table.assign(user=table["user"].map({"Ana": "NA", "Jürgen": '🦊 "J"'})))
    add_kind(path, "nan,blue.png,0.12\n")
    (path / "kinds" / "cup").rename(path / "kinds" / "nan")
    asking = Asking(whole(path), None, 10.0)
    answer(asking, 1, "NA")
    asking.begin(user='🦊 "J"')
    added = asking.kept['🦊 "J"'].plan["condition"] != "unchanged"
    answer(asking, 36, '🦊 "J"', accepts=lambda trial: not added[trial])
    fewer_steps(monkeypatch, 20)
    assert main([str(path)]) == 0
    page = html.unescape(re.sub(r"<[^>]+>", "", (path / "report" / "index.html").read_text()))
    assert "NA. All answers are the same, so they cannot tell whether anything matters. The model predicts" in page
    sticker = r"Reacts to a flat sticker, too: .* 13 to 27 pairs"
    assert re.search(r'🦊 "J"\. Open: nan \([−+\d.]+ in \d+ pairs\)\. ' + sticker, page)
    assert "Figures write “user 2” for 🦊" in page and "has judged no repair" in page
    effects = table(path / "report", "asked_effects")
    assert effects["kind"].isin(["nan", "sticker"]).all()
    drawn = (path / "report" / "figures" / "asked-compared.svg").read_text()
    assert all(f"<!-- {verdict} -->" in drawn for verdict in effects["verdict"].dropna())
    assert "user 2: your model predicts" in drawn and "the best possible" in drawn
