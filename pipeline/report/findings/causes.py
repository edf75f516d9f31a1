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
    percent,
    signed,
    started,
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
        "They are the very cells that the paper prints in bold, as they must be: the world was calibrated to its Table "
        "2."
        if set(true) == printed
        else (f"The paper prints {len(printed)} in bold, {len(printed & set(true))} of them among these.")
    )
    out = [
        f"In truth an added item has an effect on the mean validity in {len(true)} of {total} cells: "
        f"{listed([f'{u} and {s}' for u, s in true])}. {agree} A model that ignores the image shows no effect anywhere "
        f"and so gets {free_right(results)} of {total} verdicts right; that is the null here."
    ]  # fmt: skip
    right = {v: results.intervention["verdicts"][v]["right"] for v in results.variants}
    best = [v for v in results.variants if right[v] == max(right.values())]
    out += [_tally(results, variant, true) for variant in dict.fromkeys([results.main, *best])]
    out += _left_open(results)
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


def _left_open(results: Results) -> list[str]:
    """What it would take to settle the inconclusive cells."""
    parts, power = [], percent(results.selftest["enough_power"], 0)
    for variant in results.variants:
        for user, by_symbol in results.intervention["interventions"][variant].items():
            for symbol in (s for s in SYMBOLS if by_symbol[s]["verdict"] == "inconclusive"):
                cell = results.selftest["precision"][variant]["cells"][user][symbol]
                need = "more seeds, not scenes," if cell["scenes"] is None else f"some {cell['scenes']:,} scenes"
                parts.append(
                    f"{user} and {symbol} by {variant_phrase(variant)} ({signed(by_symbol[symbol]['effect'])}; one of "
                    f"{cell['detectable']:.3f} would be found in {power}; {need} would settle it)"
                )
    return [f"Left open: {'; '.join(parts)}."] if parts else []


def _tally(results: Results, variant: str, true: list[tuple[str, str]]) -> str:
    cells, t = results.intervention["interventions"][variant], results.intervention["verdicts"][variant]
    found = [(u, s) for u, s in true if cells[u][s]["verdict"] == "effect" and cells[u][s]["right"]]
    error = np.mean([abs(cells[u][s]["effect"] - cells[u][s]["truth"]) for u in cells for s in SYMBOLS])
    text = (
        f"{started(variant_phrase(variant))}: {t['right']} of {t['cells']} verdicts right; it finds {len(found)} of "
        f"the {counted(len(true), 'true effect')}"
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


def selftest(results: Results) -> list[str]:
    """How far the procedure itself can be trusted."""
    t = results.selftest
    covered = [r["coverage"] for r in t["regimes"].values()]
    worst = max(t["regimes"], key=lambda name: t["regimes"][name]["family_wise_error"])
    most = t["regimes"][worst]["family_wise_error"]
    named = max(r["false_causes"] for r in t["regimes"].values())
    out = [
        f"In {t['families']:,} simulated families of {t['cells']} null cells a regime, Holm rejects anything in at "
        f"most {percent(most)} (with chance as in {_regime(t, worst)}), and at most {percent(named)} hold a verdict "
        "“effect”. "
        f"The 95 % intervals hold the truth in {percent(min(covered))} to {percent(max(covered))}."
    ]
    level = t["level"]
    error = (level * (1 - level) / t["families"]) ** 0.5
    beyond = [n for n, r in t["regimes"].items() if r["family_wise_error"] > level + 3 * error]
    if beyond:
        out.append(
            f"The level of {percent(level, 0)} is exceeded, by more than simulation error, with chance as in "
            f"{listed([_regime(t, n) for n in beyond])}."
        )
    below = max((e for e in t["regimes"][worst]["power"] if float(e) < t["smallest_effect"]), key=float, default=None)
    if below is not None:
        share = max(r["power"][below]["effect"] for r in t["regimes"].values())
        out.append(
            f"An effect of {below} is there, but below the smallest of interest: it is called an effect, and would be "
            f"tallied as a false cause, in up to {percent(share)}."
        )
    power = t["enough_power"]
    strong = {v: _found_from(t["regimes"][v], power) for v in t["measured"]}
    parts = [f"{variant_phrase(v)} {'none of those tried' if s is None else s}" for v, s in strong.items()]
    out.append(
        f"The smallest effect tried that is found in at least {percent(power, 0)} of the families, with chance as in: "
        f"{listed(parts)}."
    )
    return out


def _regime(selftest: dict, name: str) -> str:
    return variant_phrase(name) if name in selftest["measured"] else f"“{name}”"


def _found_from(regime: dict, power: float) -> str | None:
    return min((e for e, by in regime["power"].items() if by["effect"] >= power), key=float, default=None)


def specifications(results: Results) -> str:
    """do(S := s): whether the users' models differ as the users do."""
    parts = []
    for variant in results.variants:
        by_user = results.intervention["specifications"][variant]
        cells = [c for by_other in by_user.values() for c in by_other.values()]
        parts.append(f"{sum(c['right'] for c in cells)} of {len(cells)} for {variant_phrase(variant)}")
    return (
        "Exchanging the user, do(S := s), asks whether another user's model judges the same paths differently. "
        f"Verdicts that agree with the truth: {listed(parts)} (an exchange and its reverse are one comparison, counted "
        "twice). How many paths are valid to whom can be learned without looking at the image, so this is the easier "
        "question."
    )
