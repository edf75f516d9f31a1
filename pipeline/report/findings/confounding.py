"""Whether a model learns the cause or what only stands beside it."""

from pipeline.report.results import Results
from pipeline.report.wording import counted, listed, percent, signed, variant_phrase
from pipeline.table.layout import SYMBOLS


def confounding(results: Results) -> list[str]:
    """What association says of the confounded world, and what interventions on its models say."""
    found = results.confounding
    out = [_misled(results, user) for user in found["association"]["confounded"] if _innocent(results, user)]
    fitted = [v for v in results.variants if v in found["verdicts"]]
    silent = [v for v in fitted if _silent(found, v)]
    for variant in fitted:
        t = found["verdicts"][variant]
        alike = [v for v in silent if found["verdicts"][v] == t] if variant in silent else [variant]
        if variant != alike[0]:
            continue  # told with the first of them
        blamed = [
            f"{user} and {symbol} ({signed(c['effect'])}{_in_control(results, variant, user, symbol)})"
            for user, symbol, c in false_causes(results, variant)
        ]
        one = len(alike) == 1
        text = (
            "Fitted to the confounded world and asked what an added item changes, "
            f"{listed([variant_phrase(v) for v in alike])} {'gives' if one else 'each give'} {t['right']} of "
            f"{t['cells']} true verdicts"
        )
        if blamed:
            text += f" and names {counted(len(blamed), 'false cause')}: {listed(blamed)}."
        elif t["right"] == t["cells"]:
            text += ": it has learned the cause, not what stands beside it."
        elif t["false_causes"]:
            text += f" and {counted(t['false_causes'], 'effect')} of the wrong sign."
        else:
            text += f", with no false cause; true ones missed: {t['missed_causes']}, left open: {t['inconclusive']}."
            if variant in silent:
                blames = "It blames no plate because it blames" if one else "They blame no plate because they blame"
                text += f" {blames} nothing."
        out.append(text)
    return [*out, *_other_worlds(results)]


def false_causes(results: Results, variant: str) -> list[tuple[str, str, dict]]:
    """User, symbol and numbers of each effect that a variant fitted to the confounded world finds where none is."""
    return [
        (user, symbol, c)
        for user, by_symbol in results.confounding["interventions"][variant].items()
        for symbol, c in by_symbol.items()
        if c["verdict"] == "effect" and c["truth_verdict"] != "effect"
    ]


def owed(results: Results, variant: str, user: str, symbol: str) -> bool | None:
    """Whether the common cause makes a variant's effect larger, by its control; None if it was not fitted there."""
    if variant not in results.confounding["confounding"]:
        return None
    effect = results.confounding["interventions"][variant][user][symbol]["effect"]
    added = results.confounding["confounding"][variant][user][symbol]
    return added["p_holm"] < results.selftest["level"] and added["difference"] * effect > 0


def _in_control(results: Results, variant: str, user: str, symbol: str) -> str:
    by_company = owed(results, variant, user, symbol)
    if by_company is None:
        return "; no control was fitted"
    c = results.confounding["confounding"][variant][user][symbol]
    said = f"; the common cause adds {signed(c['difference'])}, {signed(c['ci_low'])} to {signed(c['ci_high'])}"
    return said if by_company else said + ": not its doing, as far as this shows"


def _silent(found: dict, variant: str) -> bool:
    """Whether a variant names no cause at all, and is wrong where there is one."""
    t, cells = found["verdicts"][variant], found["interventions"][variant].values()
    nothing = all(c["verdict"] != "effect" for by_symbol in cells for c in by_symbol.values())
    return nothing and t["right"] < t["cells"]


def _other_worlds(results: Results) -> list[str]:
    """Worlds in which a model that is right in the confounded one is led astray."""
    found, out = results.confounding, []
    for name, world in found["worlds"].items():
        for variant in (v for v in results.variants if v in world["verdicts"]):
            t = world["verdicts"][variant]
            if t["false_causes"] and not found["verdicts"][variant]["false_causes"]:
                out.append(
                    f"In the world “{name}”, where plate and glass stand {_cm(world['gap_m'])} apart (in "
                    f"“confounded” {_cm(found['worlds']['confounded']['gap_m'])}) and {world['things_per_item']:.2f} "
                    f"things are found an item, {variant_phrase(variant)} is led astray: {t['right']} of {t['cells']} "
                    f"verdicts are right, {counted(t['false_causes'], 'false cause')} among the others."
                )
    return out


def _cm(between: list[float]) -> str:
    return "–".join(f"{100 * end:g}" for end in between) + " cm"


def _innocent(results: Results, user: str) -> list[str]:
    """Symbols without a true effect whose association with invalidity the common cause alone makes."""
    found = results.confounding
    cells = next(iter(found["interventions"].values()))[user]
    confounded, ordinary = (found["association"][world][user] for world in ("confounded", "ordinary"))
    return [
        s
        for s in SYMBOLS
        if cells[s]["truth_verdict"] == "no effect" and confounded[s]["ci_low"] > max(0.0, ordinary[s]["ci_high"])
    ]


def _misled(results: Results, user: str) -> str:
    found = results.confounding["association"]
    parts = [
        f"near a {s} {percent(found['confounded'][user][s]['p_invalid_near'])} of the {user} user's demonstrations are "
        f"invalid, away from it {percent(found['confounded'][user][s]['p_invalid_far'])} (in ordinary scenes the "
        f"difference is {signed(100 * found['ordinary'][user][s]['difference'], 1)} points)"
        for s in _innocent(results, user)
    ]
    names = listed(_innocent(results, user))
    return f"Association blames the {names}: {listed(parts)}. In truth this user does not mind it at all."
