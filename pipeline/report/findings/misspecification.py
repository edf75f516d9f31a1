"""What is left of the models where users' rules are of another form than the world's own."""

from pipeline.report.results import AVERAGED, POSITION, Results
from pipeline.report.wording import (
    believed_label,
    form_label,
    form_phrase,
    listed,
    percent,
    points,
    signed,
    started,
    variant_phrase,
)
from pipeline.table.forms import OWN


def misspecification(results: Results) -> list[str]:
    """Form by form: how right each variant still is, beside the null; its verdicts; and where a reader would see it."""
    forms = results.misspecification["forms"]
    variants = [v for v in (*results.variants, AVERAGED) if v in forms[OWN]["models"]]
    own = [f"{variant_phrase(v)} {percent(forms[OWN]['models'][v]['accuracy']['mean'])}" for v in variants]
    out = [f"Fitted and judged by the users' own margins, as a control, right are {listed(own)} of the answers."]
    out += [_form(results, form, variants) for form in results.misspecification["order"] if form != OWN]
    return [*out, *_believed(results), _seen(results, variants)]


def _form(results: Results, form: str, variants: list[str]) -> str:
    found = results.misspecification["forms"][form]
    models, tallies = found["models"], found["verdicts"]
    said = [
        f"{variant_phrase(v)} is right about {percent(models[v]['accuracy']['mean'])} "
        f"({_changed(models[v])}{_beaten(models, v)}), "
        f"{tallies[v]['right']} of {tallies[v]['cells']} verdicts true" + _wrong(results, form, v)
        for v in variants
    ]
    return (
        f"{started(form_phrase(form, results.misspecification['amounts'][form]))} ({percent(found['forgiven'], 0)} of "
        f"the paths that break a margin are forgiven; position alone {percent(models[POSITION]['accuracy']['mean'])}): "
        f"{'; '.join(said)}."
    )


def _beaten(models: dict, variant: str) -> str:
    """Whether it is better than a guess by position alone, by more than other seeds and scenes might undo."""
    over = models[variant]["over_position"]
    if over["ci_low"] > 0:
        return ""
    found = "worse than" if over["ci_high"] < 0 else "not told from"
    more, low, high = (signed(100 * over[name], 1) for name in ("difference", "ci_low", "ci_high"))
    return f"; {found} position alone: {more} points, 95 % interval {low} to {high}"


def _believed(results: Results) -> list[str]:
    """Whether the averaged models believe most in the form that the rule has."""
    found = results.misspecification
    cells = {f: found["forms"][f]["credence"] for f in found["order"] if "credence" in found["forms"][f]}
    if not cells:
        return []
    models = len(found["users"]) * found["seeds"]
    named = [
        f"{form_label(form).lower()} in {c['most'][c['meant']]}" for form, c in cells.items() if c["meant"] is not None
    ]
    strange = []
    for form, c in cells.items():
        if c["meant"] is None:
            most = max(c["most"], key=lambda name: c["most"][name])
            strange.append(
                f"By {form_label(form).lower()} none of its forms is the rule's; most often, in {c['most'][most]}, it "
                f"believes most in {believed_label(most).lower()}."
            )
    return [
        f"Of {models} models averaged over forms, those that believe most in the form which the rule has: "
        f"{listed(named)}. {' '.join(strange)}".rstrip()
    ]


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
    """What the form takes from or adds to the accuracy; its interval is in the table."""
    return f"{points(cell['difference'])} {'less' if cell['difference'] <= 0 else 'more'}"


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
