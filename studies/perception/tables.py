"""Items found by kind of table top and detector; accuracy, verdicts and search of clearance models."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.study import Study

DETECTORS = {
    "segmenter": "Segmenter",
    "segmenter_empty": "Segmenter, empty table",
}
BLIND = {"position_only": "Position only (image-blind)"}  # one prediction for all training sets
DRAWN = {"val_scenes": "drawn, items known", "val_items": "drawn, items unseen"}
KINDS = {"taught": "taught", "held_out": "held out"}
SEARCH = {
    "success": "Success", "success_ci_low": "low", "success_ci_high": "high", "unsafe": "Unsafe",
    "displacement_ratio": "Displacement",
}  # fmt: skip
EFFECT = {"effect": "Effect", "ci_low": "low", "ci_high": "high", "truth": "Truth"}


def source_name(source: str) -> str:
    """Return a pool of drawn scenes, or a path-traced split such as `test_held_out`, in words."""
    if source in DRAWN:
        return DRAWN[source]
    protocol, _, kind = source.partition("_")
    return f"{protocol}, {KINDS.get(kind, kind)}"


def by_kind(study: Study) -> Table:
    """Return recall, outlines and errors of each detector on families of tops taught and held out."""
    table = study.table("summary.csv", finite=("recall", "iou", "made_up"))
    shown = pd.DataFrame(
        {
            "Table tops": table["kind"].map(KINDS), "Detector": table["detector"].map(DETECTORS),
            "Items": table["items"], "Found": table["recall"], "Overlap": table["iou"], "Made up": table["made_up"],
        }
    )  # fmt: skip
    return Table(shown, dict.fromkeys(["Found", "Overlap", "Made up"], "pct1"))


def by_source(study: Study) -> Table:
    """Return accuracy, the mean over users, in each source; for the headlines also on each kind of table top."""
    table = study.table("accuracy.csv", finite=("accuracy", "q1", "q3"))
    table = table[(table["user"] == "all") & ((table["top"] == "all") | table["source"].isin(_headlines(study)))]
    rows = []
    for source in [*DRAWN, *study.settings["rendered"]]:
        by_top = dict(list(table[table["source"] == source].groupby("top", sort=False)))
        for top in ["all", *(top for top in by_top if top != "all")]:
            row = {"Scenes": source_name(source), "Table tops": top, "n": by_top[top]["scenes"].iloc[0]}
            for _, one in by_top[top].iterrows():
                if top != "all" and one["detector"] in BLIND:
                    continue
                title = (DETECTORS | BLIND)[one["detector"]]
                row[title] = one["accuracy"]
                if top == "all" and one["detector"] in DETECTORS:
                    row |= {f"{title}, q1": one["q1"], f"{title}, q3": one["q3"]}
            rows.append(row)
    return Table(with_gaps(rows), dict.fromkeys([*DETECTORS.values(), *BLIND.values()], "pct1"))


def verdicts(study: Study) -> Table:
    """Return the right verdicts on added items, and the effect that is furthest from the truth, per split."""
    table = study.table("verdicts.csv", finite=tuple(EFFECT))
    rows = []
    for (source, detector), part in table.groupby(["source", "detector"], sort=False):
        worst = part.loc[(part["effect"] - part["truth"]).abs().idxmax()]
        row = {"Scenes": source_name(source), "Sees": DETECTORS[detector]}
        row["Right"] = f"{part['right'].sum()} of {len(part)}"
        row["Furthest from the truth"] = f"{style.label(worst['user'])}, {style.label(worst['symbol'])}"
        rows.append(row | {title: worst[column] for column, title in EFFECT.items()})
    return Table(pd.DataFrame(rows), dict.fromkeys(EFFECT.values(), "fine"))


def search(study: Study) -> Table:
    """Return success, unsafe ends and length of the search from the start, per split and user."""
    table = study.table("search.csv", finite=tuple(SEARCH))
    frame = pick(
        table,
        {"source": "Scenes", "detector": "Sees", "user": "User"} | SEARCH,
        source=source_name, detector=DETECTORS, user=style.label,
    )  # fmt: skip
    return Table(frame, dict.fromkeys(list(SEARCH.values())[:-1], "pct1") | {"Displacement": "rate"})


def _headlines(study: Study) -> list[str]:
    """Return the splits of metrics.json."""
    return list(study.settings["headlines"].values())
