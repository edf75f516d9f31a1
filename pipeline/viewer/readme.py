"""The page beside the views: what a recording shows, in words."""

from collections.abc import Iterable, Sequence

from pipeline.viewer.contents import Counterfactual, Run, by_user
from pipeline.viewer.geometry import footprints

VARIANTS = {
    "full": "the paper's model, the whole of its loss",
    "ae": "the paper's model without a prior on z_image",
    "classifier": "the paper's model, its classifier alone",
    "irl_maxent": "maximum-entropy inverse reinforcement learning, of valid demonstrations",
    "irl_ranked": "inverse reinforcement learning that ranks valid above invalid demonstrations",
    "path": "finds what stands out from the table; learns what of it matters and how near a path may come",
}


def page(run: Run) -> str:
    """Markdown for one who has only read the paper's abstract."""
    repairs = [(shown.ends_valid, shown.p[:, -1] > 0.5) for shown in run.repairs]
    count = sum(len(truth) for truth, _ in repairs)
    good = sum(int(truth.sum()) for truth, _ in repairs)
    fooled = sum(int((believed & ~truth).sum()) for truth, believed in repairs)
    if count:
        outcome = (
            f"Of the **{count}** repairs shown here **{good}** end valid by the truth; in **{fooled}** the model "
            "believes the end valid (p > 0.5) and the truth does not."
        )
    else:
        outcome = "No path is invalid for this user in these scenes, so there is nothing to repair."
    return f"""# {run.name}

Model **{run.variant}** of user **{run.user}**, seed {run.seed}, {run.n} demonstrations a scene.

**The user keeps clear of:** {_kept_clear_of(run)}.

A path runs from *start* to *goal*; its middle control point is z_theta. The model gives every z_theta a
probability p that the user would call the path valid.

Press play, or drag the time line below. Its name, at the bottom left, is a menu: each tab says which one it is for.

## Maps
z_theta from -0.2 m to 1.2 m; teal: the table's edge.
- **p(valid), truth.** White: p = 1, valid. Black: p = 0, invalid. Magenta: where the truth changes.
- **Difference, model - truth. Orange: +1, invalid and called valid. Blue: -1, valid and called invalid.** Grey: 0.
- **Effect, after - before.** Orange: +1, becomes valid. Blue: -1, becomes invalid. Grey: nothing changes.

Point at a cell to read its value.

## A tab a new scene: `repair_step`
Its items were never seen in training. The scene in which the model errs most comes first.
- **Table.** White: the items, and thinner the room the user wants around them. Faint orange: the invalid paths
  repairs start from. Strong: the paths at this step, each in a colour of its own, the same in every view.
- **Maps.** Discs: each repair's z_theta at this step, on the trail of all its steps.
- **Below.** The model's p, and how far the path truly stays outside the room the user wants.

At the last step a **blue disc** says valid, an **orange cross** invalid, by the truth.

{outcome}

## Interventions: `intervention`
A step a symbol: an item more (yellow) in new scene {run.repairs[0].scene}. First row: before. Second: after. Third:
what the item changes, to the model and in truth. Beside: the effects, here and in all scenes of stage `intervene`.
{_counterfactuals(run)}
## Learning: `demonstrations`, `train_step`
The map of new scene {run.repairs[0].scene} by the models fitted to {_listed(run.learning.by_n)} demonstrations a
scene; and of the one shown elsewhere, after {_listed(run.learning.by_step)} steps of its training, with its losses.

## Training scenes
**Valid: thick, blue, a disc. Invalid: thin, orange, a cross.** In them a dark thread: the hand as recorded. In colour:
the Bezier path fitted to it.
"""


def _counterfactuals(run: Run) -> str:
    if not run.counterfactuals:
        return ""
    return """
## Counterfactuals: `counterfactual`
Worked examples of stage `counterfactual`: a path as it stands, then without each item (yellow outline: taken away).
The path is blue where it is truly valid, orange where it is not.
"""


def intervention_words(run: Run, step: int) -> str:
    """The intervention of this step, among all of them."""
    done = run.interventions[step]
    rows = [
        f"| {'**' + x.symbol + '**' if x is done else x.symbol} | {x.learned:+.2f} | {x.true:+.2f} | "
        f"{x.learned_mean:+.3f} | {x.true_mean:+.3f} |"
        for x in run.interventions
    ]
    return f"""## A {done.symbol} more

What it changes in the expected validity of a random path, by the model (learned) and by the user's rule (true).

| added | learned | true | mean learned | mean true |
| --- | ---: | ---: | ---: | ---: |
{chr(10).join(rows)}

In this scene, and in the mean of {done.scenes} scenes. The user keeps clear of {_kept_clear_of(run)}.
"""


def counterfactual_words(run: Run, asked: Counterfactual, question: int) -> str:
    """The question of this step, among all of its example."""
    symbols = [symbol for symbol, _ in footprints(asked.layout)]
    asks = ["as it stands", *(f"without the {symbol}" for symbol in symbols)]
    rows = [
        f"| {'**' + ask + '**' if i == question else ask} | {p:.2f} | {'valid' if truth else 'invalid'} |"
        for i, (ask, p, truth) in enumerate(zip(asks, asked.p, asked.truth, strict=True))
    ]
    return f"""## New scene {asked.scene}, {asks[question]}

| table | model's p(valid) | truth |
| --- | ---: | --- |
{chr(10).join(rows)}

- The model {_blames(bool(asked.p[0] > 0.5), asked.blamed, symbols)}.
- The truth {_blames(bool(asked.truth[0]), asked.culprit, symbols)}.
"""


def _blames(accepted: bool, item: int | None, symbols: Sequence[str]) -> str:
    if accepted:
        return "accepts the path: there is nothing to blame"
    return "rejects the path and blames " + ("no single item" if item is None else f"the **{symbols[item]}**")


def overview_page(runs: Sequence[Run]) -> str:
    """Markdown beside the overview of `runs`: what one sees, and each variant's agreement with the truth by user."""
    users = by_user(runs)
    agreement = [
        f"| {variant} | " + " | ".join(f"{run.agreement:.1%}" for run in of_variant) + " |"
        for variant in dict.fromkeys(run.variant for run in runs)
        for of_variant in [[run for run in runs if run.variant == variant]]
    ]
    shown = dict.fromkeys(run.variant for run in runs)
    described = "\n".join(f"- **{variant}**: {VARIANTS.get(variant, variant)}" for variant in shown)
    cares = "\n".join(f"- **{user}**: {_kept_clear_of(of_user[0])}" for user, of_user in users.items())
    return f"""# Every variant beside the truth

Scenes of items never seen in training. Models of seed {runs[0].seed}, {runs[0].n} demonstrations a scene.

A path runs from *start* to *goal*; its middle control point is z_theta. A map shows the validity of every z_theta
from -0.2 m to 1.2 m, the table's far edge on top.

## Agreement with the truth
Share of the cells of the {len(runs[0].repairs)} maps of a user in which the model (valid: p > 0.5) and the truth agree.

| variant | {" | ".join(users)} |
| --- |{" ---: |" * len(users)}
{chr(10).join(agreement)}

## The variants
{described}

## A tab a user
The time line `scene` below goes from scene to scene: drag it, or press play.
- **Table.** White: the items, and thinner the room the user wants around them.
- **Truth.** White: valid, black: invalid.
- **p(valid), a column a variant.** White: p = 1, black: p = 0.
- **Below it, its errors.** Grey: as the truth. **Orange: invalid, the model says valid. Blue: valid, the model says
  invalid.**
- In every map magenta: where the truth changes; teal: the table's edge.

## What the users keep clear of
{cares}
"""


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def _kept_clear_of(run: Run) -> str:
    cares = [f"{symbol} {margin * 100:.1f} cm" for symbol, margin in run.margins.items() if margin is not None]
    return ", ".join(cares) or "nothing"
