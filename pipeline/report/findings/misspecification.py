"""What is left of the models where users' rules are of another form than the world's own."""

from pipeline.report.results import POSITION, Results
from pipeline.report.wording import form_phrase, interval, listed, percent, points, started, variant_phrase
from pipeline.table.forms import OWN


def misspecification(results: Results) -> list[str]:
    """Form by form: how right each variant still is, beside the null; its verdicts; and where a reader would see it."""
    forms = results.misspecification["forms"]
    variants = [v for v in results.variants if v in forms[OWN]["models"]]
    own = [f"{variant_phrase(v)} {percent(forms[OWN]['models'][v]['accuracy']['mean'])}" for v in variants]
    out = [f"Fitted and judged by the users' own margins, as a control, right are {listed(own)} of the answers."]
    out += [_form(results, form, variants) for form in results.misspecification["order"] if form != OWN]
    return [*out, _seen(results, variants)]


def _form(results: Results, form: str, variants: list[str]) -> str:
    found = results.misspecification["forms"][form]
    models, tallies = found["models"], found["verdicts"]
    said = [
        f"{variant_phrase(v)} is right about {percent(models[v]['accuracy']['mean'])} "
        f"({_changed(models[v])}{_beaten(models, v)}), "
        f"with {tallies[v]['right']} of {tallies[v]['cells']} verdicts true" + _wrong(results, form, v)
        for v in variants
    ]
    return (
        f"{started(form_phrase(form, results.misspecification['amounts'][form]))} ({percent(found['forgiven'], 0)} of "
        f"the paths that break a margin are forgiven; position alone {percent(models[POSITION]['accuracy']['mean'])}): "
        f"{'; '.join(said)}."
    )


def _beaten(models: dict, variant: str) -> str:
    null = models[POSITION]["accuracy"]["mean"]
    return "" if models[variant]["accuracy"]["mean"] > null else "; no more than position alone"


def _seen(results: Results, variants: list[str]) -> str:
    """What the demonstrations themselves would tell whoever fits a model and does not know the truth."""
    found = results.misspecification

    def own(variant: str) -> str:
        shares = {f: percent(found["forms"][f]["models"][variant]["demonstrations"]["mean"]) for f in found["order"]}
        others = listed([share for form, share in shares.items() if form != OWN])
        return (
            f"{variant_phrase(variant)} is right about {shares[OWN]} by the users' own margins, by the others {others}"
        )

    return (
        "Would whoever fits a model see it without the truth? Of the very demonstrations that it was fitted to, "
        f"{'; '.join(map(own, variants))}."
    )


def _changed(cell: dict) -> str:
    """What the form takes from or adds to the accuracy, with its interval."""
    lost = -cell["difference"]
    ends = {"ci_low": -cell["ci_high"], "ci_high": -cell["ci_low"]}
    return f"{points(lost)} less, {interval(ends)}" if lost >= 0 else f"{points(-lost)} more, {interval(cell)}"


def _wrong(results: Results, form: str, variant: str) -> str:
    """The cells whose verdict is not the true one, by how it is wrong."""
    cells = results.misspecification["forms"][form]["interventions"][variant]
    by_kind: dict[str, list[str]] = {}
    for user, by_symbol in cells.items():
        for symbol, c in by_symbol.items():
            if not c["right"]:
                kind = {"effect": "false", "inconclusive": "open"}.get(c["verdict"], "missed")
                by_kind.setdefault(kind, []).append(f"{symbol} to {user}")
    return f" ({'; '.join(f'{kind}: {listed(of)}' for kind, of in by_kind.items())})" if by_kind else ""
