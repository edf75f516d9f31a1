"""What is left of the models where users' rules are of another form than the world's own."""

from pipeline.report.results import POSITION, Results
from pipeline.report.tables.misspecification import OWN
from pipeline.report.wording import form_phrase, interval, listed, percent, points, started, variant_phrase


def misspecification(results: Results) -> list[str]:
    """Form by form: how right each variant still is, beside the null and its rivals; then the causes."""
    forms = results.misspecification["forms"]
    variants = [v for v in results.variants if v in forms[OWN]["models"]]
    own = [f"{variant_phrase(v)} {percent(forms[OWN]['models'][v]['accuracy']['mean'])}" for v in variants]
    out = [f"Fitted and judged by the users' own margins, as a control, right are {listed(own)} of the answers."]
    return out + [_form(results, form, variants) for form in results.misspecification["order"] if form != OWN]


def _form(results: Results, form: str, variants: list[str]) -> str:
    found = results.misspecification["forms"][form]
    models, tallies = found["models"], found["verdicts"]
    said = [
        f"{variant_phrase(v)} is right about {percent(models[v]['accuracy']['mean'])} "
        f"({_changed(models[v])}), with {tallies[v]['right']} of {tallies[v]['cells']} verdicts true"
        + _wrong(results, form, v)
        for v in variants
    ]
    return (
        f"{started(form_phrase(form, results.misspecification['amounts'][form]))} ({percent(found['forgiven'], 0)} of "
        f"the paths that break a margin are forgiven; position alone {percent(models[POSITION]['accuracy']['mean'])}): "
        f"{'; '.join(said)}."
    )


def _changed(cell: dict) -> str:
    """What the form takes from or adds to the accuracy, with its interval."""
    lost = -cell["difference"]
    ends = {"ci_low": -cell["ci_high"], "ci_high": -cell["ci_low"]}
    return f"{points(lost)} less, {interval(ends)}" if lost >= 0 else f"{points(-lost)} more, {interval(cell)}"


def _wrong(results: Results, form: str, variant: str) -> str:
    """The cells whose verdict is not the true one, and how they are wrong."""
    cells = results.misspecification["forms"][form]["interventions"][variant]
    wrong = [
        f"{user} and {symbol}: {c['verdict']} ({c['effect']:+.3f}), in truth {c['truth_verdict']} ({c['truth']:+.3f})"
        for user, by_symbol in cells.items()
        for symbol, c in by_symbol.items()
        if not c["right"]
    ]
    return f" ({'; '.join(wrong)})" if wrong else ""
