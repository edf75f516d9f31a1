"""Check one commit without its data: do code, parameters, data, locks, pages and README agree."""

import hashlib
import json
import sys
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import yaml

from pipeline.artifacts.files import read_json
from pipeline.git import dvc, git, run
from pipeline.report.exports import contents, fill
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import PROCESSORS, ROOT

REVIEWED = "reports/reviewed.csv"  # people's verdicts on recordings; pipeline.viewer, which writes it, needs an extra


@dataclass(frozen=True)
class Fault:
    """Something in a commit that does not agree."""

    place: str  # stage or file
    message: str


@dataclass(frozen=True)
class Checked:
    """The result of one check: how many items it looked at, and the faults among them."""

    check: str  # stages, parameters, outputs, provenance or README
    what: str  # what it asks
    items: int
    faults: list[Fault]
    unchecked: int = 0  # items that this clone cannot look at


def audit(clone: Path) -> list[Checked]:
    """Return every check of a commit in its clone (`pipeline.git.checked_out`)."""
    locks, status = read_locks(clone), json.loads(dvc(clone, "status", "--json"))
    status = {stage: entries for stage, entries in status.items() if ".dvc" not in stage}  # stage -> what changed
    by_status = stages(clone, locks, status), parameters(clone), outputs(clone, locks, status)
    return [*by_status, provenance(clone, locks), readme(clone)]


def read_locks(clone: Path) -> dict[str, dict]:
    """Return the lock of every stage, named as DVC does; raise InputError for a commit that has none."""
    if not (clone / "dvc.lock").is_file():
        raise InputError("the commit has no dvc.lock, so no results: choose a later one")
    locks = {}
    for file in (clone / "dvc.lock", *clone.glob("studies/dvc.lock"), *sorted(clone.glob("studies/*/dvc.lock"))):
        prefix = "" if file.parent == clone else f"{file.parent.relative_to(clone)}/dvc.yaml:"
        locks |= {f"{prefix}{name}": stage for name, stage in yaml.safe_load(file.read_bytes())["stages"].items()}
    return locks


def stages(clone: Path, locks: dict[str, dict], status: dict[str, list]) -> Checked:
    """Check that every stage's code, parameters and inputs are those its lock was written for."""
    outs = [out for stage in locks.values() for out in stage.get("outs", [])]
    made, cache, unchecked = {out["path"]: out.get("md5") for out in outs}, Path(dvc(ROOT, "cache", "dir").strip()), 0
    for tracked in (Path(name) for name in git(clone, "ls-files", "*.dvc").splitlines()):
        data = yaml.safe_load((clone / tracked).read_bytes())["outs"]
        made |= {str(tracked.parent / out["path"]): out["md5"] for out in data}
    names = dvc(clone, "stage", "list", "--all", "--name-only").split()
    never_run = [name for name in names if name not in locks and not name.endswith(".dvc")]
    faults = _changes(clone, status, "changed deps")
    faults += [Fault(name, "it was never run: it has no lock") for name in never_run]
    for name, stage in locks.items():
        if name not in names:
            faults.append(Fault(name, "its lock has no stage: delete its entry"))
            continue
        others = [dep["path"] for dep in stage.get("deps", []) if made.get(dep["path"], dep["md5"]) != dep["md5"]]
        for dep in stage.get("deps", []):
            agrees, is_sure = _holds(outs, dep, cache)
            others += [] if agrees else [dep["path"]]
            unchecked += not is_sure
        faults += [Fault(name, f"its lock was made from another {other}") for other in others]
    return Checked("stages", "code, parameters, data and locks agree", len(names), faults, unchecked)


def _holds(outs: list[dict], folder: dict, cache: Path) -> tuple[bool, bool]:
    """Return whether a folder that a stage read holds what other stages put into it, and whether that is sure.

    Without DVC's lists of what they put, which are in its cache, only numbers and sizes of files are compared.
    """
    inside = [out for out in outs if Path(folder["path"]) in Path(out["path"]).parents]
    if not inside or "nfiles" not in folder:
        return True, True
    files = []
    for out in inside:
        place, listed = Path(out["path"]).relative_to(folder["path"]), _listed(out["md5"], cache)
        if listed is None:
            counts = sum(out.get("nfiles", 1) for out in inside), sum(out["size"] for out in inside)
            return counts == (folder["nfiles"], folder["size"]), False
        files += [{"md5": file["md5"], "relpath": str(place / file["relpath"])} for file in listed]
    text = json.dumps(sorted(files, key=lambda file: file["relpath"]), sort_keys=True)  # as DVC hashes a folder
    return f"{hashlib.md5(text.encode()).hexdigest()}.dir" == folder["md5"], True


def _listed(md5: str, cache: Path) -> list[dict[str, str]] | None:
    """Return the digest and the path of each file of an output; None if DVC's cache lacks a folder's list."""
    if not md5.endswith(".dir"):
        return [{"md5": md5, "relpath": ""}]
    file = cache / "files" / "md5" / md5[:2] / md5[2:]
    return json.loads(file.read_bytes()) if file.is_file() else None


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
    """Check that each result in git is what its stage's lock names, and that only people's verdicts lie beside."""
    known = [str(PROCESSORS), REVIEWED, *(out["path"] for stage in locks.values() for out in stage.get("outs", []))]
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
        changed = [entry.get(kind, {}).items() for entry in entries if isinstance(entry, dict)]
        texts = [
            f"{', '.join(how)} in {name}" if isinstance(how, dict) else f"{name} is {how}"  # {parameter: modified}
            for name, how in chain(*changed)
            if how != "not in cache" and not (how == "deleted" and name in kept_by_dvc)
        ]
        if kind == "changed deps":
            texts += [entry for entry in entries if isinstance(entry, str)]  # such as "changed command"
        if texts:
            faults.append(Fault(stage, "; ".join(texts)))
    return faults


def provenance(clone: Path, locks: dict[str, dict]) -> Checked:
    """Check that the files which a page's tables were made of are those that the locks name.

    A lock names only the list of a folder's files, which lies in DVC's cache; without it they are unchecked.
    """
    made, unlisted = {}, set()
    cache = Path(dvc(ROOT, "cache", "dir").strip())
    for name, lock in locks.items():
        stage = name.rpartition(":")[2]
        for out in lock.get("outs", []):
            if (listed := _listed(out.get("md5") or "", cache)) is None:
                unlisted.add(stage)
            else:
                made |= {(stage, (Path(out["path"]) / file["relpath"]).name): file["md5"] for file in listed}
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
    try:
        parts = contents(clone)
    except (InputError, OSError, KeyError) as error:
        return Checked("README", what, 1, [Fault("reports/", f"the README's tables cannot be read: {error}")])
    wrong = [name for name, part in parts.items() if not fill(text, {name: part}) == text != fill(text, {name: ""})]
    faults = [Fault("README.md", f"its table {name!r} differs or is missing: run `make readme`") for name in wrong]
    return Checked("README", what, sum(part.count("\n") - 1 for part in parts.values()), faults)
