"""What would have to be so for the causal verdicts to be wrong, and what is known of each."""

from pipeline.report.findings.summary import WORLDS_OWN, broken, refuted
from pipeline.report.results import AVERAGED, Results
from pipeline.report.wording import counted, form_phrase, listed, percent, started, variant_phrase
from pipeline.table.forms import OWN

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
    own_form = [
        "By the form. Here as in this model things are capsules, the nearest one that matters decides, and a margin "
        "is all there is to a user's rule; the paper's model and the reward maps were not given this form. "
        f"Of users who go by something else (“Users whose rules are of another form”): {_by_form(results, best)}."
        + _not_told(results)
    ] * (best in WORLDS_OWN)
    return [
        f"The verdicts of {variant_phrase(best)}, {tallies[best]['right']} of {tallies[best]['cells']} of them right "
        f"in this world, can be wrong in another in {'six' if own_form else 'five'} ways.",
        "By the graph. If a user minds what the picture does not show, or chooses paths with the table in view, the "
        "difference of means is no effect of the item. No number here could show it; in this world neither is so.",
        *own_form,
        f"By chance. Where nothing has an effect, the procedure names one in up to {named} of the families, and "
        f"rejects in up to {rejected}; in brackets, with chance as in this variant's effects.",
        f"By missing it. An effect of {weak} is called one in {percent(own['power'][weak]['effect'])} of the cases, so "
        "“inconclusive” is no “no effect”.",
        "By the table or the camera. Other things than items stand out on it, its top is unlike these, or the picture "
        f"is blurred or noisy (“Worse pictures”); {elsewhere}."
        + " What differs from pixel to pixel as shuffled pixels do is no thing to this model: were there an obstacle "
        "of that look, it would not be seen." * (best in WORLDS_OWN),
        f"By the items, if unlike these. The intervals speak of other scenes with these "
        f"{counted(items['items'], 'item')} of a symbol or more; from item to item {items['same']} of {items['cells']} "
        "verdicts stay.",
    ]


def _not_told(results: Results) -> str:
    """What a model that is not told the form makes of the same."""
    found = results.misspecification["forms"]
    forms = [f for f in results.misspecification["order"] if f != OWN and AVERAGED in found[f]["models"]]
    if not forms:
        return ""
    right = listed([percent(found[f]["models"][AVERAGED]["accuracy"]["mean"]) for f in forms])
    return f" {started(variant_phrase(AVERAGED))}, which is told none of them, is right about {right}, in that order."


def _by_form(results: Results, variant: str) -> str:
    """How many verdicts stay true, and how many paths are rightly judged, by rules of other forms."""
    found = results.misspecification
    forms = {f: found["forms"][f] for f in found["order"] if f != OWN and variant in found["forms"][f]["verdicts"]}
    said = [
        f"{form_phrase(form, found['amounts'][form])}, {of['verdicts'][variant]['right']} of "
        f"{of['verdicts'][variant]['cells']} verdicts are true and "
        f"{percent(of['models'][variant]['accuracy']['mean'])} of the answers right"
        for form, of in forms.items()
    ]
    return "; ".join(said) if said else "nothing was asked"
