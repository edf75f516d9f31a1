"""Check a folder: read all of it, fit the paths, and explain every fault before anything runs."""

from pathlib import Path

import pandas as pd

from pipeline.own.csv_files import Faults
from pipeline.own.folder import Folder, read_folder
from pipeline.own.paths import fit_demonstrations


def check(path: Path) -> tuple[Folder | None, pd.DataFrame, Faults]:
    """Return the folder and its demonstrations (`paths.fit_demonstrations`), or None and a sentence for each fault."""
    folder, faults = read_folder(path)
    if folder is None:
        return None, pd.DataFrame(), faults
    demos = fit_demonstrations(folder, faults)
    more = demos[demos["needs_more"]]
    if len(more):
        first = ", ".join(more[["scene", "user", "demo"]].iloc[0])
        folder.notes.append(
            f"{len(more)} of {len(demos)} demonstrations need more than one control point, the first ({first}): they "
            "are fitted less closely"
        )
    return (None if faults else folder), demos, faults
