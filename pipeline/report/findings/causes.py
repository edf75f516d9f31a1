"""What asking 'what if?' reveals about each model, and how much of it is true."""

import numpy as np

from pipeline.report import paper
from pipeline.report.claims import (
    free_right,
)
from pipeline.report.results import Results
from pipeline.report.wording import (
    counted,
    listed,
    variant_phrase,
)
from pipeline.table.layout import SYMBOLS


def interventions(results: Results) -> list[str]:
    """What asking 'what if one more item stood there?' reveals about each model, and how much of it is true."""
    cells = results.intervention["interventions"]
    true = [(u, s) for u in results.users for s in SYMBOLS if cells[results.main][u][s]["truth_verdict"] == "effect"]
    printed = {(u, s) for u, s in paper.BOLD if u in results.users}
    total = len(results.users) * len(SYMBOLS)
    agree = (
        "They are the very cells that the paper prints in bold."
        if set(true) == printed
        else (f"The paper prints {len(printed)} in bold, {len(printed & set(true))} of them among these.")
    )
    out = [
        f"In truth an added item changes the mean validity by more than 0.05 in {len(true)} of {total} cells: "
        f"{listed([f'{u} and {s}' for u, s in true])}. {agree} A model that ignores the image shows no effect anywhere "
        f"and so gets {free_right(results)} of {total} verdicts right; that is the null here."
    ]  # fmt: skip
    right = {v: results.intervention["verdicts"][v]["right"] for v in results.variants}
    best = [v for v in results.variants if right[v] == max(right.values())]
    out += [_tally(results, variant, true) for variant in dict.fromkeys([results.main, *best])]
    free = [u for u in results.users if results.demos.loc[results.demos["user"] == u, "valid"].all()]
    silent = [u for u in free if all(c["verdict"] == "no effect" for v in cells.values() for c in v[u].values())]
    if silent:
        out.append(
            f"Every demonstration of the {listed(silent)} user is valid. A model shown a single answer learns to "
            f"repeat it: "
            f"no variant shows an effect in these {counted(len(silent) * len(SYMBOLS), 'cell')}, and being right "
            f"there proves nothing."
        )
    return out


def _tally(results: Results, variant: str, true: list[tuple[str, str]]) -> str:
    cells, t = results.intervention["interventions"][variant], results.intervention["verdicts"][variant]
    found = [(u, s) for u, s in true if cells[u][s]["verdict"] == "effect" and cells[u][s]["right"]]
    error = np.mean([abs(cells[u][s]["effect"] - cells[u][s]["truth"]) for u in cells for s in SYMBOLS])
    text = (
        f"{_start(variant_phrase(variant))}: {t['right']} of {t['cells']} verdicts right; it finds {len(found)} of the "
        f"{counted(len(true), 'true effect')}"
    )
    if t["false_causes"]:
        text += f", names {counted(t['false_causes'], 'false cause')}"
    if t["missed_causes"]:
        text += f", denies {counted(t['missed_causes'], 'real one')}"
    if t["inconclusive"]:
        text += f" and leaves {t['inconclusive']} open"
    return (
        text + f" (mean distance of its effects from the true ones {error:.3f}; {counted(len(results.seeds), 'seed')})."
    )


def _start(text: str) -> str:
    return text[0].upper() + text[1:]


def specifications(results: Results) -> str:
    """do(S := s): whether the users' models differ as the users do."""
    parts = []
    for variant in results.variants:
        by_user = results.intervention["specifications"][variant]
        cells = [c for by_other in by_user.values() for c in by_other.values()]
        parts.append(f"{sum(c['right'] for c in cells)} of {len(cells)} for {variant_phrase(variant)}")
    return (
        "Exchanging the user, do(S := s), asks whether another user's model judges the same paths differently. "
        "Verdicts that "
        f"agree with the truth: {listed(parts)}. How many paths are valid to whom can be learned without looking at "
        f"the image, "
        "so this is the easier question."
    )
