"""Pictures of what is worse than in training, and of what it costs."""

from functools import partial

from pipeline.report.figures import robustness
from pipeline.report.findings.robustness import worst
from pipeline.report.pictures.picture import Drawn, Picture, picture
from pipeline.report.results import POSITION, Results
from pipeline.report.wording import (
    counted,
    disturbance_label,
    disturbance_phrase,
    listed,
    percent,
    strength_label,
    variant_phrase,
)


def accuracy_disturbed(results: Results) -> Picture:
    """Accuracy against strength, a panel for each disturbance."""
    found = results.robustness
    as_is = found["undisturbed"]["models"]
    parts = []
    for variant in results.variants:
        name, level = worst(results, variant)
        score = level["models"][variant]["accuracy"]["mean"]
        parts.append(
            f"{variant_phrase(variant)} from {percent(as_is[variant]['accuracy']['mean'])} to {percent(score)} by "
            f"{disturbance_phrase(name, level['strength'])}"
        )
    alt = f"Accuracy against the strength of each disturbance. The largest falls: {listed(parts)}."
    caption = (
        f"Accuracy undisturbed (at the left of each panel) and disturbed: mean over {counted(found['seeds'], 'seed')}, "
        f"{listed(found['users'])} users, {counted(found['scenes'], 'scene')} with unseen items. The broken grey line "
        "is the position-only null. Intervals are in the table."
    )
    variants = [*results.variants, POSITION]
    return picture("robustness", caption, alt, partial(robustness.draw, found, variants))


def disturbed_scene(results: Results, drawn: Drawn) -> Picture:
    """One scene under each disturbance."""
    strongest = {name: levels[-1]["strength"] for name, levels in results.robustness["disturbed"].items()}
    names = {name: disturbance_label(name) for name in drawn.disturbed}
    names |= {name: f"{names[name]}\n{strength_label(name, strongest[name])}" for name in names if name in strongest}
    caption = (
        "One scene with unseen items, but for the table's edge, as it is and under each disturbance at its "
        "strongest, or on the last of the table tops."
    )
    said = [text[0].lower() + text[1:].replace("\n", " (") + ")" * ("\n" in text) for text in names.values()]
    alt = f"The same table: {listed(said)}."
    return picture("disturbed", caption, alt, partial(robustness.draw_examples, drawn.disturbed, names))
