"""Check one commit without its data: do code, parameters, data and locks agree, and do pages say what tables hold."""

import json
from collections.abc import Iterable
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import yaml

from pipeline.artifacts.files import read_json
from pipeline.audit.revision import dvc, git
from pipeline.report.page import FORMATS
from pipeline.report.readme import fill, headlines
from pipeline.runtime.errors import InputError

MISSING = ("deleted", "not in cache")  # what DVC calls data and results that a clone has not pulled


class Fault(NamedTuple):
    """Something in a commit that does not agree."""

    check: str  # stages, outputs, tables, prose, provenance or README
    place: str  # stage or file
    message: str


class Checked(NamedTuple):
    """The result of one check: how many items it looked at, and the faults among them."""

    check: str
    what: str  # what it asks
    items: int
    faults: list[Fault]


def audit(clone: Path) -> list[Checked]:
    """Return every check of a commit in its clone (`pipeline.audit.revision.checked_out`)."""
    checks = [stages(clone), outputs(clone)]
    pages = [page for folder in ("reports", "studies/*") for page in sorted(clone.glob(f"{folder}/*.html"))]
    checks.append(_gather("tables", "each cell of a page's table is its csv's", map(table_cells, pages), clone))
    checks.append(_gather("prose", "each traced number in a sentence is its table's", map(prose, pages), clone))
    return [*checks, provenance(clone), readme(clone)]


def _gather(check: str, what: str, results: Iterable[tuple[int, list[tuple[Path, str]]]], clone: Path) -> Checked:
    items, faults = 0, []
    for count, messages in results:
        items += count
        faults += [Fault(check, str(page.relative_to(clone)), message) for page, message in messages]
    return Checked(check, what, items, faults)


def stages(clone: Path) -> Checked:
    """Check that every stage's code, parameters and inputs are those its lock was written for."""
    locks, status = _locks(clone), _status(clone)
    made = {out["path"]: out.get("md5") for stage in locks.values() for out in stage.get("outs", [])}
    for tracked in clone.glob("[!.]*.dvc"):
        made |= {out["path"]: out["md5"] for out in yaml.safe_load(tracked.read_text())["outs"]}
    names = dvc(clone, "stage", "list", "--all", "--name-only").split()
    faults = [Fault("stages", name, text) for name, text in _changes(status, "changed deps").items()]
    faults += [
        Fault("stages", name, "it was never run: it has no lock")
        for name in names
        if name not in locks and name[-4:] != ".dvc"
    ]
    for name, stage in locks.items():
        if name not in names:
            faults.append(Fault("stages", name, "its lock has no stage: delete its entry"))
            continue
        others = [dep["path"] for dep in stage.get("deps", []) if made.get(dep["path"], dep["md5"]) != dep["md5"]]
        faults += [Fault("stages", name, f"its lock was made from another {other}") for other in others]
    return Checked("stages", "code, parameters, data and locks agree", len(names), faults)


def outputs(clone: Path) -> Checked:
    """Check that every result in git is the one that its stage's lock names, and that nothing else lies there."""
    faults = [Fault("outputs", name, text) for name, text in _changes(_status(clone), "changed outs").items()]
    known = [out["path"] for stage in _locks(clone).values() for out in stage.get("outs", [])]
    tracked = git(clone, "ls-files", "reports").split()
    stray = [file for file in tracked if not any(Path(file).is_relative_to(out) for out in known)]
    faults += [Fault("outputs", file, "no stage writes it") for file in stray]
    return Checked("outputs", "files under reports/ are what the locks name", len(tracked), faults)


def _locks(clone: Path) -> dict[str, dict]:
    """Return the lock of every stage, named as DVC does."""
    locks = {}
    for file in (clone / "dvc.lock", *sorted(clone.glob("studies/*/dvc.lock"))):
        folder = file.parent.relative_to(clone)
        prefix = "" if folder == Path() else f"{folder}/dvc.yaml:"
        locks |= {f"{prefix}{name}": stage for name, stage in yaml.safe_load(file.read_text())["stages"].items()}
    return locks


def _status(clone: Path) -> dict[str, list]:
    """Return what DVC finds changed, by stage; data and results that are merely missing here are among it."""
    return {name: entries for name, entries in json.loads(dvc(clone, "status", "--json")).items() if ".dvc" not in name}


def _changes(status: dict[str, list], kind: str) -> dict[str, str]:
    """Return in words what changed of each stage, leaving out files that are merely missing here."""
    changed = {}
    for stage, entries in status.items():
        parts = [part for entry in entries if isinstance(entry, dict) for part in entry.get(kind, {}).items()]
        texts = [_words(name, value) for name, value in parts if value not in MISSING]
        if kind == "changed deps":
            texts += [entry for entry in entries if isinstance(entry, str)]  # such as "changed command"
        if texts:
            changed[stage] = "; ".join(texts)
    return changed


def _words(name: str, value: object) -> str:
    if isinstance(value, dict):  # a file of parameters: {parameter: modified}
        return f"{', '.join(value)} in {name}"
    return f"{name} is {value}"


class _Cells(HTMLParser):
    """Read the tables of a page that link to a csv: the text of their cells, row by row."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[tuple[str, list[list[str]]]] = []
        self.numbers: list[tuple[str, str]] = []  # source and text of each traced number
        self._csv, self._rows, self._text, self._source = "", [], None, None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "table":
            self._csv, self._rows = "", []
        elif tag == "a" and (given.get("href") or "").endswith(".csv"):
            self._csv = str(given["href"])
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._text = ""
        elif tag == "data" and given.get("data-source"):
            self._source, self._text = str(given["data-source"]), ""

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text += data

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self._text is not None and self._rows:
            self._rows[-1].append(self._text.strip())
            self._text = None
        elif tag == "table" and self._csv:
            self.tables.append((self._csv, self._rows))
        elif tag == "data" and self._source:
            self.numbers.append((self._source, (self._text or "").strip()))
            self._source = self._text = None


def table_cells(page: Path) -> tuple[int, list[tuple[Path, str]]]:
    """Compare the tables of a page with the csv that each links to; return the number of cells and the faults."""
    count, faults = 0, []
    for link, rows in _read(page).tables:
        csv = page.parent / link
        if not csv.is_file():
            faults.append((page, f"{link} is missing"))
            continue
        frame = _csv(csv)
        columns = [i for i, name in enumerate(frame.columns) if not name.endswith((", q1", ", q3"))]
        shown = rows[1:]  # after the header
        if len(shown) != len(frame):
            faults.append((page, f"{link} has {len(frame)} rows, the page shows {len(shown)}"))
            continue
        for row, texts in zip(frame.itertuples(index=False), shown, strict=True):
            for column, text in zip(columns, texts, strict=False):
                count += 1
                if not _shows(text, row[column]):
                    faults.append(
                        (page, f"{link}, {frame.columns[column]}: the page says {text!r}, the csv {row[column]!r}")
                    )
    return count, faults


def prose(page: Path) -> tuple[int, list[tuple[Path, str]]]:
    """Compare the numbers in sentences that name a committed table as their source with that table."""
    count, faults = 0, []
    for source, text in _read(page).numbers:
        table, column, where = json.loads(source)
        csv = page.parent / "tables" / f"{table}.csv"
        if not csv.is_file():
            continue  # a table that git does not keep: only a rerun can tell
        count += 1
        frame = _csv(csv)
        for name, wanted in where.items():
            frame = frame[frame[name] == str(wanted)]
        if len(frame) != 1 or not _shows(text, frame[column].iloc[0]):
            faults.append(
                (page, f"{table}.csv, {column}, {where}: the page says {text!r}, the csv {frame[column].tolist()}")
            )
    return count, faults


def _read(page: Path) -> _Cells:
    reader = _Cells()
    reader.feed(page.read_text())
    return reader


def _shows(text: str, value: str) -> bool:
    """Return whether a page's text is a csv's value, as it stands or in one of the formats that pages use."""
    if text == value:
        return True
    try:
        number = float(value or "nan")
    except ValueError:
        return False
    text = text.split(" (")[0]  # quartiles follow in brackets
    if number != number:
        return text in ("–", "")
    formats = [write for name, write in FORMATS.items() if name != "spread"]
    nearby = (number, number * (1 + 1e-6), number * (1 - 1e-6))  # a csv keeps six digits
    return any(text == str(write(close)) for write in formats for close in nearby)


def _csv(path: Path) -> pd.DataFrame:
    """Return a table with its cells as text."""
    return pd.read_csv(path, dtype=str, keep_default_na=False)


def provenance(clone: Path) -> Checked:
    """Check that the files which a page's tables were made of are those that the locks name."""
    made: dict[tuple[str, str], str] = {}
    for name, stage in _locks(clone).items():
        for out in stage.get("outs", []):
            made[name.rpartition(":")[2], Path(out["path"]).name] = out.get("md5")
    count, faults = 0, []
    for path in [*clone.glob("reports/provenance.json"), *sorted(clone.glob("studies/*/provenance.json"))]:
        sources = {
            (part["stage"], part["file"]): part["md5"] for file in read_json(path)["sources"].values() for part in file
        }
        known = {key: md5 for key, md5 in sources.items() if key in made}  # others are files in git
        count += len(known)
        for (stage, file), md5 in known.items():
            if made[stage, file] != md5:
                text = f"it was made of another {file} of stage {stage} than the lock names"
                faults.append(Fault("provenance", str(path.relative_to(clone)), text))
    return Checked("provenance", "tables were made of the files that the locks name", count, faults)


def readme(clone: Path) -> Checked:
    """Check that the README's table of headlines is the one that today's results give."""
    text, what = (clone / "README.md").read_text(), "the README's headlines are those of reports/metrics.json"
    if not (clone / "reports/tables/causes-verdicts.csv").is_file():  # the first edition, whose README had other tables
        return Checked("README", what, 0, [])
    try:
        metrics = read_json(clone / "reports/metrics.json")
        table = headlines(metrics, pd.read_csv(clone / "reports/tables/causes-verdicts.csv"))
    except (InputError, OSError, KeyError) as error:
        return Checked("README", what, 1, [Fault("README", "reports/", f"its headlines cannot be read: {error}")])
    same = fill(text, table) == text
    faults = [] if same else [Fault("README", "README.md", "its table differs: run `make readme`")]
    return Checked("README", what, table.count("\n") - 1, faults)
