"""The report holds everything in itself, is the same twice, and is never written from half the results."""

import base64
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig, OmegaConf
from PIL import Image

from pipeline.artifacts.files import read_arrays, read_json, read_table, write_arrays, write_json, write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import load_model
from pipeline.errors import InputError
from pipeline.report.page import LARGEST
from pipeline.report.style import LETTER
from pipeline.report.terminal import shown
from pipeline.stages.report import main
from pipeline.table.bezier import lattice
from tests.report_artefacts import write_all
from tests.stages.facts import listed


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    return write_all(tmp_path_factory.mktemp("artefacts"))


@pytest.fixture(scope="module")
def reports(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports")
    main(cfg, folder)
    return folder


def test_a_second_run_writes_the_same_bytes(cfg: DictConfig, reports: Path, tmp_path: Path):
    main(listed(cfg, "report"), tmp_path)
    files = sorted(p.relative_to(reports) for p in reports.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file())
    assert [f for f in files if (reports / f).read_bytes() != (tmp_path / f).read_bytes()] == []


def test_the_page_needs_nothing_else(reports: Path):
    page = (reports / "index.html").read_text(encoding="utf-8")
    assert len(page.encode()) < LARGEST
    fetched = re.findall(r'(?:src|href)="([^"]*)"', page)
    outside = {x for x in fetched if not x.startswith(("#", "data:"))}
    assert outside == {"metrics.json"}, "a link to the numbers is all that leaves the page"
    assert "@import" not in page and "import(" not in page and "<script src" not in page


def test_the_page_shows_pictures_of_the_present_recordings_alone(cfg: DictConfig, reports: Path):
    page = (reports / "index.html").read_text(encoding="utf-8")
    ((source, width, height, alt),) = re.findall(
        r'<img src="data:image/webp;base64,([^"]*)" width="(\d+)" height="(\d+)" alt="([^"]*)">', page
    )
    with Image.open(io.BytesIO(base64.b64decode(source))) as image:
        assert image.size == (int(width), int(height)) == (64, 36)
        assert (np.asarray(image.convert("RGB")) == (0, 128, 128)).all(), "teal, without loss"
    assert "overview" in alt and "the path model 50.0" in alt
    assert "make pictures" not in page


def test_a_picture_of_a_recording_that_is_no_png_is_named(cfg: DictConfig, tmp_path: Path):
    (tmp_path / "overview.png").write_text("not one")
    other = OmegaConf.merge(cfg, {"paths": {"pictures": str(tmp_path)}})
    assert isinstance(other, DictConfig)
    with pytest.raises(InputError, match=r"overview\.png is not a picture of a recording .*make pictures"):
        main(other, tmp_path / "reports")
    assert not (tmp_path / "reports").exists()


def test_every_letter_is_outlined_once(reports: Path):
    page = (reports / "index.html").read_text(encoding="utf-8")
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert {name for name in re.findall(r'href="#([^"]*)"', page) if name.startswith(LETTER)} <= set(ids)


def test_figures_agree_on_the_outlines_of_their_letters(reports: Path):
    found: dict[str, set[str]] = {}
    for path in (reports / "figures").glob("*.svg"):
        for name, outline in re.findall(rf'<path id="({LETTER}[^"]*)" ([^>]*)/>', path.read_text()):
            found.setdefault(name, set()).add(outline)
    assert len(found) > 50 and all(len(outlines) == 1 for outlines in found.values())


def test_the_panel_shows_what_the_models_say_of_the_first_scenes(cfg: DictConfig, reports: Path):
    page = (reports / "index.html").read_text(encoding="utf-8")
    data = json.loads(re.findall(r'<script type="application/json" id="panel-data">(.*?)</script>', page)[0])
    scenes = read_scenes(Path(cfg.paths.scenes))
    assert [user["name"] for user in data["users"]] == ["careful", "normal"], "to the aggressive user all is valid"
    z = lattice(data["side"])[None]
    for split, pool in zip(data["splits"], ("train-s0", "new_scenes", "new_items"), strict=True):
        assert [scene["label"].split(",")[0] for scene in split["scenes"]][:2] == ["Scene 1", "Scene 2"]
        further = 4 * (pool == "new_items")
        assert {len(scene["tables"]) for scene in split["scenes"]} == {1 + further}
        assert {len(scene["repairs"]) for scene in split["scenes"]} == {2 if further else 0}
        for u, user in enumerate(("careful", "normal")):
            for v, variant in enumerate(cfg.variants):
                model = load_model(cfg, variant, user, 0, cfg.study_n)
                shown = base64.b64decode(split["scenes"][1]["tables"][0]["maps"][u][v])
                believed = model.probability(scenes.images[pool][1:2], z)[0]
                np.testing.assert_allclose(np.frombuffer(shown, np.uint8) / 255, believed, atol=0.5 / 255 + 1e-5)


def test_the_page_is_well_formed_and_its_ids_are_unique(reports: Path):
    outline = Outline()
    outline.feed((reports / "index.html").read_text(encoding="utf-8"))
    assert outline.open == []
    assert len(outline.ids) == len(set(outline.ids))
    assert outline.levels[0] == 1 and outline.levels.count(1) == 1
    assert all(after <= before + 1 for before, after in zip(outline.levels, outline.levels[1:], strict=False))
    assert outline.unnamed == 0, "every picture has a text for those who cannot see it"
    assert outline.tables == outline.captions > 5


def test_pictures_without_text_alternatives_would_be_noticed():
    outline = Outline()
    outline.feed('<div role="img"></div>')
    assert outline.unnamed == 1


def test_the_numbers_keep_their_names(cfg: DictConfig, reports: Path):
    metrics = json.loads((reports / "metrics.json").read_text())
    assert metrics["world"]["p_valid"]["careful"]["none"] == {"truth": 0.44, "paper": 0.43, "difference": 0.01}
    assert set(metrics["accuracy"]["full"]["new_items"]["n9"]) == {"mean", "q1", "q3", "seeds"}
    assert set(metrics["calibration"]["full"]["new_items"]) == {"ece", "brier", "bias"}
    assert {"success", "displacement_m", "displacement_ratio", "fooled", "abstained", "null_constant"} <= set(
        metrics["repair"]["full"]["careful"]
    )
    assert {
        "baseline",
        "intervened",
        "effect",
        "ci_low",
        "ci_high",
        "p_holm",
        "truth",
        "verdict",
        "truth_verdict",
    } <= set(metrics["interventions"]["full"]["normal"]["glass"])
    assert set(metrics["accuracy_all_users"]) == {*cfg.variants, "null_nearest", "null_position"}


def test_every_table_comes_in_three_forms_and_the_terminal_shows_two(reports: Path):
    names = {p.stem for p in (reports / "tables").iterdir()}
    assert {"claims", "backprop", "interventions", "accuracy", "comparisons"} <= names
    assert {p.name for p in (reports / "tables").iterdir()} == {f"{n}.{x}" for n in names for x in ("csv", "md", "tex")}
    text = shown(reports)
    assert "Success of repairing" in text and "No intervention" in text and str(reports / "index.html") in text


def test_every_figure_is_there_for_a_page_and_for_a_paper(reports: Path):
    names = {form: {p.stem for p in (reports / "figures").glob(f"*.{form}")} for form in ("svg", "pdf")}
    assert names["pdf"] == names["svg"] | {"overview"} and "accuracy" in names["svg"]
    assert all(p.read_bytes().startswith(b"%PDF") for p in (reports / "figures").glob("*.pdf"))


def test_the_terminal_says_when_there_is_no_report(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="run `make repro`"):
        shown(tmp_path)


@pytest.mark.parametrize(
    ("file", "drop"),
    [
        ("evaluate/accuracy.parquet", {"variant": "irl_ranked"}),
        ("evaluate/accuracy.parquet", {"seed": 1}),
        ("evaluate/accuracy.parquet", {"user": "normal", "split": "new_items"}),
        ("repair/repairs.parquet", {"method": "null_constant"}),
        ("repair/repairs.parquet", {"seed": 0, "user": "careful"}),
        ("intervene/effects.parquet", {"variant": "full", "user": "aggressive"}),
        ("train/ae/curves.parquet", {"seed": 1}),
    ],
)
def test_a_gap_in_the_results_is_named_and_nothing_is_written(cfg: DictConfig, tmp_path: Path, file: str, drop: dict):
    path = Path(cfg.paths.evaluate).parent / file
    whole = read_table(path)
    gone = (whole[list(drop)] == list(drop.values())).all(axis=1)
    write_table(path, whole[~gone])
    try:
        with pytest.raises(InputError, match="the report lacks") as error:
            main(cfg, tmp_path)
    finally:
        write_table(path, whole)
    named = [str(value) for name, value in drop.items() if name != "split"]
    assert all(value in str(error.value) for value in named)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_and_a_missing_cell_are_named(cfg: DictConfig, tmp_path: Path):
    path = Path(cfg.paths.intervene) / "metrics.json"
    whole = read_json(path)
    lacking = json.loads(json.dumps(whole))
    del lacking["interventions"]["ae"]["normal"]["glass"]
    write_json(path, lacking)
    with pytest.raises(InputError, match=r"interventions of ae for user normal with \['glass'\]"):
        main(cfg, tmp_path)
    path.unlink()
    with pytest.raises(InputError, match=r"metrics\.json is missing"):
        main(cfg, tmp_path)
    write_json(path, whole)


def test_paths_that_do_not_fit_their_rows_are_refused(cfg: DictConfig, tmp_path: Path):
    path = Path(cfg.paths.repair) / "paths.npz"
    whole = read_arrays(path)
    write_arrays(path, whole | {"full-careful-s0": whole["full-careful-s0"][:-1]})
    with pytest.raises(InputError, match="repairs of full-careful-s0"):
        main(cfg, tmp_path)
    write_arrays(path, whole)


class Outline(HTMLParser):
    """What a screen reader goes by: headings, ids, pictures' names, captions."""

    VOID = frozenset({"meta", "link", "br", "input", "img"})

    def __init__(self):
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.levels: list[int] = []
        self.unnamed = self.tables = self.captions = 0

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if re.fullmatch("h[1-6]", tag):
            self.levels.append(int(tag[1]))
        self.unnamed += attributes.get("role") == "img" and not attributes.keys() & {"aria-label", "aria-labelledby"}
        self.unnamed += tag == "img" and not attributes.get("alt")
        self.tables += tag == "table"
        self.captions += tag == "caption"

    def handle_startendtag(self, tag, attrs):
        self.ids += [value or "" for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
