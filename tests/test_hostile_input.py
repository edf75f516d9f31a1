"""Bad input of every kind at every door: each reader and command line answers with a sentence, and writes nothing."""

import io
import pickle
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from itertools import cycle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pipeline
from pipeline import library, params
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_arrays, write_table
from pipeline.own.__main__ import main as own
from pipeline.own.folder import read_folder
from pipeline.runtime.errors import InputError
from tests.own.folders import COLUMNS, change, make_folder

pytestmark = pytest.mark.slow
NASTY = [
    *("", "\0", "\x1b[31mred", "nan", "-1e400", "9" * 400, "=HYPERLINK(1)", "../../etc/passwd", "C:\\x", "x" * 300),
    *("<script>alert(1)</script>", "{{ 7 * 7 }}", "!!python/object/apply:os.system ['true']", "&a [*a]"),
    *("${oc.env:HOME}", "${", "ﬀ\u202e"),
]


def damaged(content: bytes) -> list[bytes]:
    """Nothing of a file, half of it, other bytes, and the whole file with a bit flipped or bytes in between."""
    middle, other = len(content) // 2, np.random.default_rng(0).bytes(100)
    flipped = content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :]
    return [b"", content[:middle], other, flipped, content[:middle] + other + content[middle:]]


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


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_folder(tmp_path_factory.mktemp("own") / "table")


def checked(whole: Path, spoil: Callable[[Path], object]) -> None:
    """A copy of the folder, spoilt, has no fault or is refused with sentences, and gains nothing but the sheet."""
    folder = whole.with_name("copy")
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(whole, folder)
    spoil(folder)
    before = tree(folder)
    code, said = command(own, ["check", str(folder)])
    assert code in (0, 1) and said and (code == 0) == ("no fault" in said)
    (folder / "check.png").unlink(missing_ok=True)
    assert "\x1b" not in said and tree(folder) == before


@pytest.mark.parametrize("file", ["scenes/tea.png", "demonstrations.csv"])
def test_a_damaged_file_of_a_person_s_folder(whole: Path, file: str):
    for content in damaged((whole / file).read_bytes()):
        checked(whole, lambda folder, content=content: (folder / file).write_bytes(content))


def test_a_nasty_cell_of_a_person_s_demonstrations(whole: Path):
    for row, (column, cell) in enumerate(zip(cycle(COLUMNS), NASTY, strict=False), 2):
        checked(whole, lambda folder, row=row, column=column, cell=cell: change(folder, row, column, cell))


def test_yaml_that_would_run_code_is_only_text(tmp_path: Path):
    folder = make_folder(tmp_path / "table")
    (folder / "table.yaml").write_text(f"side_m: !!python/object/apply:os.mkdir ['{tmp_path / 'made'}']\n")
    assert read_folder(folder)[1] and not (tmp_path / "made").exists()


def test_a_nasty_override_of_parameters():
    for override in ("n_demos=" + NASTY[5], "seeds=${", "~\x1b[31mred", "+<script>=1", "train.steps=nan"):
        code, said = command(params.main, ["--check", override])
        assert code in (1, 2) and said.startswith(("error: ", "note: ")), (override, said)


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
READERS |= {"model.safetensors": pipeline.load}


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_result_or_model_is_named(kept: Path, name: str):
    path = kept / f"damaged-{name}"
    for content in damaged((kept / name).read_bytes()):
        path.write_bytes(content)
        try:
            READERS[name](path)  # a flipped bit may be a valid number
        except InputError as error:
            assert str(path) in str(error)


def test_a_pickle_is_no_model_and_no_result_and_is_not_run(tmp_path: Path):
    class Bomb:
        def __reduce__(self):
            return Path.mkdir, (tmp_path / "made",)

    np.savez(tmp_path / "arrays.npz", x=np.array([Bomb()], dtype=object), allow_pickle=True)
    for name in ("model.safetensors", "table.parquet", "plain.npz"):
        (tmp_path / name).write_bytes(pickle.dumps(Bomb()))
    for name in ("model.safetensors", "table.parquet", "plain.npz", "arrays.npz"):
        with pytest.raises(InputError):
            READERS.get(name, read_arrays)(tmp_path / name)
    assert not (tmp_path / "made").exists()
