"""The report's figures with their captions, and texts for those who cannot see them that state the finding."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from jaxtyping import Bool, Float, Int, UInt8
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report.claims import SEEN, UNSEEN
from pipeline.report.figures import (
    accuracy,
    curves,
    interventions,
    latent,
    maps,
    power,
    reliability,
    repairs,
    things,
    world,
)
from pipeline.report.figures.maps import Maps
from pipeline.report.figures.repairs import Repair
from pipeline.report.figures.things import Seen, Things, lies_on
from pipeline.report.results import NULLS, Results
from pipeline.report.style import pdf, svg
from pipeline.report.tables import TWICE
from pipeline.report.wording import counted, listed, percent, variant_label, variant_phrase
from pipeline.table.layout import SYMBOLS, Layouts


@dataclass(frozen=True)
class Picture:
    """One figure: SVG for a wide page, maybe another for a narrow one, PDF for a paper, and its two texts."""

    name: str
    caption: str
    alt: str
    wide: str
    narrow: str | None
    pdf: bytes


@dataclass(frozen=True)
class Drawn:
    """The arrays behind the pictures, all of one seed."""

    seed: int
    scenes: UInt8[Array, "shown 100 100 3"]  # training scenes whose demonstrations are drawn
    demos: dict[str, tuple[Float[Array, "shown n 2"], Bool[Array, "shown n"]]]  # by user
    maps: dict[str, Maps]  # by user
    pool: UInt8[Array, "scene 100 100 3"]  # scenes that were repaired in
    layouts: Layouts
    repairs: dict[str, dict[str, list[Repair]]]  # by variant, and user with something invalid
    rebuilt: UInt8[Array, "picture 100 100 3"]
    originals: UInt8[Array, "picture 100 100 3"]
    trained_on: int  # of the originals, the first ones
    traversal: UInt8[Array, "latent value 100 100 3"]
    dimensions: Int[Array, "row"]
    values: list[float]
    added_to: UInt8[Array, "100 100 3"]
    added: UInt8[Array, "symbol 100 100 3"]
    added_texts: list[str]  # below the scene as it is and each added item
    added_user: str
    smallest: float  # smallest effect of interest
    things: Things  # found in `unseen`
    unseen: UInt8[Array, "scene 100 100 3"]
    unseen_layouts: Layouts
    seen: dict[str, Seen]  # by user with something invalid; empty without a variant that finds things


def all_pictures(results: Results, summary, drawn: Drawn) -> dict[str, Picture]:
    """Every figure of the page by name; `summary` is accuracy against n (variant, split, n, mean, q1, q3)."""
    pictures = [
        _world(results), _demonstrations(results, drawn), _accuracy(results, summary),
        *(_map(results, drawn, user) for user in results.users),
        *(_repair(results, drawn, variant) for variant in drawn.repairs),
        _interventions(results, drawn), _power(results, drawn), _added(drawn),
        _reconstructions(drawn), _traversals(drawn),
        _reliability(results), _curves(results), *([_things(drawn)] if drawn.seen else []),
    ]  # fmt: skip
    return {picture.name: picture for picture in pictures}


def _picture(name: str, caption: str, alt: str, wide: Callable[[], Figure], narrow: Callable | None = None) -> Picture:
    return Picture(name, caption, alt, svg(wide), svg(narrow) if narrow else None, pdf(wide))


def _world(results: Results) -> Picture:
    cells = [c for by in results.world["p_valid"].values() for c in by.values() if c.get("paper") is not None]
    gap = max((abs(c["truth"] - c["paper"]) for c in cells), default=0.0)
    alt = (
        f"Dot plot of {len(cells)} cells: the simulated world's share of valid paths lies at most {gap:.3f} from "
        "the paper's number."
    )
    caption = (
        "The world beside the paper's Table 2: dots are the simulated truth, stars the paper, grey bars ± 0.03 "
        "around it."
    )
    return _picture("world", caption, alt, partial(world.draw_calibration, results.world["p_valid"], results.users))


def _demonstrations(results: Results, drawn: Drawn) -> Picture:
    shares = [f"{percent(valid.mean(), 0)} for {user}" for user, (_, valid) in drawn.demos.items()]
    alt = f"The same training scenes with each user's demonstrations; valid among those drawn: {listed(shares)}."
    caption = (
        f"Training scenes of seed {drawn.seed}, the most varied ones, with every demonstration of each user that the "
        f"models are given. Paths run from the circle to "
        f"the square; "
        "whole blue lines are valid to that user, broken orange ones are not."
    )
    return _picture("demonstrations", caption, alt, partial(world.draw_demonstrations, drawn.scenes, drawn.demos))


def _accuracy(results: Results, summary) -> Picture:
    first, last = min(results.ns), max(results.ns)
    cells = results.evaluation["accuracy"]
    parts = [
        f"{variant_phrase(v)} {percent(cells[v][UNSEEN][f'n{first}']['mean'])} to "
        f"{percent(cells[v][UNSEEN][f'n{last}']['mean'])}"
        for v in (*results.variants, "null_position")
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
    return _picture("accuracy", caption, alt, wide, narrow)


def _map(results: Results, drawn: Drawn, user: str) -> Picture:
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
    return _picture(f"map-{user}", caption, alt, partial(maps.draw, found))


def _repair(results: Results, drawn: Drawn, variant: str) -> Picture:
    ends = {u: [r.valid for r in found] for u, found in drawn.repairs[variant].items()}
    parts = [f"{sum(v)} of {len(v)} for {u}" for u, v in ends.items()]
    alt = f"Repairs by {variant_phrase(variant)}; end valid in truth: {listed(parts)}."
    steps = max(len(r.z) - 1 for found in drawn.repairs[variant].values() for r in found)
    caption = (
        f"{variant_label(variant)}: {counted(steps, 'gradient step')} from the same invalid start for each user, dark "
        f"to light; "
        "white outlines are the items' true footprints, below each picture is what came of it. The first scenes whose "
        "start is "
        f"invalid to every user that has invalid paths, seed {drawn.seed}; not chosen by their outcome."
    )
    draw = partial(repairs.draw, drawn.pool, drawn.layouts, drawn.repairs[variant])
    return _picture(f"repair-{variant}", caption, alt, draw)


def _interventions(results: Results, drawn: Drawn) -> Picture:
    cells = {v: results.intervention["interventions"][v] for v in results.variants}
    parts = []
    for variant in results.variants:
        t = results.intervention["verdicts"][variant]
        parts.append(f"{variant_phrase(variant)} {t['right']} of {t['cells']}")
    alt = f"Effects of an added item with 95 % intervals beside the true ones. Right verdicts: {listed(parts)}."
    caption = (
        "What one more item does to mean validity: each variant's average causal effect with its 95 % interval (over "
        f"seeds and scenes), the truth as upright bars, effects smaller than {drawn.smallest} in the grey band. "
        "Filled marks: "
        f"verdict “effect”."
    )
    wide, narrow = (
        partial(interventions.draw, cells, results.users, drawn.smallest, c) for c in (len(results.users), 1)
    )
    return _picture("interventions", caption, alt, wide, narrow)


def _added(drawn: Drawn) -> Picture:
    truths = [
        f"{name} {text.splitlines()[0]}" for name, text in zip(("as it is", *SYMBOLS), drawn.added_texts, strict=True)
    ]
    caption = (
        "The intervention itself: one scene, and the same scene with one more item of each symbol, drawn under the "
        "same light. "
        f"Below each: mean validity for the {drawn.added_user} user, in truth and by the paper's model (seed "
        f"{drawn.seed})."
    )
    alt = (
        f"One scene with one more item of each symbol; mean validity for the {drawn.added_user} user: {listed(truths)}."
    )
    wide, narrow = (
        partial(interventions.draw_added, drawn.added_to, drawn.added, drawn.added_texts, columns) for columns in (5, 3)
    )
    return _picture("added", caption, alt, wide, narrow)


def _power(results: Results, drawn: Drawn) -> Picture:
    t = results.selftest
    parts = [f"{variant_phrase(v)} {percent(t['regimes'][v]['power'][TWICE]['effect'], 0)}" for v in t["measured"]]
    alt = f"Share of families in which an effect of {TWICE} is called one, with chance as in: {listed(parts)}."
    caption = (
        f"What the procedure says of one true effect among {t['cells'] - 1} null cells, {t['families']:,} "
        "simulated families "
        "a point, with the chance of each variant's own effects (whole lines) or stylised (broken). The "
        "upright line is the "
        f"smallest effect of interest, {drawn.smallest}; the rest of the verdicts is “inconclusive”."
    )
    wide, narrow = (partial(power.draw, results.regimes, t["measured"], drawn.smallest, columns) for columns in (2, 1))
    return _picture("power", caption, alt, wide, narrow)


def _reconstructions(drawn: Drawn) -> Picture:
    error = ((drawn.rebuilt.astype(float) - drawn.originals) / 255) ** 2
    seen, new = error[: drawn.trained_on].mean() ** 0.5, error[drawn.trained_on :].mean() ** 0.5
    numbers = (
        f"root-mean-square error {seen:.3f} for scenes trained on, {new:.3f} for scenes with unseen items (white = 1)"
    )
    caption = (
        f"What survives the way through the {len(drawn.traversal)} numbers of z_image ({drawn.added_user} user, "
        f"seed {drawn.seed}): {numbers}."
    )
    draw = partial(latent.draw_reconstructions, drawn.originals, drawn.rebuilt, drawn.trained_on)
    return _picture("reconstructions", caption, f"Scenes and their reconstructions: {numbers}.", draw)


def _traversals(drawn: Drawn) -> Picture:
    change = drawn.traversal[drawn.dimensions].astype(float).std(axis=1).mean(axis=(1, 2, 3)) / 255
    caption = (
        f"One scene decoded with a single dimension of z_image moved at a time: the {len(drawn.dimensions)} of "
        f"{len(drawn.traversal)} "
        "dimensions that change the picture most. A disentangled dimension would move one thing and leave the rest "
        "alone."
    )
    alt = (
        f"Latent traversals; the liveliest dimension changes pixels by {change[0]:.3f} on average (standard deviation, "
        f"white = 1), the last one shown by {change[-1]:.3f}."
    )
    draw = partial(latent.draw_traversals, drawn.traversal, drawn.dimensions, drawn.values)
    return _picture("traversals", caption, alt, draw)


def _reliability(results: Results) -> Picture:
    errors = results.evaluation["calibration"]
    parts = [f"{variant_phrase(v)} {errors[v][UNSEEN]['ece']:.3f}" for v in results.variants]
    alt = f"Reliability diagram; expected calibration error with unseen items: {listed(parts)}."
    caption = (
        f"Reliability at n = {results.study_n}: of the paths given a probability, the share that is truly valid; on "
        f"the "
        f"diagonal a model means what it says. Bins with fewer than {reliability.FEWEST} paths are left out."
    )
    wide, narrow = (partial(reliability.draw, results.calibration, list(results.splits), c) for c in (3, 1))
    return _picture("reliability", caption, alt, wide, narrow)


def _curves(results: Results) -> Picture:
    parts = []
    for variant, frame in results.curves.items():
        ends = frame[frame["user"].isin(results.judged_users)].groupby("step")["total"].mean()
        parts.append(f"{variant_phrase(variant)} from {ends.iloc[0]:.2f} to {ends.iloc[-1]:.2f}")
    caption = (
        f"Training loss at n = {results.study_n}, mean over seeds with a band between the quartiles. Losses of "
        f"different variants are "
        "different sums and cannot be compared; a user whose demonstrations are all valid needs no training and has "
        "no curve."
    )
    alt = f"Learning curves, users {listed(results.judged_users)}: {listed(parts)}."
    wide, narrow = (partial(curves.draw, results.curves, results.users, c) for c in (3, 1))
    return _picture("curves", caption, alt, wide, narrow)


def _things(drawn: Drawn) -> Picture:
    on, present = lies_on(drawn.things, drawn.unseen_layouts), drawn.unseen_layouts.present
    parts = []
    for user, seen in drawn.seen.items():
        means = []
        for i, symbol in enumerate(SYMBOLS):
            of_symbol = (on & (drawn.unseen_layouts.symbol == i)[:, None]).any(2)
            if of_symbol.any():
                means.append(f"{symbol} {seen.relevance[of_symbol].mean():.2f}")
        parts.append(f"{user}: {listed(means)}")
    strays = int((drawn.things.present & ~on.any(2)).sum())
    numbers = (
        f"In the {counted(len(drawn.unseen), 'scene')} it finds {int(on.any(1).sum())} of {int(present.sum())} items, "
        f"and {counted(strays, 'thing')} whose middle lies on none. Mean learned relevance of things on items of each "
        f"kind, {'; '.join(parts)}."
    )
    caption = (
        "What the path model finds in new scenes with unseen items, coloured and labelled by the learned chance that "
        f"the user keeps away from it (seed {drawn.seed}); thin white lines are the true footprints. The first scenes, "
        f"and in the last column the one scene of all in which the model's map errs most. {numbers}"
    )
    draw = partial(things.draw, drawn.unseen, drawn.unseen_layouts, drawn.things, drawn.seen)
    return _picture("things", caption, f"Things found in new scenes, outlined. {numbers}", draw)
