"""Audit every commit of a history that changed the results."""

from contextlib import suppress
from dataclasses import dataclass

from pipeline.audit.consistency import Checked, audit
from pipeline.audit.difference import CLAIM, METRICS, Commit
from pipeline.audit.revision import checked_out
from pipeline.git import git
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT


@dataclass(frozen=True)
class Entry:
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
        verdicts, checks = dict[str, str](), list[Checked]()
        with suppress(InputError):  # the commit removed its headlines
            found = Commit(commit).headlines()
            verdicts = {name.removeprefix(CLAIM): str(found[name]) for name in found if name.startswith(CLAIM)}
        with suppress(InputError, KeyError, ValueError), checked_out(commit) as clone:  # the first edition's folders
            checks = audit(clone)
        known = {claim: verdict for claim, verdict in verdicts.items() if claim in before}
        changed = [(claim, before[claim], verdict) for claim, verdict in known.items() if before[claim] != verdict]
        before = verdicts or before
        date, subject = git(ROOT, "log", "-1", "--format=%cs%n%s", commit).strip().split("\n", 1)
        entries.append(Entry(commit[:8], date, subject, checks, changed))
    return entries
