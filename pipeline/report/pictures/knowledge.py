"""Pictures of what the models know."""

from functools import partial

from pipeline.report.claims import SEEN, UNSEEN
from pipeline.report.figures import (
    accuracy,
    efficiency,
    maps,
    reliability,
)
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import NULLS, POSITION, Results
from pipeline.report.wording import counted, listed, percent, split_phrase, variant_phrase


def accuracy_by_n(results: Results, summary) -> Picture:
    first, last = min(results.ns), max(results.ns)
    cells = results.evaluation["accuracy"]
    parts = [
        f"{variant_phrase(v)} {percent(cells[v][UNSEEN][f'n{first}']['mean'])} to "
        f"{percent(cells[v][UNSEEN][f'n{last}']['mean'])}"
        for v in (*results.variants, POSITION)
    ]
    alt = (
        f"Accuracy from n = {first} to n = {last}. With unseen items: {listed(parts)}. In the training scenes the "
        f"paper's model "
        f"goes from {percent(cells[results.main][SEEN][f'n{first}']['mean'])} to "
        f"{percent(cells[results.main][SEEN][f'n{last}']['mean'])}."
    )
    caption = (
        f"Accuracy against demonstrations per scene: mean over {counted(len(results.seeds), 'seed')}, bands between "
        f"the quartiles, "
        f"users {listed(results.judged_users)}. Broken grey lines are the nulls; stars are the paper's two numbers, "
        f"repeated in "
        "every panel since it judged one kind of test only. The thin line at 50 % is a coin."
    )
    kept = summary[summary["variant"].isin([*results.variants, *NULLS])]
    wide, narrow = (partial(accuracy.draw, kept, list(results.splits), c) for c in (3, 1))
    return picture("accuracy", caption, alt, wide, narrow)


def efficiency_curves(results: Results) -> Picture:
    e, variants = results.efficiency, results.refitted
    parts = []
    for variant in variants:
        cells = [f"{percent(e['accuracy'][variant][f's{size}']['mean'])} at {size}" for size in results.sizes(variant)]
        parts.append(f"{variant_phrase(variant)} {listed(cells)}")
    alt = f"Accuracy against the number of training scenes at n = {results.study_n}: {'; '.join(parts)}."
    caption = (
        f"Above: accuracy against training scenes with {counted(results.study_n, 'demonstration')} each, on "
        f"{split_phrase(e['split'])}. Below: against all labelled demonstrations, more of them by more scenes (solid) "
        f"or by more in each of {results.per_seed} (broken). Means over {counted(e['seeds'], 'seed')}, bands between "
        f"the quartiles, users {listed(e['users'])}. The thin line is {percent(e['threshold'], 0)}."
    )
    numbers = (results.efficiency_curve, variants, results.per_seed, results.study_n, e["null"]["mean"], e["threshold"])
    return picture("efficiency", caption, alt, partial(efficiency.draw, *numbers))


def belief_map(results: Results, drawn: Drawn, user: str) -> Picture:
    found = drawn.maps[user]
    parts = [f"{label} {percent(found.agreement(label), 0)}" for label in found.models]
    alt = (
        f"Validity maps of the {user} user in {counted(len(found.images), 'scene')}. Share of control points where "
        f"the map says "
        f"what is true: {listed(parts)}."
    )
    caption = (
        f"{user.capitalize()} user: which control points make a valid path, in truth and as learned (seed "
        f"{drawn.seed}, "
        f"n = {results.study_n}). A point of a map is where the path's control point lies; the broken frame is the "
        f"table. "
        f"Agreement with the truth in these maps: {listed(parts)}."
    )
    return picture(f"map-{user}", caption, alt, partial(maps.draw, found))


def reliability_diagram(results: Results) -> Picture:
    errors = results.evaluation["calibration"]
    parts = [f"{variant_phrase(v)} {errors[v][UNSEEN]['ece']:.3f}" for v in results.variants]
    alt = f"Reliability diagram; expected calibration error with unseen items: {listed(parts)}."
    caption = (
        f"Reliability at n = {results.study_n}: of the paths given a probability, the share that is truly valid; on "
        f"the "
        f"diagonal a model means what it says. Bins with fewer than {reliability.FEWEST} paths are left out."
    )
    wide, narrow = (partial(reliability.draw, results.calibration, list(results.splits), c) for c in (3, 1))
    return picture("reliability", caption, alt, wide, narrow)
