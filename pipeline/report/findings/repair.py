"""What gradient repair achieves, and what it would take no image to achieve."""

from pipeline.report import paper
from pipeline.report.results import Results
from pipeline.report.wording import (
    counted,
    percent,
    percent_spread,
    variant_phrase,
)

SLIGHT = 0.05  # an advantage over the detour that a sentence calls none


def repair(results: Results) -> list[str]:
    """What gradient repair achieves, and what it would take no image to achieve."""
    out = []
    for user in results.users:
        c, quoted = results.repair[results.main][user], paper.REPAIR.get(user)
        if c["success"] is None:
            out.append(
                f"Every path is valid to the {user} user, so no start is invalid and there is nothing to repair"
                + (f": the paper's {percent(quoted, 0)} is met by doing nothing." if quoted == 1 else ".")
            )
            continue
        out.append(_user_repair(results, user))
    return out


def searches(results: Results) -> list[str]:
    """What a search that stays near the start achieves with each model, and what it costs by itself."""
    out = []
    for user in results.users:
        found = {model: by_user[user]["bayesian"] for model, by_user in results.search.items() if user in by_user}
        if not found:
            continue
        told, anchor = found.pop("truth"), results.repair[results.main][user]
        best = max(found, key=lambda v: found[v]["success"])
        b, ours = found[best], found[results.main]
        success = percent_spread(b, "success", "success_q1", "success_q3")
        valid = b["displacement_ratio_valid"]
        out.append(
            f"{user.capitalize()}: {variant_phrase(best)} ends {success}{_between(b['success_ci'])} of "
            f"{b['starts']:,} invalid starts in a truly valid path, at {b['displacement_ratio']:.2f} times the least "
            f"displacement{'' if valid is None else f', {valid:.2f} times where it succeeds'}; it calls "
            f"{percent(b['fooled'])}{_between(b['fooled_ci'])} of the ends valid that are not, and itself rejects "
            f"{percent(b['abstained'])}{_surer(b['by_threshold'])}"
            + (
                f". The paper's model ends {percent(ours['success'])} so, at {ours['displacement_ratio']:.2f} times"
                if best != results.main
                else ""
            )
            + f"; the constant detour needs {anchor['null_constant_displacement_ratio']:.1f} times for "
            f"{percent(anchor['null_constant'])}. Told the truth, the same search reaches "
            f"{percent(told['success'])} at {told['displacement_ratio']:.2f} times."
        )
    return out


def _between(bounds: list[float] | None) -> str:
    """How far other seeds and other scenes might move a share."""
    return f" (95 % interval with other scenes {100 * bounds[0]:.1f}–{100 * bounds[1]:.1f})" if bounds else ""


def _surer(levels: list[dict]) -> str:
    """What the highest threshold asked about would leave of the ends, and of the errors."""
    if not levels:
        return ""
    last = levels[-1]
    return (
        f" (accepting only above {last['above']:g} would leave {percent(last['accepted'])} of the ends, and be wrong "
        f"about {percent(last['fooled'])})"
    )


def _user_repair(results: Results, user: str) -> str:
    c, quoted = results.repair[results.main][user], paper.REPAIR.get(user)
    success = percent_spread(c, "success", "success_q1", "success_q3")
    text = (
        f"{user.capitalize()}: the paper's model ends {success} of {c['starts']:,} invalid starts in a truly valid path"
        + (f" (paper: {percent(quoted, 0)})" if quoted is not None else "")
        + f". One detour that is the same in every scene reaches {percent(c['null_constant'])}, a random path "
        f"{percent(c['null_random'])}; the model is above the detour in {_seeds_above(results, user)} of "
        f"{counted(len(results.seeds), 'seed')}."
    )
    if quoted is not None and quoted <= c["null_constant"] + SLIGHT:
        text += (
            f" The paper's rate is at most {100 * SLIGHT:.0f} points above the detour's, so a success rate alone does "
            f"not show "
            "that the image was used."
        )
    text += (
        f" Its repairs move the control point {c['displacement_ratio']:.1f} times as far as the nearest valid "
        "path would ask."
    )
    best = max(results.variants, key=lambda v: results.repair[v][user]["success"])
    if best != results.main:
        b = results.repair[best][user]
        text += (
            f" The highest success is that of {variant_phrase(best)}: "
            f"{percent_spread(b, 'success', 'success_q1', 'success_q3')} at {b['displacement_ratio']:.1f} times the "
            f"least distance."
        )
    return text


def _seeds_above(results: Results, user: str) -> int:
    """Seeds in which the paper's model repairs more starts than the constant detour of the same seed."""
    rows = results.repairs[results.repairs["user"] == user]
    by = rows.groupby(["method", "seed"])["valid_end"].mean()
    return int((by[results.main].loc[results.seeds] > by["null_constant"].loc[results.seeds]).sum())
