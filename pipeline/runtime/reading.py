"""Read csv files whose names stay text."""

from collections.abc import Collection
from io import StringIO
from pathlib import Path

import pandas as pd
from pandas.api.types import infer_dtype


def read_csv(path: Path, text: Collection[str]) -> pd.DataFrame:
    """Return the csv (UTF-8) at `path`; columns in `text`, and all of words, are text, and only empty cells missing.

    pandas alone would read a user called NA as missing, one called inf as a number and one called True as a truth
    value. Raises OSError, or ValueError for bytes that are no UTF-8 or no csv.
    """
    return parse_csv(path.read_text(encoding="utf-8"), text)


def parse_csv(content: str, text: Collection[str]) -> pd.DataFrame:
    """Return the table of a csv's `content`, as `read_csv` does."""
    table = pd.read_csv(StringIO(content))
    names = {name for name in table if name in text or infer_dtype(table[name], skipna=True) == "string"}
    strings = {"dtype": str, "keep_default_na": False, "na_values": [""]}
    columns = pd.read_csv(StringIO(content), usecols=lambda name: name in names, **strings)
    return table.assign(**{str(name): column for name, column in columns.items()})
