"""Tables of a sweep's page."""

import pandas as pd

from pipeline.audit.difference import p_text, untested
from pipeline.report.style import label
from pipeline.report.tables import FORMATS, Table, pick, with_gaps
from pipeline.sweep.results import LOWER_IS_BETTER
from pipeline.sweep.summary import Summary

RATES = ("accuracy", "repair")  # shown in per cent, differences in points
WORDS = {"better": "better", "worse": "worse", "same": "same within 1 point", "undecided": "undecided"}
MAX_SHOWN = 4  # headlines beside one another in a table
KINDS = {"accuracy_one_demo": "accuracy with one demonstration", "effect_error": "largest effect error"}
DIFFERENCE = {"difference": "Difference", "interval": "95 % interval", "p": "p (Holm)"}


def title(headline: str) -> str:
    """Return a headline in words: accuracy.full.new_items as Accuracy, paper's model, unseen items."""
    kind, *rest = headline.split(".")
    text = ", ".join([KINDS.get(kind, kind.replace("_", " ")), *(label(part) for part in rest)])
    return text[:1].upper() + text[1:]


def best(summary: Summary) -> list[dict]:
    """Return a row for each changed headline: the best setting, its mean, the reference's, and their difference.

    A row has the columns of `paired` and `untested`; only the word `reference` where that is the best setting.
    """
    rows = []
    for headline in summary.headlines:
        means = summary.means[summary.means["headline"] == headline].set_index("setting")["mean"]
        setting = means.idxmin() if headline.startswith(LOWER_IS_BETTER) else means.idxmax()
        row = {"headline": headline, "setting": setting, "mean": means[setting], "reference": means[summary.reference]}
        test = summary.differences.query("headline == @headline and setting == @setting")
        found = [tested.to_dict() | {"untested": untested(tested)} for _, tested in test.iterrows()]
        rows.append(row | (found or [{"word": "reference"}])[0])
    return rows


def with_texts(rows: pd.DataFrame, number: str) -> pd.DataFrame:
    """Return rows of `paired` with their interval, in one of FORMATS, or why there is none, and p, as text."""
    write = FORMATS[number]
    intervals = [untested(row) or f"{write(row.ci_low)} to {write(row.ci_high)}" for row in rows.itertuples()]
    return rows.assign(interval=intervals, p=rows["p_holm"].map(p_text))


def verdicts(summary: Summary) -> Table:
    """Return the best setting by headline, and whether it differs from the reference."""
    columns = {"headline": "Result", "reference": "Reference", "setting": "Best setting", "mean": "Its mean"}
    columns |= DIFFERENCE | {"word": "Than the reference"}
    rows = pd.DataFrame(best(summary))
    compared = rows["word"] != "reference"
    rows = pd.concat([rows[~compared], *([with_texts(rows[compared], "fine")] if compared.any() else [])]).sort_index()
    rows = rows.reindex(columns=list(columns))
    words = WORDS | {"reference": "is the reference"}
    formats = dict.fromkeys(["Reference", "Its mean", "Difference"], "fine")
    return Table(with_gaps(pick(rows, columns, headline=title, word=words)), formats)


def settings(summary: Summary) -> Table:
    """Return the mean and quartiles over seeds of the first changed headlines, a row a setting."""
    wide = summary.means.pivot(index="setting", columns="headline").reindex(summary.means["setting"].unique())
    ends = {"mean": "", "q1": ", q1", "q3": ", q3"}
    cells = {title(h) + end: wide[name, h] for h in summary.headlines[:MAX_SHOWN] for name, end in ends.items()}
    formats = {name: "pct1" if name.lower().startswith(RATES) else "fine" for name in cells}
    return Table(with_gaps(pd.DataFrame(cells).rename_axis("Setting").reset_index()), formats)


def differences(summary: Summary) -> Table:
    """Return every paired difference from the reference."""
    columns = {"headline": "Result", "setting": "Setting"} | DIFFERENCE
    columns |= {"seeds": "Seeds", "word": "Than the reference"}
    formats = {"Difference": "fine", "Seeds": "count"}
    return Table(with_gaps(pick(with_texts(summary.differences, "fine"), columns, headline=title, word=WORDS)), formats)


def comparisons(summary: Summary) -> Table:
    """Return every comparison of variants within a setting."""
    columns = {"setting": "Setting", "variant": "Model", "against": "Against", "split": "On", "after": "Accuracy"}
    columns |= {"before": "Of the other"} | DIFFERENCE | {"word": "Than the other"}
    formats = dict.fromkeys(["Accuracy", "Of the other"], "pct1") | {"Difference": "points1"}
    rows = with_texts(summary.comparisons, "points1")
    shown = pick(rows, columns, variant=label, against=label, split=label, word=WORDS)
    return Table(with_gaps(shown), formats)


def broken(summary: Summary) -> Table:
    """Return the jobs without a result."""
    jobs = [job for job in summary.jobs if job["state"] != "done"]
    return Table(with_gaps([{"Job": j["name"], "State": j["state"], "Why": j.get("error", "")} for j in jobs]))
