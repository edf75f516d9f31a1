"""The page beside the views: what a recording shows, in words."""

from collections.abc import Sequence

from pipeline.recording.contents import Run, by_user

VARIANTS = {
    "full": "the paper's model, the whole of its loss",
    "ae": "the same without a prior on z_image",
    "classifier": "the same, its classifier alone",
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

## A tab a new scene
Its items were never seen in training.
- **Table.** White: the items, and thinner the room the user wants around them. Faint orange: the invalid paths
  repairs start from. Strong: the paths at this step, each in a colour of its own, the same in every view.
- **Latent map, model.** z_theta from -0.2 m to 1.2 m; white: p = 1, black: p = 0.
  Magenta: where the truth changes. Discs: each repair's z_theta at this step, on the trail of all its steps.
- **Latent map, truth.** White: valid, black: invalid. Teal in both maps: the table's edge.
- **Below:** p over the repair's steps.

At the last step a **blue disc** says valid, an **orange cross** invalid, by the truth.

{outcome}

## Demonstrations
Some training scenes. **Valid: thick, blue, a disc. Invalid: thin, orange, a cross.** In them a dark
thread: the hand as recorded. In colour: the Bezier path fitted to it.

Press play, or drag the time line `repair_step`.
"""


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


def _kept_clear_of(run: Run) -> str:
    cares = [f"{symbol} {margin * 100:.1f} cm" for symbol, margin in run.margins.items() if margin is not None]
    return ", ".join(cares) or "nothing"
