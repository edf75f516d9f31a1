"""Write an audit as Markdown."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.audit.consistency import Checked, Fault
from pipeline.audit.difference import METRICS, Difference, untested

WORDS = ("worse", "better", "undecided", "same")  # in the order of a report
PAIRED = ("word", "headline", "before", "after", "difference (95 % interval)", "p (Holm)", "seeds")
MAX_CELL = 80  # characters
MAX_LINES = 30  # of a list


def of_audit(revision: str, checks: Sequence[Checked]) -> str:
    """Return the result of all checks of a commit."""
    faults = sum(len(check.faults) for check in checks)
    verdict = f"{faults} fault{'s' * (faults != 1)}" if faults else "everything agrees"
    rows = [(check.what, check.items, len(check.faults), check.unchecked) for check in checks]
    wrong = {f"{check.what}: not so": _faults(check.faults) for check in checks}
    return _page(f"Audit of {revision}: {verdict}", table(["check", "items", "faults", "unchecked"], rows), wrong)


def _faults(faults: Sequence[Fault]) -> str:
    """Return a line a message, with the places that share it."""
    places: dict[str, list[str]] = {}
    for fault in faults:
        places.setdefault(fault.message, []).append(f"`{fault.place.replace('/dvc.yaml', '')}`")
    counts = {message: f" ({len(names)})" if len(names) > 1 else "" for message, names in places.items()}
    return items(f"{message}{counts[message]}: {', '.join(names)}" for message, names in places.items())


def of_rerun(title: str, identical: Mapping[tuple[str, str], bool], d: Difference) -> str:
    """Return what running a commit again gave: how many outputs have the same bytes, and what that did to results.

    identical: by stage and path, whether an output has the same bytes as in the run that it is compared with.
    """
    other = [output for output, same in identical.items() if not same]
    same = headlines_ran(identical) and not d.claims and len(d.by_seed) and (d.by_seed["word"] == "same").all()
    word = ("equal" if same else "changed") if other else "identical"
    count = f"{len(identical) - len(other)} of {len(identical)} outputs have the same bytes."
    return _page(f"{title}: {word}", count, {"Other outputs": table(["stage", "output"], other)} | _differences(d))


def headlines_ran(outputs: Iterable[tuple[str, str]]) -> bool:
    """Return whether the stages that ran again wrote the headlines; if not, only bytes can be compared."""
    return any(path == METRICS for _, path in outputs)


def of_difference(before: str, after: str, d: Difference) -> str:
    """Return what differs between two commits: first counts of claims and headlines, last their possible causes."""
    sections = _differences(d)
    counts = d.by_seed["word"].value_counts() if len(d.by_seed) else {}
    words = ", ".join(f"{counts[word]} {word}" for word in WORDS if word in counts) or "no headlines by seed"
    lead = f"Verdicts that changed: {len(d.claims)}. Headlines: {words}."
    return _page(f"{before} to {after}", lead if any(sections.values()) else f"{lead}\n\nNothing differs.", sections)


def _differences(d: Difference) -> dict[str, str]:
    """Return the sections of a difference by title; "" where nothing differs."""
    known = set(d.by_seed["headline"]) if len(d.by_seed) else set()
    headlines = [line for line in d.headlines if line[0] not in known]
    return {
        "Claims whose verdict changed": table(["claim", "before", "after"], d.claims),
        "Headlines, paired by seed": _paired(d.by_seed),
        "Other headlines that changed": _of_both(["headline", "before", "after", "change"], headlines),
        "Parameters": _of_both(["parameter", "before", "after"], d.parameters),
        "Data": items(f"`{path}`" for path in d.data),
        "Packages": items(f"`{line}`" for line in d.packages),
        "Processors": table(["before", "after", "stages"], d.processors),
    }


def _of_both(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return the table of the names (first column) that both commits have, and how many only one of them has."""
    rows = list(rows)
    gone, new = (sum(row[place] is None for row in rows) for place in (2, 1))
    both = [(f"`{row[0]}`", *row[1:]) for row in rows if row[1] is not None and row[2] is not None]
    counts = f"Only before: {gone}. Only after: {new}." if gone or new else ""
    return "\n\n".join(part for part in (table(head, both), counts) if part)


def _paired(by_seed: pd.DataFrame) -> str:
    """Return the table of paired headlines, the worse ones first; those without any change are only counted."""
    if not len(by_seed):
        return ""
    zero = (by_seed["word"] == "same") & (by_seed[["difference", "ci_low", "ci_high"]].fillna(0) == 0).all(axis=1)
    rows = []
    for row in by_seed[~zero].sort_values("word", key=lambda words: words.map(WORDS.index)).itertuples():
        interval = untested(row) or f"{row.ci_low:.2g} to {row.ci_high:.2g}"
        difference = f"{row.difference:+.3g} ({interval})"
        p = None if pd.isna(row.p_holm) else "< 0.001" if row.p_holm < 0.001 else f"{row.p_holm:.3f}"
        rows.append((row.word, f"`{row.headline}`", row.before, row.after, difference, p, row.seeds))
    same = f"{'Others' if rows else 'Headlines'} with the same values for every seed: {zero.sum()}."
    return "\n\n".join(part for part in (table(PAIRED, rows), same if zero.any() else "") if part)


def _page(title: str, lead: str, sections: Mapping[str, str]) -> str:
    """Return Markdown: a title, what comes first, and the sections that are not empty."""
    parts = [f"## {title}\n\n{content}" for title, content in sections.items() if content]
    return "\n\n".join([f"# {title}", lead, *parts]) + "\n"


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table of at most MAX_LINES rows; "" if there are no rows."""
    lines = ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]
    more = [f"| ... {len(lines) - MAX_LINES} more" + " |" * len(head)] if len(lines) > MAX_LINES else []
    first = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"] if lines else []
    return "\n".join([*first, *lines[:MAX_LINES], *more])


def items(lines: Iterable[str]) -> str:
    """Return a Markdown list of at most MAX_LINES lines; "" if there are none."""
    every = list(lines)
    more = [f"- ... {len(every) - MAX_LINES} more"] if len(every) > MAX_LINES else []
    return "\n".join([f"- {line}" for line in every[:MAX_LINES]] + more)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    text = text if len(text) <= MAX_CELL else f"{text[: MAX_CELL - 3]}..."
    return text.replace("|", "\\|").replace("\n", " ")
