"""The page beside the views: what a recording shows, in words."""

from pipeline.recording.contents import Run


def page(run: Run) -> str:
    """Markdown for one who has only read the paper's abstract."""
    cares = [f"{symbol} {margin * 100:.1f} cm" for symbol, margin in run.margins.items() if margin is not None]
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

**The user keeps clear of:** {", ".join(cares) if cares else "nothing"}.

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
