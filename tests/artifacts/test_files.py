"""Artefacts are written whole, read back as they were, and refused with a reason when damaged."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import atomic_write, read_arrays, read_json, read_table, write_arrays, write_table
from pipeline.runtime.errors import InputError


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def half(temporary: Path) -> None:
        temporary.write_text("ne")
        raise RuntimeError("killed")

    with pytest.raises(RuntimeError):
        atomic_write(path, half)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


TABLE = pd.DataFrame({"seed": [0, 1], "p": [0.25, 0.5]})
ARRAYS = {"b": np.arange(6).reshape(2, 3), "a": np.array([0.5], dtype=np.float32)}


@pytest.mark.parametrize(
    ("name", "write", "content"),
    [("t.parquet", write_table, TABLE), ("t.csv", write_table, TABLE), ("a.npz", write_arrays, ARRAYS)],
)
def test_tables_and_arrays_come_back_and_their_bytes_repeat(tmp_path: Path, name: str, write, content):
    write(tmp_path / name, content)
    first = (tmp_path / name).read_bytes()
    write(tmp_path / name, content)
    assert (tmp_path / name).read_bytes() == first
    if write is write_table:
        return pd.testing.assert_frame_equal(read_table(tmp_path / name, ["seed", "p"]), content)
    back = read_arrays(tmp_path / name)
    assert list(back) == list(content) and [x.dtype for x in back.values()] == [x.dtype for x in content.values()]
    for array, read in zip(content.values(), back.values(), strict=True):
        np.testing.assert_array_equal(read, array)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("column", ["user", "first", "second", "source", "added", "change", "value", "top"])
def test_a_name_stays_a_name_whatever_it_and_its_column_are_called(tmp_path: Path, column: str, suffix: str):
    names = ["NA", "null", "nan", "inf", "True", "None", "1e5", "010", "a,b", 'say "x"', "مها"]
    others = {"p": [np.nan, *[0.5] * 10], "valid": [True, None, *[False] * 9]}
    write_table(tmp_path / f"t.{suffix}", pd.DataFrame({column: names} | others))
    back = read_table(tmp_path / f"t.{suffix}")
    assert back[column].tolist() == names and back["p"].isna().sum() == 1
    assert back["valid"].tolist()[2:] == [False] * 9


@pytest.mark.parametrize(("name", "read"), [("x.npz", read_arrays), ("x.parquet", read_table), ("x.json", read_json)])
def test_a_missing_or_truncated_file_says_what_to_do(tmp_path: Path, name: str, read):
    with pytest.raises(InputError, match=r"missing.*make repro"):
        read(tmp_path / name)
    (tmp_path / name).write_bytes(b"PK\x03\x04 half")
    with pytest.raises(InputError, match="again"):
        read(tmp_path / name)
