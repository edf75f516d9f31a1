"""Audit the results of a commit, or compare those of two. Needs no data, except to run a commit again.

python -m pipeline.audit                     the last commit: do code, parameters, data, locks, pages and README agree?
python -m pipeline.audit REV                 the same of another commit
python -m pipeline.audit BEFORE AFTER        what differs: claims, headlines, parameters, data, packages, code
python -m pipeline.audit REV --rerun [STAGE ...]
                                             run these stages (default: all of the paper) again in a clean clone, with
                                             the commit's own packages, and compare every output
  --profile PROFILE                          of the rerun, such as smoke: run twice and compare; two commits: run both
python -m pipeline.audit [REV] --history     every commit up to this one that changed the results; some 20 s each
  --format terminal | markdown | json | html   terminal by default
  --out FILE                                   write there instead

Exit status: 0 if everything agrees, or no verdict changed and no headline is worse; 1 if not; 2 for a mistake in use.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from pipeline.audit import text
from pipeline.audit.consistency import Checked, audit
from pipeline.audit.difference import Commit, Difference, compare
from pipeline.audit.history import history
from pipeline.audit.rerun import rerun, run_both
from pipeline.audit.revision import checked_out, git, resolve
from pipeline.audit.show import as_page, in_terminal
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write


def main(arguments: list[str]) -> int:
    """Run an audit from the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.audit", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("revision", nargs="*", default=["HEAD"], help="one commit to audit, or two to compare")
    parser.add_argument("--format", choices=["terminal", "markdown", "json", "html"], default="terminal")
    parser.add_argument("--out", type=Path, help="file to write")
    parser.add_argument("--rerun", nargs="*", metavar="STAGE", help="run these stages again, by default all")
    parser.add_argument("--profile", help="of the rerun, such as smoke: run twice, or two commits, and compare")
    parser.add_argument("--history", action="store_true", help="audit every commit with results up to this one")
    given = parser.parse_args(arguments)
    try:
        if len(given.revision) > (2 if given.rerun is None or given.profile else 1):
            raise InputError(f"{len(given.revision)} commits: expected one to audit or to run again, or two to compare")
        if given.profile and given.rerun is None:
            raise InputError(f"--profile {given.profile} wants --rerun: results in git are those of profile paper")
        if given.history:
            content, markdown, status = _history(given.revision[0])
        elif given.rerun is not None and given.profile:
            content, markdown, status = _rerun_both(given.revision[0], given.revision[-1], given.rerun, given.profile)
        elif given.rerun is not None:
            content, markdown, status = _rerun(given.revision[0], given.rerun)
        elif len(given.revision) == 2:
            content, markdown, status = _compare(*given.revision)
        else:
            content, markdown, status = _audit(*given.revision)
        _write(given, content, markdown)
    except (InputError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return status


def _audit(revision: str) -> tuple[Any, str, int]:
    with checked_out(revision) as clone:
        checks = audit(clone)
    content = [_check(check) for check in checks]
    return content, text.of_audit(revision, checks), int(any(check.faults for check in checks))


def _check(check: Checked) -> dict[str, Any]:
    return check._asdict() | {"faults": [fault._asdict() for fault in check.faults]}


def _history(revision: str) -> tuple[Any, str, int]:
    entries = history(resolve(revision))
    content = [entry._asdict() | {"checks": [_check(check) for check in entry.checks]} for entry in entries]
    faults = any(check.faults for entry in entries for check in entry.checks)
    return content, text.of_history(revision, entries), int(faults)


def _rerun(revision: str, stages: list[str]) -> tuple[Any, str, int]:
    with checked_out(revision) as clone:
        commit = Commit(git(clone, "rev-parse", "HEAD").strip(), clone)
        ran = rerun(clone, stages)
        difference = compare(commit, Commit("HEAD", clone))
    content = {"outputs": [output._asdict() for output in ran]} | _as_json(difference)
    return content, text.of_rerun(f"{revision}, run again", ran, difference), _status(difference)


def _rerun_both(before: str, after: str, stages: list[str], profile: str) -> tuple[Any, str, int]:
    with checked_out(before) as first, checked_out(after) as second:
        ran = run_both(first, second, stages, profile)
        git(second, "fetch", "--quiet", str(first), "HEAD")
        difference = compare(Commit("FETCH_HEAD", second), Commit("HEAD", second))
    content = {"outputs": [output._asdict() for output in ran]} | _as_json(difference)
    runs = f"{before}, run twice" if before == after else f"{before} and {after}"
    status = int(not all(output.identical for output in ran)) if before == after else _status(difference)
    return content, text.of_rerun(f"{runs} at profile {profile}", ran, difference), status


def _compare(before: str, after: str) -> tuple[Any, str, int]:
    for revision in (before, after):
        resolve(revision)
    difference = compare(Commit(before), Commit(after))
    return _as_json(difference), text.of_difference(before, after, difference), _status(difference)


def _status(d: Difference) -> int:
    worse = len(d.by_seed) > 0 and (d.by_seed["word"] == "worse").any()
    return int(bool(d.claims) or bool(worse))


def _as_json(d: Difference) -> dict[str, Any]:
    return d._asdict() | {
        "headlines": [line._asdict() | {"change": line.change} for line in d.headlines],
        "modules": d.modules.reset_index().to_dict("records"),
        "by_seed": d.by_seed.to_dict("records"),
    }


def _write(given: argparse.Namespace, content: Any, markdown: str) -> None:
    forms = {"json": lambda: json.dumps(content, indent=2) + "\n", "html": lambda: as_page(markdown)}
    text = forms.get(given.format, lambda: markdown)()
    if given.out:
        atomic_write(given.out, lambda part: part.write_text(text))
    elif given.format == "terminal":
        in_terminal(markdown)
    else:
        print(text, end="")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
