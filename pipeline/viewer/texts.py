"""The texts of a recording: an explanation of each tab in at most 120 words, and the recording's sources."""

from collections.abc import Iterable, Sequence

from pipeline.viewer.contents import Run, by_user

VARIANTS = {
    "full": "the paper's model, all terms of its loss",
    "ae": "the paper's model without the prior on z_image",
    "classifier": "the paper's model with the classifier's loss only",
    "irl_maxent": "maximum-entropy inverse reinforcement learning from valid demonstrations",
    "irl_ranked": "inverse reinforcement learning that ranks valid above invalid demonstrations",
    "clearance": "detects objects; learns which ones matter and the margin around them",
}


def about_run(run: Run) -> str:
    """Return the model and the data of a run's recording."""
    return f"""# {run.name}

- **Model:** {run.variant}, {VARIANTS.get(run.variant, "a variant of conf/variants")}
- **User:** {run.user}, keeps clear of {_kept_clear_of(run)}
- **Seed:** {run.seed}
- **Demonstrations:** {run.n_demos} per scene
- **Profile:** {run.profile}
- **Data:** scenes {run.data}
"""


def repairs_text(run: Run) -> str:
    """Return the text of the tabs of new scenes."""
    ends = [(shown.ends_valid, shown.p[:, -1] > 0.5) for shown in run.repairs]
    count = sum(len(valid) for valid, _ in ends)
    successes = sum(int(valid.sum()) for valid, _ in ends)
    unsafe = sum(int((accepted & ~valid).sum()) for valid, accepted in ends)
    outcome = (
        f"In this recording **{successes} of {count}** repairs end truly valid; the model accepts {unsafe} that do not."
        if count
        else "All paths are valid for this user, so there is nothing to repair."
    )
    return f"""A path from *start* to *goal* is set by its control point z_theta. Gradient steps move invalid paths \
until the model accepts them. Press play to see the steps (`repair_step`).

**Table.** White: items; thin white: the margin the user wants. Faint orange: invalid starts. Strong colours: the
paths now. Ends: **blue disc = truly valid, orange cross = truly invalid**.

**Maps** of all z_theta. White: valid, black: invalid. Magenta: true boundary. Teal: table edge. Difference: orange =
invalid but called valid; blue = valid but called invalid.

**Plots.** The model's p(valid), and the true distance beyond the margin.

{outcome}
"""


def interventions_text(run: Run) -> str:
    """Return the text of the interventions tab."""
    return f"""Each step of `intervention` adds one item (yellow outline) to new scene {run.repairs[0].scene}. \
Choose that time line at the bottom left, then press play.

- **First row:** the scene, the model's map and the true map before.
- **Second row:** the same after.
- **Third row:** the effect, after minus before. Orange: z_theta becomes valid. Blue: it becomes invalid. Grey: no
  change.

The left map shows what the model predicts, the right one what is true. The table beside them gives the effect on the
probability that a random path is valid.
"""


def intervention_effects(run: Run, step: int) -> str:
    """Return the effects of all interventions as text, with the current step's in bold."""
    done = run.interventions[step]
    rows = [
        f"| {'**' + x.symbol + '**' if x is done else x.symbol} | {x.learned:+.2f} | {x.true:+.2f} | "
        f"{x.learned_mean:+.3f} | {x.true_mean:+.3f} |"
        for x in run.interventions
    ]
    return f"""## {done.symbol.capitalize()} added

Effect on P(valid) of a random path, by the model and in truth: in this scene, and on average over {done.scenes} scenes.

| added | model | truth | model, mean | truth, mean |
| --- | ---: | ---: | ---: | ---: |
{chr(10).join(rows)}
"""


def learning_text(run: Run) -> str:
    """Return the text of the learning tab."""
    return f"""The model's map of new scene {run.repairs[0].scene}, the true map and their difference (orange: invalid \
but called valid; blue: valid but called invalid).

Choose a time line at the bottom left:

- `demonstrations`: models fitted to {_listed(run.learning.by_n)} demonstrations per scene.
- `train_step`: this model after {_listed(run.learning.by_step)} training steps, with its losses below.
"""


def demonstrations_text() -> str:
    """Return the text of the training scenes tab."""
    return """Some of the scenes the model was fitted to, with all demonstrations in them.

- **Valid:** thick, blue, with a disc.
- **Invalid:** thin, orange, with a cross.
- **Dark line:** the hand's movement as recorded.
- **Coloured line:** the Bezier path fitted to it.
"""


def overview_text(runs: Sequence[Run]) -> str:
    """Return the explanation next to the overview."""
    return f"""Scenes with items never seen in training, and each model's map of all paths (z_theta) in them. \
A tab per user; drag the time line `scene` to change the scene.

- **Table.** White: items; thin white: the margin the user wants.
- **Truth and p(valid).** White: valid, black: invalid.
- **Errors.** Grey: right. **Orange: invalid but called valid. Blue: valid but called invalid.**
- Magenta: true boundary. Teal: the table's edge.

Agreement with the truth over all cells of the {len(runs[0].repairs)} maps:

{_agreement(runs)}
"""


def about_overview(runs: Sequence[Run]) -> str:
    """Return the models, users and data of the overview."""
    described = [f"- **{v}**: {VARIANTS.get(v, v)}" for v in dict.fromkeys(run.variant for run in runs)]
    users = [f"- **{user}** keeps clear of {_kept_clear_of(of_user[0])}" for user, of_user in by_user(runs).items()]
    return f"""Seed {runs[0].seed}, {runs[0].n_demos} demonstrations per scene, profile {runs[0].profile}, \
scenes {runs[0].data}.

{chr(10).join([*described, *users])}
"""


def _agreement(runs: Sequence[Run]) -> str:
    users = by_user(runs)
    rows = [
        f"| {variant} | " + " | ".join(f"{run.agreement:.0%}" for run in runs if run.variant == variant) + " |"
        for variant in dict.fromkeys(run.variant for run in runs)
    ]
    return "\n".join([f"| variant | {' | '.join(users)} |", f"| --- |{' ---: |' * len(users)}", *rows])


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def _kept_clear_of(run: Run) -> str:
    margins = [f"{symbol} {margin * 100:.1f} cm" for symbol, margin in run.margins.items() if margin is not None]
    return ", ".join(margins) or "nothing"
