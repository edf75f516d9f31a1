"""The texts of a recording: an explanation of each tab in at most 120 words, and the recording's sources."""

from collections.abc import Iterable, Sequence

from pipeline.legend import label
from pipeline.viewer.contents import Run, by_user

VARIANTS = {
    "full": "all terms of the paper's loss",
    "ae": "the paper's model without the prior on z_image",
    "classifier": "the paper's model with the classifier's loss only",
    "irl_maxent": "inverse reinforcement learning from valid demonstrations",
    "irl_ranked": "inverse reinforcement learning that ranks valid above invalid demonstrations",
    "clearance": "detects objects; learns which ones matter and the margin around them",
}
OUTCOMES = "Light: valid. Dark: invalid. **Orange: invalid, called valid. Blue: valid, called invalid.**"


def repairs_text(run: Run) -> str:
    """Return the text of the tabs of new scenes."""
    ends = [(shown.ends_valid, shown.p[:, -1] > 0.5) for shown in run.repairs]
    count = sum(len(valid) for valid, _ in ends)
    successes = sum(int(valid.sum()) for valid, _ in ends)
    unsafe = sum(int((accepted & ~valid).sum()) for valid, accepted in ends)
    outcome = (
        f"**{successes} of {count}** repairs in this recording end valid. The model accepts {unsafe} that do not."
        if count
        else "All paths are valid for this user, so there is nothing to repair."
    )
    return f"""**{_who(run)}**

The control point z_theta sets a path. Gradient steps move invalid paths until the model accepts them: press play.

- **Table.** White: items and the margins to keep. Yellow: invalid starts. Other colours: the repairs. \
Blue disc: ends valid. Orange cross: ends invalid.
- **Model's P(valid)** for every z_theta. Dark blue: 0, yellow: 1. Magenta: the true boundary. Grey: the table's edge.
- **Model against truth.** {OUTCOMES}

{outcome}
"""


def interventions_text(run: Run) -> str:
    """Return the text of the interventions tab."""
    return f"""**{_who(run)}**

Each step of `intervention` adds one item (yellow outline) to new scene {run.repairs[0].scene}. \
Choose that time line at the bottom left, then press play.

- **Top.** The table before; P(valid) and the truth with the item.
- **Bottom.** The table with the item; what the item changes, for the model and in truth. \
Orange: z_theta becomes valid. Blue: it becomes invalid. Dark: no change.
"""


def intervention_effects(run: Run, step: int) -> str:
    """Return the effects of all interventions as text, with the current step's in bold."""
    done = run.interventions[step]
    rows = [
        f"| {'**' + x.symbol + '**' if x is done else x.symbol} | {x.learned_mean:+.3f} | {x.true_mean:+.3f} |"
        for x in run.interventions
    ]
    return f"""## {done.symbol.capitalize()} added

Question `add_{done.symbol}`, {run.user} user: the effect on P(valid) of a random path.

In this scene: model {done.learned:+.2f}, truth {done.true:+.2f}.

Mean over {done.scenes} scenes:

| added | model | truth |
| --- | ---: | ---: |
{chr(10).join(rows)}
"""


def learning_text(run: Run) -> str:
    """Return the text of the learning tab."""
    return f"""**{_who(run)}**

The model's map of new scene {run.repairs[0].scene} while it learns. {OUTCOMES}

Choose a time line at the bottom left:

- `demonstrations`: models fitted to {_listed(run.learning.by_n)} demonstrations a scene.
- `train_step`: this model after {_listed(run.learning.by_step)} training steps, with its losses below.
"""


def demonstrations_text(run: Run) -> str:
    """Return the text of the training scenes tab."""
    return f"""**{_who(run)}**

Scenes that the model was fitted to, with all their demonstrations.

- **Valid:** thick, blue, with a disc.
- **Invalid:** thin, orange, with a cross.
- **Dark line:** the hand's movement as recorded.
- **Coloured line:** the Bezier path fitted to it.
"""


def overview_text(runs: Sequence[Run]) -> str:
    """Return the explanation next to the overview."""
    return f"""Scenes with items never seen in training, and each model's verdict on every path in them \
(control point z_theta). A tab per user. Drag the time line `scene` at the bottom; the scene with most errors is first.

- **Table.** White: items, and the margins that the user keeps.
- **Truth and models.** {OUTCOMES} Grey square: the table's edge.

Right verdicts over the {len(runs[0].repairs)} scenes:

{_agreement(runs)}
"""


def about_run(run: Run) -> str:
    """Return the model, the data and the parameters of a run's recording."""
    return f"""# {run.name}

- **Model:** {label(run.variant)} (`{run.variant}`): {VARIANTS.get(run.variant, "a variant of conf/variants")}
- **User:** {run.user}, keeps clear of {_kept_clear_of(run)}
- **Seed:** {run.seed}
- **Demonstrations:** {run.n_demos} a scene
{_sources(run, run.name)}"""


def about_overview(runs: Sequence[Run]) -> str:
    """Return the models, users, data and parameters of the overview."""
    described = {f"- **{label(run.variant)}** (`{run.variant}`): {VARIANTS.get(run.variant, '')}": None for run in runs}
    users = [
        f"- **{user} user** keeps clear of {_kept_clear_of(of_user[0])}" for user, of_user in by_user(runs).items()
    ]
    return f"""# Overview

{chr(10).join([*described, *users])}
- **Seed:** {runs[0].seed}
- **Demonstrations:** {runs[0].n_demos} a scene
{_sources(runs[0], "overview")}"""


def _sources(run: Run, name: str) -> str:
    return f"""- **Profile:** {run.profile}
- **Data version:** `{run.data}`
- **Scenes' root seed:** {run.root_seed}

To reproduce it, run `make repro` at this data version with these parameters.
`python -m pipeline.viewer.review {name} --check` compares its contents with their digest in recordings.csv.

```yaml
{run.parameters}```
"""


def _who(run: Run) -> str:
    return f"{label(run.variant)}, {run.user} user, seed {run.seed}"


def _agreement(runs: Sequence[Run]) -> str:
    users = by_user(runs)
    rows = [
        f"| {label(variant)} | " + " | ".join(f"{run.agreement:.0%}" for run in runs if run.variant == variant) + " |"
        for variant in dict.fromkeys(run.variant for run in runs)
    ]
    return "\n".join([f"| model | {' | '.join(users)} |", f"| --- |{' ---: |' * len(users)}", *rows])


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def _kept_clear_of(run: Run) -> str:
    margins = [f"{symbol} {margin * 100:.1f} cm" for symbol, margin in run.margins.items() if margin is not None]
    return ", ".join(margins) or "nothing"
