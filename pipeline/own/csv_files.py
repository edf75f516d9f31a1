"""Read csv files that people write: row by row, with sentences that name file and row."""

import csv
import unicodedata
from collections.abc import Collection, Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.runtime.errors import InputError

DEMONSTRATIONS, ITEMS, CUTOUTS = "demonstrations.csv", "items.csv", "kinds.csv"
COLUMNS = {
    DEMONSTRATIONS: ["scene", "user", "demo", "t", "x", "y", "valid"],
    ITEMS: ["scene", "kind", "x", "y", "angle_deg", "radius_m", "half_length_m"],
    CUTOUTS: ["kind", "file", "width_m"],
}
KEY = ["scene", "user", "demo"]  # of a demonstration
WORDS = {*KEY, "kind", "file", "valid"}  # columns that hold names, or a word; the others hold numbers
FIRST_ROW = 2  # the number of the first row below the header, as a spreadsheet counts


class Faults(list[str]):
    """Sentences that each name a file, what came, what was expected and what to do."""

    def rows(self, file: str, wrong: pd.DataFrame, sentence: str, **values: object) -> None:
        """Add a sentence for the first of these wrong rows, and the number of rows like it.

        wrong: numbered as in the file, as by `read_csv`; sentence: its fields are columns of `wrong`, or `values`.
        """
        if len(wrong):
            more = f" ({len(wrong) - 1} more like it)" if len(wrong) > 1 else ""
            self.append(f"{file}, row {wrong.index[0]}: {sentence.format(**wrong.iloc[0], **values)}{more}")

    def cells(self, file: str, wrong: pd.Series, expected: str) -> None:
        """Add a sentence for the first of these wrong cells of a column."""
        self.rows(file, wrong.to_frame("cell"), "{column} is {cell!r}: expected " + expected, column=wrong.name)


def normal(name: str) -> str:
    """Return a name without spaces around it and with composed accents, as other computers may decompose them."""
    return unicodedata.normalize("NFC", name.strip())


def read_csv(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Return a csv as text, names normalised, rows numbered as in the file.

    Semicolons or tabs may separate the columns; numbers may then have decimal commas, which become points. Raise
    InputError unless it is UTF-8 with these columns.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        if text.lower().startswith("sep="):  # a line for Excel alone
            text = text.partition("\n")[2]
        separator = max(",;\t", key=text.partition("\n")[0].count)
        header, *rows = list(csv.reader(StringIO(text), delimiter=separator, strict=True)) or [[]]
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name} is not UTF-8: save it as “CSV UTF-8”") from error
    except csv.Error as error:
        raise InputError(f"{path.name} cannot be read as csv ({error}): save it anew") from error
    if not any(header):
        raise InputError(f"{path.name} is empty: expected a header line with {', '.join(columns)}")
    numbered = {number: row for number, row in enumerate(rows, FIRST_ROW) if any(row)}
    for number, row in numbered.items():
        if len(row) != len(header):
            raise InputError(
                f"{path.name}, row {number}: has {len(row)} cells, the header {len(header)}: correct it; "
                "texts with commas need quotes"
            )
    header = [normal(column).lower() for column in header]
    if missing := [column for column in columns if column not in header]:
        raise InputError(f"{path.name} has the columns {', '.join(header)}: expected also {', '.join(missing)}")
    if twice := [column for column in header if header.count(column) > 1]:
        raise InputError(f"{path.name} has two columns {twice[0]!r}: remove one")
    table = pd.DataFrame(list(numbered.values()), index=list(numbered), columns=header, dtype=str).map(normal)
    if separator != ",":
        numbers = [column for column in columns if column not in WORDS]
        table[numbers] = table[numbers].replace(",", ".", regex=True)
    return table


def read_checked(path: Path, scenes: Collection[str] | None, faults: Faults) -> pd.DataFrame | None:
    """Return the COLUMNS of a file of this name, numbers as such, or None if it cannot be read.

    Add a fault for names that cannot be printed, scenes other than `scenes` if there are any, words other than true and
    false, and cells that hold no number: they become NaN.
    """
    file, columns = path.name, COLUMNS[path.name]
    try:
        table = read_csv(path, columns)[columns]
    except InputError as error:
        faults.append(str(error))
        return None
    if scenes is not None:
        unknown = table[~table["scene"].isin(list(scenes))]
        faults.rows(file, unknown, "scene {scene!r} has no picture in scenes/: add it, or correct the name")
    for column in columns:
        cells = table[column]
        if column == "valid":
            faults.cells(file, cells[~cells.str.lower().isin(["true", "false"])], "true or false")
        elif column in WORDS:
            printable = cells.map(lambda name: bool(name) and name.isprintable()).astype(bool)
            faults.cells(file, cells[~printable], "a name of letters, digits and signs")
        else:
            numbers = pd.to_numeric(cells, errors="coerce").astype(float)
            table[column] = numbers.where(np.isfinite(numbers))
            faults.cells(file, cells[table[column].isna()], "a number with a decimal point")
    return table
