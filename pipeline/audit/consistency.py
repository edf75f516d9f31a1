"""Check one commit without its data: do code, parameters, data and locks agree, and do pages say what tables hold."""

import html
import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import yaml

from pipeline.artifacts.files import read_json
from pipeline.git import dvc, git, run
from pipeline.report.exports import contents, fill
from pipeline.report.tables import FORMATS, HIDDEN
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import PROCESSORS, ROOT


@dataclass(frozen=True)
class Fault:
    """Something in a commit that does not agree."""

    place: str  # stage or file
    message: str


@dataclass(frozen=True)
class Checked:
    """The result of one check: how many items it looked at, and the faults among them."""

    check: str  # stages, parameters, outputs, tables, prose, provenance or README
    what: str  # what it asks
    items: int
    faults: list[Fault]
    unchecked: int = 0  # items that this clone cannot look at


def audit(clone: Path) -> list[Checked]:
    """Return every check of a commit in its clone (`pipeline.audit.revision.checked_out`)."""
    locks, status = read_locks(clone), json.loads(dvc(clone, "status", "--json"))
    status = {stage: entries for stage, entries in status.items() if ".dvc" not in stage}  # stage -> what changed
    return [
        stages(clone, locks, status),
        parameters(clone),
        outputs(clone, locks, status),
        _each_page(clone, "tables", "each cell of a page's table is its csv's", table_cells),
        _each_page(clone, "prose", "each traced number in a sentence is its table's", prose),
        provenance(clone, locks),
        readme(clone),
    ]


def read_locks(clone: Path) -> dict[str, dict]:
    """Return the lock of every stage, named as DVC does."""
    locks = {}
    for file in (clone / "dvc.lock", *clone.glob("studies/dvc.lock"), *sorted(clone.glob("studies/*/dvc.lock"))):
        prefix = "" if file.parent == clone else f"{file.parent.relative_to(clone)}/dvc.yaml:"
        locks |= {f"{prefix}{name}": stage for name, stage in yaml.safe_load(file.read_text())["stages"].items()}
    return locks


def stages(clone: Path, locks: dict[str, dict], status: dict[str, list]) -> Checked:
    """Check that every stage's code, parameters and inputs are those its lock was written for."""
    made = {out["path"]: out.get("md5") for stage in locks.values() for out in stage.get("outs", [])}
    for tracked in (Path(name) for name in git(clone, "ls-files", "*.dvc").splitlines()):
        outs = yaml.safe_load((clone / tracked).read_text())["outs"]
        made |= {str(tracked.parent / out["path"]): out["md5"] for out in outs}
    names = dvc(clone, "stage", "list", "--all", "--name-only").split()
    never_run = [name for name in names if name not in locks and not name.endswith(".dvc")]
    faults = _changes(clone, status, "changed deps")
    faults += [Fault(name, "it was never run: it has no lock") for name in never_run]
    for name, stage in locks.items():
        if name not in names:
            faults.append(Fault(name, "its lock has no stage: delete its entry"))
            continue
        others = [dep["path"] for dep in stage.get("deps", []) if made.get(dep["path"], dep["md5"]) != dep["md5"]]
        faults += [Fault(name, f"its lock was made from another {other}") for other in others]
    return Checked("stages", "code, parameters, data and locks agree", len(names), faults)


def parameters(clone: Path) -> Checked:
    """Check that params.yaml and dvc.yaml are what conf/ composes, by the commit's own `pipeline.params`."""
    known, faults = git(clone, "ls-files", "conf").splitlines(), []
    command = [sys.executable, "-m", "pipeline.params", "--check"]
    ended = run(command, clone, {"PYTHONPATH": str(clone)}, capture_output=True)
    if ended.returncode:
        said = (ended.stderr.strip().splitlines() or ["`python -m pipeline.params --check` failed"])[-1]
        faults = [Fault("conf/", said.removeprefix("error: "))]
    return Checked("parameters", "params.yaml is what conf/ composes", len(known), faults)


def outputs(clone: Path, locks: dict[str, dict], status: dict[str, list]) -> Checked:
    """Check that every result in git is the one that its stage's lock names, and that nothing else lies there."""
    known = [str(PROCESSORS), *(out["path"] for stage in locks.values() for out in stage.get("outs", []))]
    tracked = git(clone, "ls-files", "reports").split()
    stray = [file for file in tracked if not any(Path(file).is_relative_to(out) for out in known)]
    faults = _changes(clone, status, "changed outs") + [Fault(file, "no stage writes it") for file in stray]
    return Checked("outputs", "files under reports/ are what the locks name", len(tracked), faults)


def _changes(clone: Path, status: dict[str, list], kind: str) -> list[Fault]:
    """Return in words what changed of each stage, leaving out what a clone lacks: data and results that DVC keeps."""
    changes = [entry.get(kind, {}) for entries in status.values() for entry in entries if isinstance(entry, dict)]
    command = ["git", "check-ignore", "--", *{name for change in changes for name in change}]
    ignored = run(command, clone, capture_output=True)
    kept_by_dvc, faults = set(ignored.stdout.splitlines()), []
    for stage, entries in status.items():
        changed = {
            name: how for entry in entries if isinstance(entry, dict) for name, how in entry.get(kind, {}).items()
        }
        texts = [
            f"{', '.join(how)} in {name}" if isinstance(how, dict) else f"{name} is {how}"  # {parameter: modified}
            for name, how in changed.items()
            if how != "not in cache" and not (how == "deleted" and name in kept_by_dvc)
        ]
        if kind == "changed deps":
            texts += [entry for entry in entries if isinstance(entry, str)]  # such as "changed command"
        if texts:
            faults.append(Fault(stage, "; ".join(texts)))
    return faults


def _each_page(clone: Path, check: str, what: str, compare: Callable[[Path], tuple[int, list[str]]]) -> Checked:
    pages = [page for folder in ("reports", "studies/*") for page in sorted(clone.glob(f"{folder}/*.html"))]
    compared = [(str(page.relative_to(clone)), *compare(page)) for page in pages]
    faults = [Fault(place, message) for place, _, messages in compared for message in messages]
    return Checked(check, what, sum(count for _, count, _ in compared), faults)


def table_cells(page: Path) -> tuple[int, list[str]]:
    """Compare the tables of a page with the csv that each links to; return the number of cells and the faults."""
    count, faults = 0, []
    for markup in re.findall(r"(?s)<table.*?</table>", page.read_text()):
        links = re.findall(r'href="([^"]+\.csv)"', markup)
        if not links:
            continue
        link = links[-1]  # a caption may name others first
        csv = page.parent / link
        if not csv.is_file():
            faults.append(f"{link} is missing")
            continue
        frame = _csv(csv)
        columns = [i for i, name in enumerate(frame.columns) if not name.endswith(HIDDEN)]
        rows = re.findall(r"(?s)<tr.*?</tr>", markup)[1:]  # after the header
        if len(rows) != len(frame):
            faults.append(f"{link} has {len(frame)} rows, the page shows {len(rows)}")
            continue
        for values, row in zip(frame.itertuples(index=False), rows, strict=True):
            for column, cell in zip(columns, re.findall(r"(?s)<t[dh]\b.*?</t[dh]>", row), strict=False):
                count, text, name = count + 1, _text(cell), frame.columns[column]
                quartiles = [values[frame.columns.get_loc(q)] for q in (name + end for end in HIDDEN[:4]) if q in frame]
                if not _shows(text, values[column], quartiles if all(quartiles) else []):
                    held = " ".join([values[column], *quartiles])
                    faults.append(f"{link}, {name}: the page says {text!r}, the csv {held!r}")
                marked = values[frame.columns.get_loc(f"{name}, bold")] if f"{name}, bold" in frame else "False"
                if ("<b>" in cell) != (marked == "True"):
                    faults.append(f"{link}, {name}: the page and the csv disagree on whether {text!r} is bold")
    return count, faults


def prose(page: Path) -> tuple[int, list[str]]:
    """Compare the numbers in sentences that name a committed table as their source with that table."""
    count, faults = 0, []
    for source, number in re.findall(r'(?s)<data [^>]*data-source="([^"]+)"[^>]*>(.*?)</data>', page.read_text()):
        table, column, where = json.loads(html.unescape(source))
        csv, text = page.parent / "tables" / f"{table}.csv", _text(number)
        if not csv.is_file():
            continue  # a table that git does not keep: only a rerun can tell
        count += 1
        frame = _csv(csv)
        for name, wanted in where.items():
            frame = frame[frame[name] == str(wanted)]
        if len(frame) != 1 or not _shows(text, frame[column].iloc[0]):
            values = frame[column].tolist()
            faults.append(f"{table}.csv, {column}, {where}: the page says {text!r}, the csv {values}")
    return count, faults


def _text(markup: str) -> str:
    """Return the text of an element, without the mark of a large effect."""
    return html.unescape(re.sub(r"<[^>]*>", "", markup)).replace("†", "").strip()


def _shows(text: str, value: str, quartiles: Sequence[str] = ()) -> bool:
    """Return whether a page's text is a csv's value, as it stands or in one of the formats that pages use.

    quartiles: the values that follow in brackets, without their unit.
    """
    if text == value and not quartiles:
        return True
    try:
        numbers = [float(number or "nan") for number in (value, *quartiles)]
    except ValueError:
        return False
    if numbers[0] != numbers[0]:
        return text in ("–", "")
    near = (1, 1 + 1e-6, 1 - 1e-6)  # a csv keeps six digits
    for write in (write for name, write in FORMATS.items() if name != "spread"):
        first, *ends = ({str(write(number * factor)) for factor in near} for number in numbers)
        ends = [{end.partition("\u00a0")[0] for end in shown} for shown in ends]
        pairs = [f"{b}{between}{c}" for b in ends[0] for c in ends[1] for between in ("–", " to ")] if ends else []
        written = first if not ends else {f"{a} [{pair}]" for a in first for pair in pairs}
        if text in written:
            return True
    return False


def _csv(path: Path) -> pd.DataFrame:
    """Return a table with its cells as text."""
    return pd.read_csv(path, dtype=str, keep_default_na=False)


def provenance(clone: Path, locks: dict[str, dict]) -> Checked:
    """Check that the files which a page's tables were made of are those that the locks name.

    Of an output that is a folder, a lock names only the list of its files, which lies in DVC's cache; where the cache
    lacks it, the folder's files are unchecked.
    """
    made, unlisted = {}, set()
    cache = Path(dvc(ROOT, "cache", "dir").strip())
    for name, lock in locks.items():
        stage = name.rpartition(":")[2]
        for out in lock.get("outs", []):
            md5 = out.get("md5") or ""
            listed = cache / "files" / "md5" / md5[:2] / md5[2:]
            if not md5.endswith(".dir"):
                made[stage, Path(out["path"]).name] = md5
            elif listed.is_file():
                made |= {(stage, Path(file["relpath"]).name): file["md5"] for file in json.loads(listed.read_text())}
            else:
                unlisted.add(stage)
    count, unchecked, faults = 0, 0, []
    for path in [*clone.glob("reports/provenance.json"), *sorted(clone.glob("studies/*/provenance.json"))]:
        sources = {(x["stage"], x["file"]): x["md5"] for file in read_json(path)["sources"].values() for x in file}
        known = {key: md5 for key, md5 in sources.items() if key in made}  # others are files in git
        count += len(known)
        unchecked += sum(stage in unlisted for stage, _ in sources.keys() - known.keys())
        for (stage, file), md5 in known.items():
            if made[stage, file] != md5:
                text = f"it was made of another {file} of stage {stage} than the lock names"
                faults.append(Fault(str(path.relative_to(clone)), text))
    return Checked("provenance", "tables were made of the files that the locks name", count, faults, unchecked)


def readme(clone: Path) -> Checked:
    """Check that the README's tables are those that today's results give."""
    text, what = (clone / "README.md").read_text(encoding="utf-8"), "the README's tables are those of reports/"
    if not (clone / "reports/tables/bold.csv").is_file():  # earlier editions, whose README had other tables
        return Checked("README", what, 0, [])
    try:
        parts = contents(clone)
    except (InputError, OSError, KeyError) as error:
        return Checked("README", what, 1, [Fault("reports/", f"the README's tables cannot be read: {error}")])
    wrong = [name for name, part in parts.items() if not fill(text, {name: part}) == text != fill(text, {name: ""})]
    faults = [Fault("README.md", f"its table {name!r} differs or is missing: run `make readme`") for name in wrong]
    return Checked("README", what, sum(part.count("\n") - 1 for part in parts.values()), faults)
