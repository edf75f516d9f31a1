"""What would have to be so for the causal verdicts to be wrong, and what is known of each."""

from pipeline.report.findings.summary import broken, refuted
from pipeline.report.results import Results
from pipeline.report.wording import counted, percent, variant_phrase

SMALLEST = 0.06  # an effect just above the smallest of interest


def doubts(results: Results) -> list[str]:
    """Ways in which a verdict can be wrong, of the variant with the most right ones, each beside its evidence."""
    tallies = results.intervention["verdicts"]
    best = max(results.variants, key=lambda v: tallies[v]["right"])
    regimes = results.selftest["regimes"]
    own, keys = regimes[best], ("false_causes", "family_wise_error")
    named, rejected = (f"{percent(max(r[key] for r in regimes.values()))} ({percent(own[key])})" for key in keys)
    found = [*refuted(results, best), *broken(results, best)]
    weak = min(own["power"], key=lambda effect: abs(float(effect) - SMALLEST))
    elsewhere = f"found so here: {'; '.join(found)}" if found else "no attempt to refute found so here"
    items = results.refutation["items"][best]
    return [
        f"The verdicts of {variant_phrase(best)}, {tallies[best]['right']} of {tallies[best]['cells']} of them right "
        "in this world, can be wrong in another in five ways.",
        "By the graph. If a user minds what the picture does not show, or chooses paths with the table in view, the "
        "difference of means is no effect of the item. No number here could show it; in this world neither is so.",
        f"By chance. Where nothing has an effect, the procedure names one in up to {named} of the families, and "
        f"rejects in up to {rejected}; in brackets, with chance as in this variant's effects.",
        f"By missing it. An effect of {weak} is called one in {percent(own['power'][weak]['effect'])} of the cases, so "
        "“inconclusive” is no “no effect”.",
        "By the table or the camera. Other things than items stand out on it, its top is unlike these, or the picture "
        f"is blurred or noisy (“Worse pictures”); {elsewhere}.",
        f"By the items, if unlike these. The intervals speak of other scenes with these "
        f"{counted(items['items'], 'item')} of a symbol or more; from item to item {items['same']} of {items['cells']} "
        "verdicts stay.",
    ]
