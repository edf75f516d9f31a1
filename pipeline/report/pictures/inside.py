"""Pictures of the models themselves."""

from functools import partial

from pipeline.report.figures import (
    curves,
    latent,
    things,
)
from pipeline.report.figures.things import lies_on
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, variant_phrase
from pipeline.table.layout import SYMBOLS


def reconstructions(drawn: Drawn) -> Picture:
    error = ((drawn.rebuilt.astype(float) - drawn.originals) / 255) ** 2
    seen, new = error[: drawn.trained_on].mean() ** 0.5, error[drawn.trained_on :].mean() ** 0.5
    plain = drawn.originals - drawn.originals.mean((1, 2), keepdims=True)  # one colour for each scene
    flat = ((plain / 255) ** 2).mean() ** 0.5
    numbers = (
        f"root-mean-square error {seen:.3f} for {counted(drawn.trained_on, 'scene')} trained on, {new:.3f} for "
        f"{len(error) - drawn.trained_on} with unseen items (white = 1; each scene's mean colour alone: {flat:.3f})"
    )
    caption = (
        f"What survives the way through the {len(drawn.traversal)} numbers of z_image ({drawn.added_user} user, "
        f"seed {drawn.seed}): {numbers}." + (" It has kept less than a scene's mean colour." if seen > flat else "")
    )
    draw = partial(latent.draw_reconstructions, drawn.originals, drawn.rebuilt, drawn.trained_on)
    return picture("reconstructions", caption, f"Scenes and their reconstructions: {numbers}.", draw)


def traversals(drawn: Drawn) -> Picture:
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
    return picture("traversals", caption, alt, draw)


def learning_curves(results: Results) -> Picture:
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
    return picture("curves", caption, alt, wide, narrow)


def things_found(drawn: Drawn) -> Picture:
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
    return picture("things", caption, f"Things found in new scenes, outlined. {numbers}", draw)
