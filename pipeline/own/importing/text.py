"""Read csv in the dialects that people and their programs write."""

import csv
import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.own.files import KEY
from pipeline.own.importing.segments import Choices, Recording
from pipeline.runtime.errors import InputError

DELIMITERS = ("\t", ";", ",", "|", " ")
HEADER_LINES = 50  # the header is looked for in so many lines: programs write remarks above it
UNIT = r"[\s_]*[\[(]?(?P<unit>mm|cm|m)?[\])]?"
X = re.compile(rf"(?:.*[\s._/:-]|.*pos(?:ition)?)?[tp]?(?P<x>x)(?:[\s._-]*(?:pos|coord)\w*)?{UNIT}", re.I)
NO_PLACE = re.compile(r"orient|rot|quat|vel|twist|ang|force|acc|std|cov", re.I)  # other columns with x and y
T, T_ABROAD = (
    re.compile(rf"(?:.*[\s._/:%-])?(?:{words})[\s_]*[\[(]?(?P<unit>s|ms|us|ns)?(?:ec\w*)?[\])]?", re.I)
    for words in (r"t|(?:date)?time|(?:time)?stamp|sec\w*", "zeit(?:stempel)?|temps|tiempo|tempo")
)
TIMES = {"s": (1.0, 0.9), "ms": (1e-3, 900.0), "us": (1e-6, 9e5), "ns": (1e-9, np.inf)}  # seconds; largest usual step
LABELS = (*KEY, "valid")
LOST = ("", "nan", "null", "none", "-")  # cells, in lower case, where a tracker saw nothing


def pair(names: Collection[str]) -> dict[str, str]:
    """Return the columns of x and y by name, {} if there are none; InputError if several may be meant."""
    pairs = []
    for name in dict.fromkeys(names):
        if (match := X.fullmatch(name)) and not NO_PLACE.search(name):
            i = match.start("x")
            other = f"{name[:i]}{'y' if name[i] == 'x' else 'Y'}{name[i + 1 :]}"
            pairs += [(name, other)] if other in names else []
    if len(pairs) > 1:
        listed = "; ".join(f"x={x},y={y}" for x, y in pairs)
        raise InputError(f"several columns may be the position: choose by --columns one of {listed}")
    return dict(zip("xy", pairs[0], strict=True)) if pairs else {}


def read(path: Path, choices: Choices) -> tuple[list[Recording], Choices, list[str]]:
    """Return the recordings, the choices with what was found, and remarks; InputError for an unusable file."""
    content = path.read_bytes()
    try:
        lines = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig").splitlines()
    except UnicodeDecodeError:
        lines = content.decode("cp1252", "replace").splitlines()  # as Windows saves csv
    number, delimiter, names, columns = _header(path, lines, choices)
    rows = [(i, row) for i, row in enumerate(_split(lines[number:], delimiter), number + 1) if any(row)][1:]
    for i, row in rows:
        if len(row) < len(names) or any(row[len(names) :]):
            raise InputError(f"{path.name}, row {i} has {len(row)} cells, the header {len(names)}: correct it")
    cells = {role: [row[names.index(name)].strip() for _, row in rows] for role, name in columns.items()}
    table = pd.DataFrame(cells, dtype=str).set_axis([i for i, _ in rows])
    numbers = [role for role in columns if role not in LABELS]
    decimal = choices.decimal or ("," if table[numbers].map(lambda cell: "," in cell).any(axis=None) else ".")
    if table["t"].str.contains(":").mean() > 0.5:  # dates, or times of day
        texts = table["t"].str.replace(r"^(\d+:\d\d[.,]\d+)$", r"0:\1", regex=True)  # minutes and seconds
        moments = pd.to_datetime(texts, format="mixed", errors="coerce", utc=True)
        seconds = (moments - moments.min()).dt.total_seconds().astype(str)
        table["t"], choices = seconds.where(moments.notna(), table["t"]), choices.model_copy(update={"time": "s"})
    for role in numbers:
        values = pd.to_numeric(table[role].str.replace(decimal, "."), errors="coerce").astype(float)
        for i in table.index[values.isna() & ~table[role].str.lower().isin(LOST)][:1]:
            cell, sign = f"{columns[role]} is {table[role][i]!r}", f"decimal {decimal!r}"
            raise InputError(f"{path.name}, row {i}: {cell}: expected a number with {sign}")
        table[role] = values
    kept = table[np.isfinite(table[["t", "x", "y"]].astype(float)).all(axis=1)]
    if kept.empty:
        raise InputError(f"{path.name} has no row with a time and a position below its header")
    step, named = kept["t"].diff().abs().median(), _unit(T, columns["t"]) or _unit(T_ABROAD, columns["t"])
    time = choices.time or named or next(unit for unit, (_, most) in TIMES.items() if not step > most)
    unit = choices.unit or _unit(X, columns["x"])
    keys, recordings = [role for role in KEY if role in columns], []
    for values, part in kept.groupby(keys, sort=False) if keys else [((), kept)]:
        labels: dict[str, str] = dict(zip(keys, values, strict=True))
        gripper = part["gripper"].to_numpy() if "gripper" in columns else None
        t, places = (part["t"] - kept["t"].iloc[0]).to_numpy() * TIMES[time][0], part[["x", "y"]].to_numpy()
        words = [(i, word) for i, word in enumerate(part["valid"], 1) if word] if "valid" in columns else []
        recordings.append(Recording("-".join((path.stem, *values)), t, places, gripper, words, "demo" in keys, labels))
    found = {"columns": columns, "delimiter": delimiter, "decimal": decimal, "time": time, "unit": unit}
    notes = [f"{len(table) - len(kept)} rows without a position were left out"] if len(kept) < len(table) else []
    if not (choices.time or named):
        notes.append(f"times are taken for {time}, as rows are {step:g} apart: if not, write `time` below `import`")
    return recordings, choices.model_copy(update=found), notes


def _unit(pattern: re.Pattern[str], name: str) -> str | None:
    """Return the unit that a column's name ends in."""
    match = pattern.fullmatch(name)
    return match["unit"].lower() if match and match["unit"] else None


def _split(lines: list[str], delimiter: str) -> list[list[str]]:
    """Return the cells of each line; spaces count once."""
    return [line.split() for line in lines] if delimiter == " " else list(csv.reader(lines, delimiter=delimiter))


def _header(path: Path, lines: list[str], choices: Choices) -> tuple[int, str, list[str], dict[str, str]]:
    """Return the header's line, the delimiter, the names, and the columns by role."""
    chosen = choices.named
    for number, line in enumerate(lines[:HEADER_LINES]):
        for delimiter in [choices.delimiter] if choices.delimiter else DELIMITERS:
            names = [name.strip() for row in _split([line.lstrip("#% ")], delimiter) for name in row]
            times = [("t", name) for pattern in (T, T_ABROAD) for name in names if pattern.fullmatch(name)][:1]
            labels = {name.lower(): name for name in names if name.lower() in LABELS}
            columns = {**labels, **dict(times), **({} if "x" in chosen else pair(names)), **chosen}
            if {"x", "y"} <= columns.keys() and {*columns.values()} <= {*names}:
                lower = [name.lower() for name in names]  # valid and Valid are two columns, unless one is chosen
                alike = {role: lower.count(role) for role in labels.keys() - chosen.keys()}
                if twice := [name for role, name in columns.items() if max(names.count(name), alike.get(role, 0)) > 1]:
                    raise InputError(f"{path.name} has two columns {twice[0]!r}: rename one")
                if "t" not in columns:
                    raise InputError(f"{path.name} has no times among {', '.join(names)}: choose by --columns t=NAME")
                return number, delimiter, names, columns
    expected = ", ".join(chosen.values()) or "names such as t, x, y"
    raise InputError(f"{path.name} begins with {lines[:1]}: expected a header with {expected}; see --columns")
