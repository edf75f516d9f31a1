"""Bad input of every kind, generated: each reader and command line answers with a sentence, and writes nothing.

Some 480 inputs. `pytest tests/test_hostile_input.py --hypothesis-show-statistics` counts them.
"""

import io
import json
import pickle
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps

import pipeline
from pipeline import library, params
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_arrays, write_table
from pipeline.audit.__main__ import main as audit
from pipeline.config.graph import ROOT
from pipeline.own.__main__ import main as own
from pipeline.own.folder import read_folder
from pipeline.report.page import environment
from pipeline.runtime.errors import InputError
from tests.own.folders import change, make_folder
from tests.own.recorder.factory import Served, recorder, samples
from tests.own.recorder.factory import make_folder as make_kitchen

pytestmark = pytest.mark.slow
MANY = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    derandomize=True,
)
SOME = settings(MANY, max_examples=15)

NASTY = st.sampled_from(
    [
        *("", " ", "\0", "\x1b[31mred", "nan", "inf", "-1e400", "9" * 400, "=HYPERLINK(1)", "@SUM(A1)", "+1", "-2+3"),
        *("../../etc/passwd", "/etc/passwd", "..", ".", "a/b", "a\\b", "C:\\x", "~", "$HOME", "%2e%2e", "x" * 300),
        *("<script>alert(1)</script>", "<img src=x onerror=alert(1)>", '"><svg onload=1>', "{{ 7 * 7 }}", "{% raw %}"),
        *(
            "!!python/object/apply:os.system ['true']",
            "&a [*a]",
            "${oc.env:HOME}",
            "${n_demos}",
            "${",
            "ﬀ",
            "\u202e",
            "é",
        ),
    ]
)
TEXT = NASTY | st.text(max_size=30)
NAMES = TEXT.map(lambda text: text.replace("\0", "").replace("/", "")[:60]).filter(
    lambda text: text not in ("", ".", "..")
)
YAML = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXT,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=12,
)


def damaged(content: bytes) -> st.SearchStrategy[bytes]:
    """Bytes of a whole file: cut short, with a bit flipped, with other bytes in between, or nothing of it."""
    place = st.integers(0, max(len(content) - 1, 0))
    flipped = st.builds(
        lambda i, bit: content[:i] + bytes([content[i] ^ 1 << bit]) + content[i + 1 :], place, st.integers(0, 7)
    )
    inserted = st.builds(lambda i, more: content[:i] + more + content[i:], place, st.binary(min_size=1, max_size=40))
    return place.map(lambda i: content[:i]) | flipped | inserted | st.binary(max_size=200)


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def command(main: Callable[[list[str]], int | None], arguments: list[str]) -> tuple[int, str]:
    """The exit code of a command line and what it says; a traceback would fail the test."""
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(said):
        try:
            code = main(arguments)
        except SystemExit as end:  # argparse
            code = end.code if isinstance(end.code, int) else 1
        except InputError as error:  # printed by the module's last lines
            code, _ = 2, said.write(f"error: {error}")
    return code or 0, said.getvalue()


# A person's own folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_folder(tmp_path_factory.mktemp("own") / "table")


@contextmanager
def copy_of(whole: Path) -> Iterator[Path]:
    copy = whole.with_name("copy")
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(whole, copy)
    yield copy


def checked(folder: Path) -> None:
    """A folder has no fault or is refused with sentences, and stays as it is."""
    before = tree(folder)
    code, said = command(own, ["check", str(folder)])
    assert code in (0, 1) and said and (code == 0) == ("no fault" in said)
    assert "\x1b" not in said and tree(folder) == before


@MANY
@given(data=st.data())
def test_a_damaged_file_of_a_person_s_folder(whole: Path, data: st.DataObject):
    with copy_of(whole) as folder:
        file = folder / data.draw(st.sampled_from(["scenes/tea.png", "demonstrations.csv"]))
        file.write_bytes(data.draw(damaged(file.read_bytes())))
        checked(folder)


@MANY
@given(row=st.integers(2, 380), column=st.sampled_from(["scene", "user", "demo", "t", "x", "y", "valid"]), cell=TEXT)
def test_a_nasty_cell_of_a_person_s_demonstrations(whole: Path, row: int, column: str, cell: str):
    with copy_of(whole) as folder:
        change(folder, row, column, cell)
        checked(folder)


@MANY
@given(content=st.dictionaries(st.sampled_from(["corners", "side_m", "start", "goal", "empty"]) | TEXT, YAML) | YAML)
def test_nasty_settings_of_a_person_s_folder(whole: Path, content: object):
    with copy_of(whole) as folder:
        (folder / "table.yaml").write_text(yaml.safe_dump(content))
        checked(folder)


@SOME
@given(text=TEXT | damaged(b"corners: [[1, 2], [3, 4]]\nside_m: 1.0\n").map(lambda b: b.decode("latin-1")))
def test_settings_that_are_no_yaml(whole: Path, text: str):
    with copy_of(whole) as folder:
        (folder / "table.yaml").write_text(text)
        checked(folder)


@SOME
@given(name=NAMES, file=st.sampled_from(["scenes/{}.png", "kinds/{}/cup.png", "kinds/cup/{}"]))
def test_a_nasty_name_in_a_person_s_folder(whole: Path, name: str, file: str):
    with copy_of(whole) as folder:
        path = folder / file.format(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes((folder / "scenes/tea.png").read_bytes())
        except (OSError, UnicodeError):
            return  # no name of a file
        checked(folder)


def test_names_with_html_are_escaped_in_every_page():
    template = environment([ROOT / "pipeline/report"]).from_string("{{ name }}")
    assert template.render(name="<script>") == "&lt;script&gt;"


def test_yaml_that_would_run_code_is_only_text(whole: Path, tmp_path: Path):
    with copy_of(whole) as folder:
        (folder / "table.yaml").write_text(f"side_m: !!python/object/apply:os.mkdir ['{tmp_path / 'made'}']\n")
        assert read_folder(folder)[1] and not (tmp_path / "made").exists()


# The recorder


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, Path]]:
    folder = make_kitchen(tmp_path_factory.mktemp("recorder"))
    with recorder(folder) as opened:
        yield opened, folder


VALUE = YAML | st.just(samples().tolist()) | st.sampled_from(["first", "Zoë", True])
BODIES = st.fixed_dictionaries(
    {"scene": VALUE, "user": VALUE, "valid": VALUE, "samples": VALUE}
) | st.fixed_dictionaries({"scene": VALUE, "kind": VALUE, "points": VALUE})


@MANY
@given(
    body=BODIES.map(json.dumps).map(str.encode) | st.binary(max_size=100),
    to=st.sampled_from(["paths", "items", "table"]),
)
def test_what_no_page_sends_to_the_recorder(served: tuple[Served, Path], body: bytes, to: str):
    server, folder = served
    before = tree(folder)
    status, answer = server.ask("POST", f"/api/{to}", body)
    assert status in (400, 404, 405, 413, 422) and answer.get("error", "x"), (status, body)
    assert tree(folder) == before


@MANY
@given(data=st.data(), name=NAMES)
def test_a_damaged_picture_sent_to_the_recorder(served: tuple[Served, Path], data: st.DataObject, name: str):
    from urllib.parse import quote

    server, folder = served
    before = tree(folder)
    body = data.draw(damaged((folder / "scenes/first.png").read_bytes()))
    status, answer = server.ask("POST", f"/api/pictures?name={quote(name, errors='replace')}", body)
    after = tree(folder)
    assert status in (201, 400, 404, 413) and set(before) <= set(after), (status, answer)
    for made in set(after) - set(before):  # a flipped bit may leave a picture whole
        assert status == 201 and Path(made).parent == Path("scenes")
        (folder / made).unlink()


# Command lines


@SOME
@given(
    words=st.lists(NASTY | st.sampled_from(["--format", "--out", "--nothing", "-h", "HEAD~99999", "a..b"]), max_size=3)
)
def test_a_nasty_command_line_of_the_audit(words: list[str]):
    revisions = [word for word in words if "\0" not in word]
    if not revisions:
        return
    code, said = command(audit, revisions)
    assert code in (0, 2) and said


KEYS = st.sampled_from(["n_demos", "seeds", "users", "users.careful", "train", "train.steps", "variants", "paths.data"])


@SOME
@given(key=KEYS | TEXT, mark=st.sampled_from(["", "+", "~", "++"]), value=TEXT | YAML.map(str))
def test_a_nasty_override_of_parameters(key: str, mark: str, value: str):
    code, said = command(params.main, ["--check", f"{mark}{key}={value}"])
    assert code in (0, 1, 2) and (code == 0 or said.startswith("error: ") or said.startswith("note: ")), said


# Files of results and models


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    frame = pd.DataFrame({"run": ["a", "b"], "sha256": ["0", "1"], "accuracy": [0.5, 0.6]})
    for name in ("table.csv", "table.parquet"):
        write_table(folder / name, frame)
    write_arrays(folder / "arrays.npz", {"x": np.arange(6.0)})
    (folder / "object.json").write_text('{"a": [1, 2, {"b": null}]}')
    model = library.build({"kind": "vae", "model": library.VAE}, 0)
    model.settings = {"kind": "vae", "model": dict(library.VAE), "variant": "full"}
    pipeline.save(model, folder / "model.safetensors")
    return folder


READERS = {"table.csv": read_table, "table.parquet": read_table, "arrays.npz": read_arrays, "object.json": read_json}


@settings(MANY, max_examples=80)
@given(data=st.data(), name=st.sampled_from(list(READERS)))
def test_a_damaged_result(kept: Path, data: st.DataObject, name: str):
    path = kept / f"damaged-{name}"
    path.write_bytes(data.draw(damaged((kept / name).read_bytes())))
    try:
        READERS[name](path)
    except InputError as error:
        assert str(path) in str(error)


@MANY
@given(data=st.data())
def test_a_damaged_model(kept: Path, data: st.DataObject):
    path = kept / "damaged.safetensors"
    path.write_bytes(data.draw(damaged((kept / "model.safetensors").read_bytes())))
    try:
        assert isinstance(pipeline.load(path), library.ValidityModel)  # a flipped bit may be a valid weight
    except InputError as error:
        assert str(error)


@MANY
@given(content=YAML)
def test_a_model_with_nasty_settings(kept: Path, content: object):
    from safetensors.torch import load_file, save_file

    path = kept / "nasty.safetensors"
    save_file(load_file(kept / "model.safetensors"), path, {"settings": json.dumps(content)})
    with pytest.raises(InputError):
        pipeline.load(path)


def test_a_pickle_is_no_model_and_no_result_and_is_not_run(tmp_path: Path):
    class Bomb:
        def __reduce__(self):
            return Path.mkdir, (tmp_path / "made",)

    content = pickle.dumps(Bomb())
    np.savez(tmp_path / "arrays.npz", x=np.array([Bomb()], dtype=object), allow_pickle=True)
    for name in ("model.safetensors", "table.parquet", "plain.npz"):
        (tmp_path / name).write_bytes(content)
    for read, name in ((pipeline.load, "model.safetensors"), (read_table, "table.parquet"), (read_arrays, "plain.npz")):
        with pytest.raises(InputError):
            read(tmp_path / name)
    with pytest.raises(InputError):
        read_arrays(tmp_path / "arrays.npz")
    assert not (tmp_path / "made").exists()


# The library

ARRAYS = nps.arrays(
    st.sampled_from([np.uint8, np.float64, np.float32, np.bool_, np.int64, np.complex128]),
    st.sampled_from(
        [(), (0,), (2, 100, 100, 3), (3, 100, 100, 3), (2, 99, 100, 3), (2, 4, 2), (3, 0, 2), (2, 4), (2, 4, 3)]
    ),
    fill=st.just(1),
)


@MANY
@given(images=ARRAYS, z_theta=ARRAYS, valid=ARRAYS, variant=st.sampled_from(["clearance", "full"]) | TEXT)
def test_nasty_arguments_of_the_library(images: np.ndarray, z_theta: np.ndarray, valid: np.ndarray, variant: str):
    model = library.build({"kind": "vae", "model": library.VAE}, 0)
    calls: list[Callable[[], object]] = [
        lambda: pipeline.fit(images, z_theta, valid, variant=variant),
        lambda: pipeline.repair(model, images, z_theta),
        lambda: pipeline.effect(model, images, images, z_theta),
    ]
    for call in calls:
        with pytest.raises(InputError):
            call()
