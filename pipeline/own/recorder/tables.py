"""Read and replace the csv files of a folder; values that a person wrote by hand stay as they are."""

import csv
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write


@dataclass
class Table:
    """The columns and rows of a csv file, every value as its text."""

    columns: list[str]
    rows: list[dict[str, str]]


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Return a csv file, or an empty table of `columns` if there is none.

    Raise InputError if a column is missing or a row has another number of cells.
    """
    if not path.exists():
        return Table(list(columns), [])
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restval=None)
            rows = []
            for row in reader:
                if None in row or None in row.values():
                    raise InputError(f"{path.name}, line {reader.line_num}: not one value for each column; correct it")
                rows.append(row)
            header = list(reader.fieldnames or columns)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path.name} is not a csv file in UTF-8 ({error}): save it as one, or move it away"
        ) from error
    if missing := [column for column in columns if column not in header]:
        raise InputError(f"{path.name} has no column {', '.join(missing)}: expected {', '.join(columns)}")
    return Table(header, rows)


def write_table(path: Path, table: Table) -> None:
    """Replace a csv file by this table, completely or not at all."""

    def write(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, table.columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(table.rows)

    write_durably(path, write)


def write_durably(path: Path, write: Callable[[Path], object]) -> None:
    """Replace a file atomically, and return only once it would survive a power cut."""

    def write_and_sync(temporary: Path) -> None:
        write(temporary)
        _sync(temporary)

    atomic_write(path, write_and_sync)
    _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
