"""What each ingredient of the path model is worth."""

from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, points, signed

SLIGHT = 0.005  # a change of accuracy below half a point is called little
WHOLE = "whole"
INGREDIENTS = {
    WHOLE: "The whole model",
    "no_shape": "No size, no elongation",
    "no_contrast": "No contrast with the table",
    "no_squares": "No squares of features",
    "every_feature": "Every member sees every feature",
    "unbounded": "Features' terms not bounded",
    "discs": "Things as discs, not capsules",
    "no_margin": "No margin: outlines decide",
    "nothing_unseen": "Nothing unseen in the way",
    "one_member": "One member, on reweighted scenes",
    "no_sharpening": "Mean not sharpened",
    "no_evidence": "Evidence not weighed",
}


def ingredient(name: str) -> str:
    """What is missing, as a reader meets it."""
    return INGREDIENTS.get(name, name.replace("_", " "))


def ablation(results: Results) -> list[str]:
    """What the model loses without each ingredient, the largest losses first; what hardly counts; calibration."""
    found, out = results.ablation["ablations"], []
    for n in asked(results):
        changes = {name: found[name][n] for name in results.ablation["order"] if name != WHOLE}
        lost = sorted((x for x in changes if changes[x]["change"] <= -SLIGHT), key=lambda x: changes[x]["change"])
        gained = [x for x in changes if changes[x]["change"] >= SLIGHT]
        losses = [f"{points(changes[x]['change'])} {_seeds(changes[x])} with “{_lower(x)}”" for x in lost]
        text = f"At {_named(n)} the whole model judges {percent(found[WHOLE][n]['accuracy'])} of the paths rightly. "
        text += f"Accuracy falls by {listed(losses)}. " if losses else "No ingredient is worth half a point. "
        if gained:
            more = [f"“{_lower(x)}” {_seeds(changes[x])}" for x in gained]
            text += f"It rises by half a point or more with {listed(more)}. "
        little = [x for x in changes if x not in lost and x not in gained]
        if little:
            text += f"It changes by less than half a point with {listed([f'“{_lower(x)}”' for x in little])}."
        out.append(text.strip())
    names = [name for name in results.ablation["order"] if name != WHOLE]
    idle = [x for x in names if all(found[x][n]["change"] > -SLIGHT for n in asked(results))]
    if idle:
        out.append(
            f"So accuracy justifies {len(idle)} of the {len(names)} ingredients nowhere; what else speaks for them is "
            "in docs/choices.md, “Ablate”."
        )
    last = asked(results)[-1]
    errors = {name: round(cells[last]["ece"], 3) for name, cells in found.items()}
    if "no_sharpening" in errors:
        nearer = "brings" if errors[WHOLE] < errors["no_sharpening"] else "does not bring"
        out.append(
            f"Sharpening the members' mean {nearer} its probabilities nearer to the frequencies: the calibration error "
            f"at {_named(last)} is {errors[WHOLE]:.3f}, and {errors['no_sharpening']:.3f} without."
        )
    seeds = counted(results.ablation["seeds"], "validation seed")
    out.append(f"In brackets: the changes of {seeds}; all see the same new scenes and paths.")
    return out


def asked(results: Results) -> list[str]:
    """Which n there are, by their names in the numbers, the fewest first."""
    return sorted(results.ablation["ablations"][WHOLE], key=lambda n: int(n[1:]))


def _named(n: str) -> str:
    return n.replace("n", "n = ", 1)


def _lower(name: str) -> str:
    text = ingredient(name)
    return text[0].lower() + text[1:]


def _seeds(cell: dict) -> str:
    """The changes of the two seeds that lie farthest apart, in percentage points."""
    low, high = (signed(100 * cell[name], 1) for name in ("change_low", "change_high"))
    return f"(seeds {low} to {high})"


def span(cell: dict) -> str:
    """The lowest and the highest change of a seed, in percentage points."""
    return f"[{signed(100 * cell['change_low'], 1)}, {signed(100 * cell['change_high'], 1)}]"
