"""Pictures of unit counterfactuals."""

from functools import partial

from pipeline.report.figures import counterfactuals
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import listed, percent, variant_phrase


def blame(results: Results) -> Picture:
    """How often the right item is blamed."""
    cells = results.counterfactual["counterfactual"]
    users = results.rejecting
    rows = {v: [cells[v][u] for u in users] for v in results.variants}
    shares = {v: listed([percent(c and c["blame_right"]) for c in row]) for v, row in rows.items()}
    parts = [f"{variant_phrase(v)} {said}" for v, said in shares.items()]
    alt = f"How often the right item is blamed, {listed(users)} user: {'; '.join(parts)}."
    caption = (
        "Of the paths that a model rejects, rightly, and that a single item forbids: how often the model's largest "
        "probability of necessity falls on that item (95 % intervals over seeds and scenes). Grey: blaming any item, "
        "one of the symbol most often to blame, or the one nearest to the path; the nulls differ as each model "
        "rejects other paths."
    )
    wide, narrow = (partial(counterfactuals.draw_blame, cells, results.variants, users, c) for c in (len(users), 1))
    return picture("blame", caption, alt, wide, narrow)


def examples(results: Results, drawn: Drawn) -> Picture:
    """Three worked examples."""
    found, variant = results.counterfactual["examples"], results.best_blamer
    kinds = {
        "disagree": "“two reasons”: two users reject it, not for the same one",
        "one accepts": "“one minds”: one user rejects it, the other does not",
        "model wrong": "“wrong blame”: the model blames the wrong item",
    }
    said = [f"{kinds.get(e['kind'], e['kind'])} (scene {e['scene']})" for e in found]
    clearances = [min(item["clearance_m"] for item in e["items"]) for e in found]
    caption = (
        "Worked examples, the first that meet their rule, however close a call: "
        f"{listed(said)}. The same path on the table as it is and with each item taken away; below, for each user, "
        f"the truth and, in brackets, P(valid) by {variant_phrase(variant)} (seed {drawn.seed}). A path is drawn "
        "broken where it is invalid to one of them."
    )
    nearest = listed([f"{100 * c:.1f} cm" for c in clearances])
    alt = f"Scenes with and without each item; {listed(said)}. The nearest item lies {nearest} from the path."
    draw = partial(counterfactuals.draw_examples, found, drawn.whole, drawn.without, variant)
    return picture("counterfactuals", caption, alt, draw)
