"""Give a page what it draws from: tables by name, whose numbers know their cell and whose files are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.report.tables import check_finite, checked, chosen, lookup, named
from pipeline.world.rules import Margins

Source = Sequence[tuple[str, Path]]  # what a table of results was read or computed from: stage, and file in its folder


@dataclass(frozen=True, kw_only=True)
class Data:
    """Hold results by the names of their tables, and the settings that all pages print."""

    variants: list[str]
    users: dict[str, Margins]
    judged_users: list[str]  # users that means are taken over: to all others every path is valid
    seeds: list[int]
    main_n_demos: int
    facts: dict[str, Any] = field(default_factory=dict)
    sources: dict[str, Source] = field(default_factory=dict)  # of each table
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    reads: list[str] = field(default_factory=list)  # tables that were asked for

    def table(self, name: str) -> pd.DataFrame:
        """Return a table by its name, and note in `reads` that it was asked for."""
        self.reads.append(name)
        return self.tables[name]

    def source(self, name: str) -> str:
        """Return how a number of a table names it."""
        return name

    def value(self, table: str, column: str, **where: Any) -> Any:
        """Return the value of `column` in the one row of `table` that `where` selects.

        Raise InputError if no row or several match, or if the number is missing or not finite.
        """
        return lookup(self.table(table), self.source(table), column, **where)


def of_parameters(cfg: DictConfig) -> dict[str, Any]:
    """Return the fields of `Data` that are parameters."""
    fields = {"variants": list(cfg.variants), "users": {user: dict(margins) for user, margins in cfg.users.items()}}
    fields |= {"judged_users": list(cfg.evaluate.users), "seeds": list(cfg.protocol.seeds)}
    return fields | {"main_n_demos": cfg.main_n_demos}


@dataclass(frozen=True, kw_only=True)
class Study(Data):
    """The results of one study, read from `folder` when a page asks for them; its tables' names are files.

    settings: its parameters, conf/studies/<name>.yaml; facts: what the footer states.
    """

    name: str
    folder: Path
    settings: Mapping[str, Any]

    def table(self, name: str, finite: tuple[str, ...] = ()) -> pd.DataFrame:
        """Return a table of the study; raise InputError if a number of the columns `finite` is not finite.

        Empty names, such as the variant of a baseline, are \"\".
        """
        self.reads.append(name)
        self.sources[name] = [(self.name, self.folder / name)]
        frame = named(read_table(self.folder / name))
        check_finite(frame, self.source(name), finite)
        return frame

    def source(self, name: str) -> str:
        """Return how a number of a table names it."""
        return f"{self.name}/{name}"

    def arrays(self, file: str) -> dict[str, np.ndarray]:
        """Return the arrays of an npz of the study."""
        return read_arrays(self.folder / file)

    def rows(self, file: str, **where: Any) -> pd.DataFrame:
        """Return the rows of a table that `where` selects; a list selects any of its values. InputError if none."""
        return chosen(self, file, where)

    def values(self, file: str, column: str, **where: Any) -> list:
        """Return the values of `column` in these rows; raise InputError for a number that is missing or not finite."""
        name = f"table {self.source(file)}, column {column}, {where}"
        return [checked(number, name) for number in self.rows(file, **where)[column]]
