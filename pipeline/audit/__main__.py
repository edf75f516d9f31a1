"""Audit the results of a commit, or compare those of two. Needs no data, except to run a commit again.

python -m pipeline.audit                     the last commit: do code, parameters, data, locks, pages and README agree?
python -m pipeline.audit REV                 the same of another commit
python -m pipeline.audit BEFORE AFTER        what differs: claims, headlines, parameters, data, packages
python -m pipeline.audit REV --rerun [STAGE ...]
                                             run these stages (default: all of the paper) again in a clean clone, with
                                             the commit's own packages, and compare every output
  --profile PROFILE                          of the rerun, such as smoke: run twice and compare; two commits: run both

Exit status: 0 if everything agrees, or no verdict changed and no headline is worse; 1 if not; 2 for a mistake in use.
"""

import argparse
import sys

import yaml

from pipeline.audit.consistency import audit
from pipeline.audit.difference import Commit, Difference, compare
from pipeline.audit.rerun import outputs, run
from pipeline.audit.text import headlines_ran, of_audit, of_difference, of_rerun
from pipeline.git import checked_out, forget_repository, git, resolve
from pipeline.runtime.errors import InputError, reported


def main(arguments: list[str]) -> int:
    """Run an audit from the command line; return the exit status. Raise InputError for a mistake in use."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.audit", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("revision", nargs="*", default=["HEAD"], help="one commit to audit, or two to compare")
    parser.add_argument("--rerun", nargs="*", metavar="STAGE", help="run these stages again, by default all")
    parser.add_argument("--profile", help="of the rerun, such as smoke: run twice, or two commits, and compare")
    given = parser.parse_args(arguments)
    first, last = given.revision[0], given.revision[-1]
    if len(given.revision) > (2 if given.rerun is None or given.profile else 1):
        raise InputError(f"{len(given.revision)} commits: expected one to audit or to run again, or two to compare")
    if given.profile and given.rerun is None:
        raise InputError(f"--profile {given.profile} wants --rerun: results in git are those of profile paper")
    for revision in given.revision:
        resolve(revision)  # refuse an unknown one before any work
    if given.rerun is not None:
        text, wrong = _rerun(first, last, given.rerun, given.profile)
    elif len(given.revision) == 2:
        difference = compare(Commit(first), Commit(last))
        text, wrong = of_difference(first, last, difference), _is_worse(difference)
    else:
        with checked_out(first) as clone:
            checks = audit(clone)
        text, wrong = of_audit(first, checks), any(check.faults for check in checks)
    print(text, end="")
    return int(wrong)


def _rerun(before: str, after: str, stages: list[str], profile: str | None) -> tuple[str, bool]:
    """Run a commit's stages again and compare with its results; with a profile, run both commits and compare these."""
    with checked_out(before) as first, checked_out(after) as second:
        known = run(first, stages, profile) if profile else outputs(first)
        same = {output: known.get(output) == md5 for output, md5 in run(second, stages, profile).items()}
        git(second, "fetch", "--quiet", str(first), "HEAD")
        difference = compare(Commit("FETCH_HEAD", second), Commit("HEAD", second))
    runs, wrong = f"{before} and {after}", _is_worse(difference)
    if before == after:
        runs = f"{before}, run {'twice' if profile else 'again'}"
        only_bytes = profile or not headlines_ran(same)
        wrong = not all(same.values()) if only_bytes else wrong
    title = f"{runs} at profile {profile}" if profile else runs
    return of_rerun(title, same, difference), wrong


def _is_worse(d: Difference) -> bool:
    return bool(d.claims) or (len(d.by_seed) > 0 and bool((d.by_seed["word"] == "worse").any()))


if __name__ == "__main__":
    forget_repository()
    with reported(OSError, yaml.YAMLError):
        sys.exit(main(sys.argv[1:]))
