"""Read csv files that people write: as text, row by row, with sentences that name file and row."""

import csv
import unicodedata
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError

FIRST_ROW = 2  # the number of the first row below the header, as a spreadsheet counts


class Faults(list[str]):
    """Sentences that each name a file, what came, what was expected and what to do."""

    def rows(self, file: str, wrong: Array, sentence: Callable[[int], str], numbers: Array | None = None) -> bool:
        """Add one sentence for the first wrong row and the number of rows like it; return whether there is any.

        wrong: bool (row,); sentence: what is wrong with row i; numbers: of the rows in the file, by default from 2.
        """
        places = np.flatnonzero(wrong)
        if len(places):
            row = places[0] + FIRST_ROW if numbers is None else numbers[places[0]]
            more = f" ({len(places) - 1} more like it)" if len(places) > 1 else ""
            self.append(f"{file}, row {row}: {sentence(int(places[0]))}{more}")
        return bool(len(places))


def normal(name: str) -> str:
    """Return a name without spaces around it and with composed accents, as other computers may decompose them."""
    return unicodedata.normalize("NFC", name.strip())


def read_csv(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Return a csv as text, row by row, names normalised; InputError unless it is UTF-8 with these columns."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file, strict=True))
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name} is not UTF-8: save it as “CSV UTF-8”") from error
    except csv.Error as error:
        raise InputError(f"{path.name} cannot be read as csv ({error}): save it anew") from error
    if not rows or not any(rows[0]):
        raise InputError(f"{path.name} is empty: expected a header line with {', '.join(columns)}")
    numbered = {number: row for number, row in enumerate(rows[1:]) if any(row)}  # blank rows keep their numbers
    for number, row in numbered.items():
        if len(row) != len(rows[0]):
            raise InputError(
                f"{path.name}, row {number + FIRST_ROW}: has {len(row)} cells, the header {len(rows[0])}: correct it; "
                "texts with commas need quotes"
            )
    header = [normal(column).lower() for column in rows[0]]
    table = pd.DataFrame(list(numbered.values()), index=list(numbered), columns=header, dtype=str)
    missing = [column for column in columns if column not in header]
    if missing:
        semicolons = "; separate columns by commas" if any(";" in column for column in header) else ""
        raise InputError(
            f"{path.name} has the columns {', '.join(header)}: expected also {', '.join(missing)}{semicolons}"
        )
    if twice := [column for column in header if header.count(column) > 1]:
        raise InputError(f"{path.name} has two columns {twice[0]!r}: remove one")
    return table.map(normal)


def numbers(table: pd.DataFrame, columns: Sequence[str], file: str, faults: Faults) -> pd.DataFrame:
    """Return these columns as numbers; rows that hold none are NaN and named in `faults`."""
    made = table[list(columns)].apply(pd.to_numeric, errors="coerce").astype(float)
    made = made.where(np.isfinite(made))
    for column in columns:
        values = table[column].tolist()
        faults.rows(
            file,
            made[column].isna().to_numpy(),
            lambda i, column=column, values=values: (
                f"{column} is {values[i]!r}: expected a number with a decimal point"
            ),
            row_numbers(table),
        )
    return made


def check_names(table: pd.DataFrame, columns: Sequence[str], file: str, faults: Faults) -> None:
    """Add a fault for names that are empty or hold characters that cannot be printed."""
    for column in columns:
        values = table[column].tolist()
        wrong = np.array([not value or not value.isprintable() for value in values], bool)
        faults.rows(
            file,
            wrong,
            lambda i, column=column, values=values: (
                f"{column} is {values[i]!r}: expected a name of letters, digits and signs"
            ),
            row_numbers(table),
        )


def row_numbers(table: pd.DataFrame) -> Array:
    """Return the number of each row in its file."""
    return table.index.to_numpy() + FIRST_ROW
