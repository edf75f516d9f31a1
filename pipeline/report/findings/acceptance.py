"""Whether paths can be accepted with a promise, and whether it is kept."""

from pipeline.report.results import Results
from pipeline.report.wording import counted, interval, listed, percent, split_phrase, variant_phrase

UNPROMISED = "new_items"  # its paths are not like the demonstrations


def acceptance(results: Results) -> list[str]:
    """What labels a promise takes, and what became of it in new scenes and with unseen items."""
    return [
        _needed(results),
        *(_kept(results, v) for v in dict.fromkeys(v for v, _, _ in results.promises)),
        *_careless(results),
    ]


def _needed(results: Results) -> str:
    """The demonstrations that each kind of promise takes, beside those there are."""
    found = results.acceptance
    have = [f"{percent(share, 0)} of the {user} user's" for user, share in found["valid"].items()]
    fewest = [f"{n} for the {user} user" for user, n in found["fewest"].items()]
    return (
        f"To say of one threshold, and be wrong about it in {percent(found['error'], 0)} of all cases, that at most "
        f"{percent(found['level'], 0)} of what lies above is invalid would take {found['without_error']} held-out "
        f"demonstrations above it without an error; of the {found['labels']} there are, {listed(have)} are valid. To "
        f"hold the expected share below {percent(found['level'], 0)} takes at least {listed(fewest)} in all, if as "
        f"many paths are valid and all those are accepted: {found['held_out']['split']} calibrate in the split form, "
        f"all {found['labels']} in the cross-fitted one, which promises nothing."
    )


def _kept(results: Results, variant: str) -> str:
    """What became of the split form's promise, split by split, and what the cross-fitted form adds."""
    level, parts = results.acceptance["level"], []
    for split, by_rule in ((s, by_rule) for v, s, by_rule in results.promises if v == variant):
        cell, crossed = by_rule["split"], by_rule["crossed"]
        parts += [
            f"In {split_phrase(split)} {variant_phrase(variant)} {_accepts(cell)}{_verdict(split, cell, level)}.",
            *_silent(cell, level),
            f"Cross-fitted, it {_accepts(crossed)}.",
            *_silent(crossed, level),
        ]
    return " ".join(parts)


def _accepts(cell: dict) -> str:
    if cell["abstained"] == cell["models"]:
        return "accepts nothing"
    users = [f"{user} {percent(of_user['power'], 0)}" for user, of_user in cell["users"].items()]
    return (
        f"accepts {percent(cell['power'])} of the valid paths ({', '.join(users)}), and {percent(cell['mean'])} of "
        f"what it accepts is invalid ({interval(cell)})"
    )


def _silent(cell: dict, level: float) -> list[str]:
    """The models that accept nothing, which makes the mean smaller, and what the others accept."""
    others = cell["models"] - cell["abstained"]
    if not others or not cell["abstained"]:
        return []
    return [
        f"Nothing at all is accepted by {cell['abstained']} of {counted(cell['models'], 'model')}, which counts as "
        f"nothing invalid; of what the other {others} accept {percent(cell['where_any'])} is invalid, and "
        f"{cell['above']} of them are above {percent(level, 0)}."
    ]


def _verdict(split: str, cell: dict, level: float) -> str:
    """What the numbers make of the promise; nothing accepted breaks none, and nothing is promised of unseen items."""
    if cell["abstained"] == cell["models"]:
        return ""
    if split == UNPROMISED:
        return (
            f": {'above' if cell['mean'] > level else 'within'} {percent(level, 0)}, though nothing is promised there"
        )
    if cell["ci_low"] > level:
        return f": the promise of {percent(level, 0)} is broken"
    if cell["ci_high"] > level:
        return f": the interval shows the promise of {percent(level, 0)} neither kept nor broken"
    return f": the promise of {percent(level, 0)} is kept"


def _careless(results: Results) -> list[str]:
    """What would have been accepted without held-out demonstrations, where the promise is then broken."""
    found, out = results.acceptance, []
    for rule, lead in (
        ("training", "Calibrated on the very demonstrations it was fitted to"),
        ("decision", "By P > 0.5"),
    ):
        broken = [
            f"{variant_phrase(variant)} {percent(cell['mean'])} on {split_phrase(split)}"
            for variant, split, cell in ((v, s, by_rule[rule]) for v, s, by_rule in results.promises)
            if cell["ci_low"] > found["level"]
        ]
        if broken:
            out.append(
                f"{lead}, more of what is accepted is invalid than {percent(found['level'], 0)}: {listed(broken)}."
            )
    told = [(v, s, by_rule["truth"]) for v, s, by_rule in results.promises]
    best = [
        f"{percent(cell['power'])} of the valid paths for {variant_phrase(v)} on {split_phrase(s)}"
        for v, s, cell in told
        if cell["power"]
    ]
    none = [f"{variant_phrase(v)} on {split_phrase(s)}" for v, s, cell in told if not cell["power"]]
    if best:
        out.append(f"Who knew the truth could set one threshold that keeps to it and accepts {listed(best)}.")
    if none:
        out.append(
            f"No threshold keeps to it, even set with the truth, for {listed(none)}: of the paths it is surest of, "
            "more than that are invalid."
        )
    size = f"{counted(found['scenes'], 'scene')} with {counted(found['paths'], 'path')} each"
    return [f"{' '.join(out)} All this over {counted(found['seeds'], 'seed')} and {size}."]
