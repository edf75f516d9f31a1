"""How names and numbers are written for a reader: one word for one thing, one format for one kind of number."""

from collections.abc import Mapping, Sequence
from typing import Any

VARIANTS = {
    "full": "Full model (paper)",
    "ae": "Autoencoder (β = 0)",
    "classifier": "Classifier only",
    "irl_maxent": "IRL, maximum entropy",
    "irl_ranked": "IRL, ranking",
    "path": "Path model",
    "path_averaged": "Path, forms averaged",
    "null_nearest": "Null: nearest demonstration",
    "null_position": "Null: position only",
    "null_constant": "Null: constant detour",
    "null_random": "Null: random path",
    "oracle": "Oracle: nearest valid path",
    "truth": "Told the truth",
}
SPLITS = {
    "seen_scenes": "Training scenes, new paths",
    "new_scenes": "New scenes, training items",
    "new_items": "New scenes, unseen items",
}
SPLIT_PHRASES = {
    "seen_scenes": "new paths in the training scenes",
    "new_scenes": "new scenes with the training items",
    "new_items": "new scenes with unseen items",
    "val_scenes": "validation scenes with the training items",
    "val_items": "validation scenes with validation items",
}
NONE = "–"  # where a number does not exist


def variant_label(name: str) -> str:
    """A variant, null or oracle as a reader meets it."""
    return VARIANTS.get(name, name.replace("_", " "))


def variant_phrase(name: str) -> str:
    """A variant inside a sentence."""
    return {
        "full": "the full model",
        "ae": "the autoencoder (β = 0)",
        "classifier": "the classifier alone",
        "irl_maxent": "maximum-entropy IRL",
        "irl_ranked": "ranking IRL",
        "path": "the path model",
        "path_averaged": "the path model averaged over forms",
        "null_nearest": "the nearest-demonstration null",
        "null_position": "the position-only null",
        "null_constant": "the constant detour",
        "null_random": "a random path",
    }.get(name, f"the {variant_label(name)}")


def variant_does(name: str) -> str:
    """How a variant that the paper does not have goes about it, as a clause after its name; empty for the others."""
    return {
        "path": "which finds, without labels, what stands out from the table and learns how much each such thing "
        "matters and how near to it a path may come",
    }.get(name, "")


def method_label(name: str) -> str:
    """A search as a reader meets it."""
    return {
        "bayesian": "Bayesian optimisation", "multistart": "Multi-start", "cem": "Cross-entropy", "lbfgs": "L-BFGS-B",
    }.get(name, name)  # fmt: skip


def refuter_label(name: str) -> str:
    """An attempt to refute as a reader meets it."""
    kind, _, table = name.partition("/")
    label = {
        "permuted": "Permuted labels", "untrained": "Untrained model", "placebo": "Placebo patch", "mosaic": "Mosaic",
        "far": "Item far away", "other_table": "Other table",
    }.get(kind, kind)  # fmt: skip
    return f"{label} ({table})" if table else label


def refuter_finds(name: str) -> str:
    """What a refuter that finds an effect has shown of a model, as a clause before the cells."""
    kind, _, table = name.partition("/")
    return {
        "permuted": "fitted to permuted labels it shows effects", "untrained": "untrained it shows effects",
        "placebo": "a placebo patch (an item's pixels, shuffled) moves it",
        "mosaic": "a mosaic of an item's pieces moves it",
        "far": "an item far away moves it", "other_table": f"on a table top of {table} its effects change",
    }.get(kind, f"{refuter_label(name).lower()} moves it")  # fmt: skip


def form_label(form: str) -> str:
    """A form of users' rules, as a table has it."""
    return {
        "margin": "Keep a margin", "brief": "Not if brief", "right": "Only on the right",
        "beside": "Only beside something", "late": "Only later on", "several": "Only several at once",
    }.get(form, form.replace("_", " ").capitalize())  # fmt: skip


def form_phrase(form: str, amount: float) -> str:
    """The same at the head of a sentence, with its amount."""
    return {
        "brief": f"if coming too near is forgiven for up to {percent(amount, 0)} of the way",
        "right": "if only what a path passes on its right is minded",
        "beside": f"if only what stands within {100 * amount:g} cm of something else is minded",
        "late": f"if only what is passed after {percent(amount, 0)} of the way is minded",
        "several": f"if coming too near to fewer than {counted(int(amount), 'thing')} is forgiven",
    }.get(form, f"by the rule {form_label(form).lower()} ({amount:g})")  # fmt: skip


def believed_label(form: str) -> str:
    """A form of rule that the averaged model may believe in, as a table has it."""
    return {
        "nearest": "Nearest point", "lasting": "How long", "side": "Which side", "company": "What is beside",
        "progress": "How far along", "nothing": "Nothing matters",
    }.get(form, form)  # fmt: skip


def disturbance_label(name: str) -> str:
    """What is worse than in training, as a reader meets it."""
    return {
        "as_is": "As it is", "shade": "Light from one side", "tint": "Warmer light", "blur": "Blur",
        "noise": "Sensor noise", "arm": "Arm in view", "tables": "Unseen table top", "clutter": "More items",
        "labels": "Wrong labels",
    }.get(name, name)  # fmt: skip


def disturbance_axis(name: str) -> str:
    """A disturbance and what its strengths are, as an axis."""
    return {
        "shade": "Light lost to one side", "tint": "Blue light lost", "blur": "Blur, deviation",
        "noise": "Noise, deviation (1 = white)", "arm": "Arm in view, its reach", "clutter": "Items added",
        "labels": "Labels flipped",
    }.get(name, disturbance_label(name))  # fmt: skip


def strength_label(name: str, strength: float | int | str) -> str:
    """The strength of a disturbance, with its unit."""
    if isinstance(strength, str):
        return strength
    if name in ("shade", "tint", "labels"):
        return percent(float(strength), 0)
    units = {"blur": f"{strength:g}\u00a0px", "arm": f"{100 * strength:g}\u00a0cm", "clutter": f"+{strength}"}
    return units.get(name, f"{strength:g}")


def disturbance_phrase(name: str, strength: float | int | str) -> str:
    """A disturbance of some strength inside a sentence."""
    amount = strength_label(name, strength)
    return {
        "shade": f"light that loses {amount} from one side to the other", "tint": f"light without {amount} of its blue",
        "blur": f"a blur of {amount}", "noise": f"sensor noise of {amount}", "arm": f"an arm that reaches {amount} in",
        "tables": f"a table top of {amount}", "clutter": f"{amount.removeprefix('+')} more items on the table",
        "labels": f"{amount} wrong labels",
    }.get(name, f"{disturbance_label(name).lower()} of {amount}")  # fmt: skip


def rule_label(name: str) -> str:
    """A rule of accepting paths as a reader meets it."""
    return {
        "split": "Promise, split", "crossed": "Promise, cross-fitted", "training": "Training scores",
        "decision": "P > 0.5", "truth": "Told the truth",
    }.get(name, name)  # fmt: skip


def split_label(name: str) -> str:
    """A split as a heading."""
    return SPLITS.get(name, name.replace("_", " ").capitalize())


def split_phrase(name: str) -> str:
    """A split inside a sentence."""
    return SPLIT_PHRASES.get(name, name.replace("_", " "))


def interval(cell: Mapping[str, Any]) -> str:
    """The 95 % interval of a share, in per cent; a difference may begin below 0."""
    low, high = (f"{100 * cell[name]:.1f}" for name in ("ci_low", "ci_high"))
    if low.startswith("-"):
        return f"95 % interval {low} to {high}".replace("-", "−")
    return f"95 % interval {low}–{high}"


def percent(share: float | None, digits: int = 1) -> str:
    """A share of 1 as a percentage, with a non-breaking space; a dash for none."""
    return NONE if share is None or share != share else f"{100 * share:.{digits}f}\u00a0%"


def percent_spread(cell: dict, name: str = "mean", low: str = "q1", high: str = "q3") -> str:
    """Mean and quartiles as the paper writes them: 99.0 % [97.8–99.8]."""
    if cell.get(name) is None:
        return NONE
    return f"{percent(cell[name])} [{100 * cell[low]:.1f}–{100 * cell[high]:.1f}]"


def percent_within(share: float, bounds: Sequence[float] | None) -> str:
    """A share and its 95 % interval: 96.7 % [94.6–98.9]."""
    return percent(share) + (f" [{100 * bounds[0]:.1f}–{100 * bounds[1]:.1f}]" if bounds else "")


def points(difference: float) -> str:
    """A difference of shares in percentage points, without its sign."""
    amount = f"{abs(100 * difference):.1f}"
    return f"{amount} percentage point" + ("" if amount == "1.0" else "s")


def signed(value: float, digits: int = 3) -> str:
    """A number with its sign, by a real minus; zero has none."""
    text = f"{abs(value):.{digits}f}"
    if float(text) == 0:
        return text
    return ("+" if value > 0 else "−") + text


def p_value(p: float) -> str:
    """A p-value with three digits, never 0."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def listed(words: Sequence[str]) -> str:
    """a; a and b; a, b and c."""
    words = list(words)
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1] if words else "none"


def started(text: str) -> str:
    """A phrase at the beginning of a sentence."""
    return text[0].upper() + text[1:]


def counted(count: int, thing: str) -> str:
    """1 seed, 2 seeds, no seeds."""
    return f"{count or 'no'} {thing}" + ("" if count == 1 else "s")
