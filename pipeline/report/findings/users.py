"""What each user asks for in centimetres, and whether a few labelled paths tell which user it was."""

from pipeline.report.results import POSITION, Results
from pipeline.report.wording import counted, interval, listed, percent, points, started, variant_phrase
from pipeline.table.layout import SYMBOLS


def envelopes(results: Results) -> list[str]:
    """How near the learned distances come to the true ones, and what planning with them gives."""
    found = results.envelope
    silent, out = [], []
    for variant in results.variants:
        cells = {(u, s): found["envelope"][variant][u][s] for u in results.users for s in SYMBOLS}
        drawn = {key: c for key, c in cells.items() if c["radius_m"] is not None}
        if drawn:
            out.append(_found(variant, cells, drawn))
        else:
            silent.append(variant_phrase(variant))
    if silent:
        out.append(f"No envelope at all: {listed(silent)}.")
    return [*out, _planned(results)]


def _found(variant: str, cells: dict, drawn: dict) -> str:
    true = [key for key, c in cells.items() if c["truth_m"] is not None]
    right = [key for key in true if key in drawn]
    text = f"{started(variant_phrase(variant))} finds {len(right)} of the "
    text += counted(len(true), "true envelope")
    if right:
        errors = [abs(cells[key]["error_m"]) for key in right]
        covered = sum(cells[key]["covered"] for key in right)
        text += (
            f", their radii at most {1000 * max(errors):.1f} mm and on average {1000 * sum(errors) / len(errors):.1f} "
            f"mm from the true margins, which lie in {covered} of the {counted(len(right), 'interval')}"
        )
    false = [f"{user} and {symbol}" for user, symbol in drawn if cells[user, symbol]["truth_m"] is None]
    open_cells = [f"{user} and {symbol}" for (user, symbol), c in cells.items() if c["verdict"] == "inconclusive"]
    text += f"; it draws one where there is none for {listed(false)}" if false else ""
    return text + (f"; left open, and without an envelope: {listed(open_cells)}." if open_cells else ".")


def _planned(results: Results) -> str:
    """What a planner gets who keeps the envelopes of specification.yaml, what they lack, and whose would be safer."""
    found, ours, best = results.envelope, results.planner, _safest(results)
    plans, flips = found["planning"], found["planning_flips"][ours]
    nothing = found["planning_nulls"]["no_envelope"]
    users = [user for user in results.users if nothing[user]["valid"] < 1]
    parts = [
        f"for the {user} user {percent(plans[ours][user]['valid'])} are valid ({percent(nothing[user]['valid'])} of "
        f"all paths are) and {percent(plans[ours][user]['wasted'])} of the valid ones are forbidden"
        + (
            f", or {percent(flips[user]['valid'])} and {percent(flips[user]['wasted'])} if only items count whose "
            "touch makes a path more likely invalid than not"
            if flips[user] != plans[ours][user]
            else ""
        )
        for user in users
    ]
    text = (
        f"specification.yaml holds the envelopes of {variant_phrase(ours)}, for a planner to keep by the upper ends of "
        f"their intervals: of random paths that do, {'; '.join(parts)}. {_nearest_plans(results)}{_short(results)}"
    )
    if best != ours:
        other = [
            f"{percent(plans[best][user]['valid'])} ({user}, {percent(plans[best][user]['wasted'])} forbidden)"
            for user in users
        ]
        text += (
            f" Of the paths that the envelopes of {variant_phrase(best)} leave, a larger share is truly valid: "
            f"{listed(other)}."
        )
    return text


def _nearest_plans(results: Results) -> str:
    """What paths are worth that keep the envelopes and not a millimetre more."""
    parts = [
        f"{percent(plans['valid'])} of {counted(plans['plans'], 'path')} for the {user} user (99 % of them less than "
        f"{1000 * plans['short_m'] + 0.05:.1f} mm short)"
        for user, plans in results.envelope["nearest"].items()
        if plans["plans"]
    ]
    if not parts:
        return ""
    return (
        "A planner that shortens its way comes as near as it may: of paths moved just far enough to keep them, valid "
        f"are only {listed(parts)}. Both by the simulator's truth, in the "
        "scenes that the envelopes are of; who learns has neither. "
    )


def _short(results: Results) -> str:
    """How far the distances a planner is to keep fall short of the true margins."""
    cells = [c for by_symbol in results.envelope["envelope"][results.planner].values() for c in by_symbol.values()]
    true = [c for c in cells if c["truth_m"] is not None and c["radius_m"] is not None]
    short = [c["truth_m"] - c["ci_high"] for c in true if c["ci_high"] < c["truth_m"]]
    if not short:
        return "None of these distances is short of the true margin."
    return (
        f"Short of the true margin: {len(short)} of the {counted(len(true), 'distance')}, by "
        f"{1000 * max(short):.1f} mm at most; a path that keeps them can still be invalid."
    )


def _safest(results: Results) -> str:
    """The variant whose envelopes leave the largest share of valid paths, mean over users."""
    plans = results.envelope["planning"]

    def valid(variant: str) -> float:
        return sum(plans[variant][u]["valid"] or 0.0 for u in results.users)  # None: not a single path is left

    return max(results.variants, key=lambda v: (valid(v), v == results.planner))


def identification(results: Results) -> list[str]:
    """Whether a few labelled paths tell who drew them."""
    found, best = results.identification, _nearest(results)
    keys = sorted(found["identification"][best], key=lambda key: int(key[1:]))
    cell, many = found["identification"][best][keys[-1]], keys[-1][1:]
    gap, passes = found["largest_gap"], found["passes_99"]
    out = [
        f"Users agree on many paths, so no one can always tell them apart: an observer who knows the rules names the "
        f"right one of {len(results.users)} in {percent(cell['ideal'])} after {many} paths (chance "
        f"{percent(found['chance'])}). {started(variant_phrase(best))} reaches {percent(cell['mean'])} "
        f"({interval(cell)}) and stays within {points(gap[best]['all'])} of that observer at every number of paths, on "
        f"average over users; {worst_user(cell)}.",
        f"In the {counted(found['telling_scenes'], 'scene')} that tell the users apart, it {_passes(passes[best])}; "
        f"the observer {_passes(passes['ideal'])}."
        if found["telling_scenes"]
        else f"In no scene do {many} paths nearly always tell every two users apart.",
    ]
    null = gap[POSITION]["all"]
    worse = [variant_phrase(v) for v in results.variants if gap[v]["all"] > null]
    if worse:
        out.append(
            f"Farther from the observer than a guess by the paths' position alone ({points(null)}): {listed(worse)}."
        )
    by_variant = {v: found["open_set"][v][keys[-1]] for v in results.variants}
    alarmed = {v: c for v, c in by_variant.items() if c["false_alarms_low"] > found["level"]}
    strangers = found["open_set"][best][keys[-1]]
    text = (
        f"A stranger who minds plates only is called none of these in {percent(strangers['recognised'])} after "
        f"{many} paths (at best {percent(strangers['ideal_recognised'])}), a known user in "
        f"{percent(strangers['false_alarms'])}, by {variant_phrase(best)}."
    )
    if "recognised_unlike" in strangers:
        text += (
            f" In many scenes his labels are hardly unlike a known user's; in the "
            f"{counted(found['strange_scenes'], 'scene')} that nearly always tell him from each of them, it is "
            f"{percent(strangers['recognised_unlike'])} (at best {percent(strangers['ideal_recognised_unlike'])})."
        )
    if alarmed:
        parts = [f"{variant_phrase(v)} {_alarms(c)}" for v, c in alarmed.items()]
        text += (
            f" Known users are called strangers more often than the level of {percent(found['level'], 0)} allows by "
            f"{listed(parts)}. Their probabilities are off, or their errors in a scene go together."
        )
    return [*out, text]


def _alarms(cell: dict) -> str:
    """How often known users are called strangers, and the one who is most often."""
    user = max(cell["users"], key=cell["users"].__getitem__)
    low, high = 100 * cell["false_alarms_low"], 100 * cell["false_alarms_high"]
    return f"{percent(cell['false_alarms'])} ({low:.1f}–{high:.1f}; the {user} user {percent(cell['users'][user])})"


def worst_user(cell: dict) -> str:
    """The user for whom a model is farthest behind the observer told the rules."""
    user = max(cell["users"], key=lambda u: cell["ideal_users"][u] - cell["users"][u])
    return (
        f"the {user} user it names in {percent(cell['users'][user])}, the observer in "
        f"{percent(cell['ideal_users'][user])}"
    )


def _passes(passes: dict) -> str:
    k = passes["telling"]
    return "never passes 99 %" if k is None else f"passes 99 % from {counted(k, 'path')} on"


def _nearest(results: Results) -> str:
    gap = results.identification["largest_gap"]
    return min(results.variants, key=lambda v: gap[v]["all"])
