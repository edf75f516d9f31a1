"""Audit every commit of a history that changed the results."""

from typing import NamedTuple

from pipeline.audit.consistency import Checked, audit
from pipeline.audit.difference import CLAIM, Commit
from pipeline.audit.revision import checked_out, git
from pipeline.config.graph import ROOT
from pipeline.runtime.errors import InputError

METRICS = "reports/metrics.json"


class Entry(NamedTuple):
    """One commit with results: what it says it is, what its audit found, and which claims changed their verdict."""

    commit: str
    date: str
    subject: str
    checks: list[Checked]  # empty if the commit cannot be audited
    claims: list[tuple[str, str, str]]  # claim, verdict in the commit with results before, verdict


def with_results(revision: str) -> list[str]:
    """Return the hashes of the commits up to `revision` that changed the headlines, the oldest first."""
    return git(ROOT, "log", "--reverse", "--format=%H", revision, "--", METRICS).split()


def history(revision: str) -> list[Entry]:
    """Return the audit of every commit with results up to `revision`; takes some 20 s a commit."""
    entries, before = [], dict[str, str]()
    for commit in with_results(revision):
        verdicts = {name: str(value) for name, value in _headlines(commit).items() if name.startswith(CLAIM)}
        changed = [
            (name.removeprefix(CLAIM), before[name], verdict)
            for name, verdict in verdicts.items()
            if name in before and before[name] != verdict
        ]
        before = verdicts or before
        date, subject = git(ROOT, "log", "-1", "--format=%cs%n%s", commit).strip().split("\n", 1)
        entries.append(Entry(commit[:8], date, subject, _checks(commit), changed))
    return entries


def _headlines(commit: str) -> dict[str, object]:
    try:
        return Commit(commit).headlines()
    except InputError:  # the commit removed them
        return {}


def _checks(commit: str) -> list[Checked]:
    try:
        with checked_out(commit) as clone:
            return audit(clone)
    except (InputError, KeyError, ValueError):  # of the first edition, whose folders were others
        return []
