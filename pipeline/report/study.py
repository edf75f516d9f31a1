"""The data of a study's page: its tables and arrays by file name, its settings, and what it shares with the paper."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.report.page import Source
from pipeline.report.tables import check_finite, checked, lookup, named
from pipeline.runtime.errors import InputError
from pipeline.world.rules import Margins


@dataclass(frozen=True)
class Study:
    """The results of one study, read from `folder` when a page asks for them.

    settings: its parameters, conf/studies/<name>.yaml; facts: what the footer states.
    """

    name: str
    folder: Path
    settings: Mapping[str, Any]
    variants: list[str]
    users: dict[str, Margins]
    judged_users: list[str]  # users that means are taken over: to all others every path is valid
    seeds: list[int]
    main_n_demos: int
    facts: dict[str, Any] = field(default_factory=dict)
    reads: list[str] = field(default_factory=list)  # files that were asked for

    @property
    def sources(self) -> dict[str, Source]:
        """Return the file behind each table that was read."""
        return {file: Source(((self.name, self.folder / file),)) for file in self.reads}

    def table(self, file: str, finite: tuple[str, ...] = ()) -> pd.DataFrame:
        """Return a table of the study; raise InputError if a number of the columns `finite` is not finite.

        Empty names, such as the variant of a baseline, are \"\".
        """
        self.reads.append(file)
        frame = named(read_table(self.folder / file))
        check_finite(frame, f"{self.name}/{file}", finite)
        return frame

    def source(self, name: str) -> str:
        """Return how a number of a table names it."""
        return f"{self.name}/{name}"

    def arrays(self, file: str) -> dict[str, np.ndarray]:
        """Return the arrays of an npz of the study."""
        return read_arrays(self.folder / file)

    def value(self, file: str, column: str, **where: Any) -> Any:
        """Return the value of `column` in the one row of a table that `where` selects.

        Raise InputError if no row or several match, or if the number is missing or not finite.
        """
        return lookup(self.table(file), f"{self.name}/{file}", column, **where)

    def rows(self, file: str, **where: Any) -> pd.DataFrame:
        """Return the rows of a table that `where` selects; a list selects any of its values."""
        frame = self.table(file)
        for name, wanted in where.items():
            frame = frame[frame[name].isin(wanted if isinstance(wanted, list | tuple) else [wanted])]
        return frame

    def values(self, file: str, column: str, **where: Any) -> list:
        """Return the values of `column` in the rows that `where` selects.

        Raise InputError if there is none, or for a number that is missing or not finite.
        """
        rows = self.rows(file, **where)
        if rows.empty:
            raise InputError(f"table {self.name}/{file} has no row with {where}; run its stage again")
        return [checked(number, f"table {self.name}/{file}, column {column}, {where}") for number in rows[column]]
