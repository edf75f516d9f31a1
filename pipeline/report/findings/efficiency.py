"""How much data the models need."""

from collections.abc import Sequence
from math import log

import pandas as pd

from pipeline.report.results import POSITION, Results
from pipeline.report.wording import counted, listed, percent, percent_spread, split_phrase, variant_phrase

ALIKE = 1.2  # numbers of labels whose ratio is at most this are called about as many


def efficiency(results: Results) -> list[str]:
    """Where each model reaches the threshold, what more scenes give, and how labels are best spent."""
    return [text for text in (_in_scenes(results), _in_n(results), _growth(results), _spent(results)) if text]


def _in_scenes(results: Results) -> str:
    e, variants = results.efficiency, results.refitted
    most = max(size for variant in variants for size in results.sizes(variant))
    there, others = _apart(results, variants, "scenes")
    with_scenes = [
        f"{variant_phrase(v)} with {counted(least, 'training scene')} ({percent_spread(e['accuracy'][v][f's{least}'])})"
        for v, least in there.items()
    ]
    lead = f"On {split_phrase(e['split'])}, {percent(e['threshold'], 0)} of the paths are judged rightly by "
    each = f"each with {counted(results.study_n, 'demonstration')}"
    if not there:
        return f"{lead}none of {listed(others)} with up to {counted(most, 'training scene')}, {each}."
    return f"{lead}{listed(with_scenes)}, {each}" + (f"; not by {listed(others)} with up to {most}." if others else ".")


def _in_n(results: Results) -> str:
    there, others = _apart(results, results.variants, "n")
    with_n = [f"{variant_phrase(v)} (with {counted(least, 'demonstration')} in each)" for v, least in there.items()]
    lead, most = f"With {counted(results.per_seed, 'training scene')}, ", counted(max(results.ns), "demonstration")
    if not there:
        return f"{lead}no model gets there by up to {most} in each."
    return f"{lead}those that get there are: {listed(with_n)}" + (f"; not {listed(others)}." if others else ".")


def _apart(results: Results, variants: Sequence[str], amount: str) -> tuple[dict[str, int], list[str]]:
    """The least amount of those variants that reach the threshold, and the phrases of the others."""
    least = {v: results.efficiency["reaches"][v][amount] for v in variants}
    return {v: x for v, x in least.items() if x is not None}, [variant_phrase(v) for v, x in least.items() if x is None]


def _growth(results: Results) -> str:
    """From the fewest scenes to the most."""
    cells, null = results.efficiency["accuracy"], percent(results.efficiency["null"]["mean"])
    first, *_, last = results.sizes(results.refitted[0])
    parts = []
    for variant in results.refitted:
        low, high = (percent(cells[variant][f"s{size}"]["mean"]) for size in (first, last))
        parts.append(f"{variant_phrase(variant)} from {low} to {high}")
    lead = f"Going from {first} to {last} training scenes takes {listed(parts)}"
    return f"{lead}; {variant_phrase(POSITION)} stands at {null}."


def _spent(results: Results) -> str:
    """About as many labels in fewer scenes and in more, for models that see something."""
    curve, parts, sets = results.efficiency_curve, [], ""
    own, null = f"s{results.per_seed}", results.efficiency["null"]["mean"]
    for variant in (v for v in results.refitted if results.efficiency["accuracy"][v][own]["mean"] > null):
        rows = curve[curve["variant"] == variant]
        pair = _alike(
            rows[(rows["n"] == results.study_n) & (rows["scenes"] < results.per_seed)],
            rows[(rows["scenes"] == results.per_seed) & (rows["n"] < results.study_n)],
        )
        if pair:
            few, many = pair
            parts.append(f"{variant_phrase(variant)} {percent_spread(many)} against {percent_spread(few)}")
            sets = " against ".join(
                f"{x['scenes']:.0f} scenes with {counted(int(x['n']), 'demonstration')} each "
                f"({x['demonstrations']:.0f} labels)"
                for x in (many, few)
            )
    lead = f"About as many labels can be spread wide or heaped: {sets} give"
    return f"{lead} {listed(parts)} (mean [quartiles over seeds])." if parts else ""


def _alike(few: pd.DataFrame, many: pd.DataFrame) -> tuple[dict, dict] | None:
    """A row of each whose numbers of labels are nearest to one another; None if all are far apart."""
    pairs = [(a, b) for a in few.to_dict("records") for b in many.to_dict("records")]
    ratios = [abs(log(a["demonstrations"] / b["demonstrations"])) for a, b in pairs]
    near = min(range(len(pairs)), key=ratios.__getitem__, default=None)
    return pairs[near] if near is not None and ratios[near] <= log(ALIKE) else None
