"""What each ingredient of the path model is worth."""

from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, points, signed

SLIGHT = 0.005  # a change of accuracy below half a point is called little
WHOLE = "whole"
INGREDIENTS = {
    WHOLE: "The whole model",
    "no_shape": "No area, no elongation",
    "no_contrast": "No contrast with the table",
    "no_squares": "No squares of features",
    "discs": "Things as discs, not capsules",
    "no_margin": "No margin: outlines decide",
    "worst": "The worst thing decides alone",
    "nothing_unseen": "Nothing unseen in the way",
    "one_member": "One member, not several",
    "plain_mean": "Members' mean as it is",
    "no_prior": "No prior on relevance",
}


def ingredient(name: str) -> str:
    """What is missing, as a reader meets it."""
    return INGREDIENTS.get(name, name.replace("_", " "))


def ablation(results: Results) -> list[str]:
    """What the model loses without each ingredient, the largest losses first; what hardly counts; calibration."""
    found, out = results.ablation["ablations"], []
    for n in found[WHOLE]:
        changes = {name: cells[n] for name, cells in found.items() if name != WHOLE}
        lost = sorted((x for x in changes if changes[x]["change"] <= -SLIGHT), key=lambda x: changes[x]["change"])
        gained = [x for x in changes if changes[x]["change"] >= SLIGHT]
        losses = [f"{points(changes[x]['change'])} {_range(changes[x])} to “{_lower(x)}”" for x in lost]
        text = f"At {_named(n)} the whole model judges {percent(found[WHOLE][n]['accuracy'])} of the paths rightly. "
        text += f"It loses {listed(losses)}. " if losses else "No ingredient is worth half a point. "
        if gained:
            text += f"More than half a point better without: {listed([f'“{_lower(x)}”' for x in gained])}. "
        little = [x for x in changes if x not in lost and x not in gained]
        if little:
            text += f"Within half a point: {listed([f'“{_lower(x)}”' for x in little])}."
        out.append(text.strip())
    last = list(found[WHOLE])[-1]
    errors = {name: cells[last]["ece"] for name, cells in found.items()}
    if "plain_mean" in errors:
        better = errors[WHOLE] < errors["plain_mean"]
        out.append(
            f"Sharpening the members' mean {'brings' if better else 'does not bring'} its probabilities nearer to the "
            f"frequencies: the calibration error at {_named(last)} is {errors[WHOLE]:.3f}, {errors['plain_mean']:.3f} "
            "with the mean as it is."
        )
    seeds = counted(results.ablation["seeds"], "validation seed")
    out.append(f"In brackets: the lowest and the highest change of {seeds}, the same scenes and paths for all.")
    return out


def _named(n: str) -> str:
    return n.replace("n", "n = ", 1)


def _lower(name: str) -> str:
    text = ingredient(name)
    return text[0].lower() + text[1:]


def _range(cell: dict) -> str:
    return f"[{signed(100 * cell['change_low'], 1)}, {signed(100 * cell['change_high'], 1)}]"
