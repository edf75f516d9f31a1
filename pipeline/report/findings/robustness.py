"""What breaks which model."""

from pipeline.report.results import POSITION, Results
from pipeline.report.tables.robustness import most_accurate
from pipeline.report.wording import (
    disturbance_label,
    disturbance_phrase,
    interval,
    listed,
    percent,
    points,
    signed,
    started,
    variant_phrase,
)

LABELS = "labels"
ALWAYS = 0.9  # share of the pictures called strange from which a sentence says so
SLIGHT = 0.05  # a loss of accuracy that a sentence calls small


def robustness(results: Results) -> list[str]:
    """Each model that sees something: what breaks it most, and why; what it withstands. Then wrong labels."""
    as_is = _as_is(results)
    seeing = [v for v in results.variants if as_is[v] > as_is[POSITION]]
    blind = [v for v in results.variants if v not in seeing]
    best_first = sorted(seeing, key=lambda v: -as_is[v])
    out = [_breaks(results, variant) for variant in best_first]
    if blind:
        changes = [
            cell["difference"]
            for name in _asked(results)
            for level in results.robustness["disturbed"][name]
            for cell in (level["models"][v] for v in blind)
        ]
        null = percent(as_is[POSITION])
        out.append(
            f"No better than the position-only null ({null}) undisturbed, and so with little to lose: "
            f"{listed([variant_phrase(v) for v in blind])}. Accuracy changes there by "
            f"{signed(100 * min(changes), 1)} to {signed(100 * max(changes), 1)} percentage points."
        )
    return [*out, _strange(results), *_mislabelled(results)]


def worst(results: Results, variant: str) -> tuple[str, dict]:
    """The disturbance of pictures or tables, and its strength's numbers, that take most of a variant's accuracy."""
    return min(_levels(results), key=lambda of: of[1]["models"][variant]["difference"])


def _levels(results: Results) -> list[tuple[str, dict]]:
    """Every disturbance of pictures and tables, at each of its strengths."""
    return [(name, level) for name in _asked(results) for level in results.robustness["disturbed"][name]]


def _asked(results: Results) -> list[str]:
    """The disturbances of pictures and tables: every variant was asked there."""
    return [name for name in results.robustness["order"] if name != LABELS]


def _as_is(results: Results) -> dict[str, float]:
    models = results.robustness["undisturbed"]["models"]
    return {variant: cell["accuracy"]["mean"] for variant, cell in models.items()}


def _breaks(results: Results, variant: str) -> str:
    found = results.robustness
    before, levels = found["undisturbed"]["models"][variant], _levels(results)
    lead = f"{started(variant_phrase(variant))}, right about {percent(before['accuracy']['mean'])} undisturbed, "
    if all(level["models"][variant]["ci_high"] >= 0 for _, level in levels):
        return lead + "is broken by nothing here: every fall may be none."
    name, level = worst(results, variant)
    cell, null = level["models"][variant], level["models"][POSITION]["accuracy"]["mean"]
    score, phrase = cell["accuracy"]["mean"], disturbance_phrase(name, level["strength"])
    beside = "below the null's" if score < null else "where the null has"
    return (
        f"{lead}falls most under {phrase}: by {points(cell['difference'])} (95 % interval {-100 * cell['ci_high']:.1f} "
        f"to {-100 * cell['ci_low']:.1f}, of the largest of {len(levels)} changes) to {percent(score)}, {beside} "
        f"{percent(null)}. There it rejects {percent(cell['false_rejects'])} of the valid paths (undisturbed "
        f"{percent(before['false_rejects'])}) and accepts {percent(cell['false_accepts'])} of the invalid ones "
        f"({percent(before['false_accepts'])}). {_dangerous(results, variant)}{_withstands(results, variant)}"
    )


def most_deceived(results: Results, variant: str) -> tuple[str, dict]:
    """The disturbance of pictures or tables, and its strength's numbers, that has most invalid paths accepted."""
    return max(_levels(results), key=lambda of: of[1]["models"][variant]["false_accepts"])


def _dangerous(results: Results, variant: str) -> str:
    """Where a robot would go wrong more often: every strength at which so many more invalid paths pass, or may."""
    levels = {disturbance_phrase(name, level["strength"]): level for name, level in _levels(results)}
    change = {p: c for p, level in levels.items() if (c := level["models"][variant]["more_accepted"])}
    surely = [f"{p} ({_more(c)})" for p, c in change.items() if c["ci_low"] >= SLIGHT]
    perhaps = [f"{p} ({_more(c)})" for p, c in change.items() if c["ci_low"] < SLIGHT < c["ci_high"]]
    lead = f"Of the invalid paths it accepts at least {points(SLIGHT)} more (in points, with the 95 % interval)"
    said = f"{lead} under {listed(surely)}. " if surely else f"{lead} for certain nowhere. "
    return said + (f"It may under {listed(perhaps)}. " if perhaps else "Elsewhere the intervals rule that out. ")


def _more(change: dict) -> str:
    more, low, high = (signed(100 * change[name], 1) for name in ("difference", "ci_low", "ci_high"))
    return f"{more}, {low} to {high}"


def _withstands(results: Results, variant: str) -> str:
    """The disturbances that cost little at their strongest, by the whole interval."""
    strongest = {name: results.robustness["disturbed"][name] for name in _asked(results)}
    kept = [
        disturbance_label(name).lower()
        for name, levels in strongest.items()
        if all(level["models"][variant]["ci_low"] > -SLIGHT for level in levels)
    ]
    said = f", whatever the strength, under {listed(kept)}" if kept else " under no disturbance at every strength"
    return f"By the intervals a loss of {points(SLIGHT)} is ruled out{said}."


def _strange(results: Results) -> str:
    """Whether a model can tell by itself that a picture is unlike those it was taught with."""
    found = results.robustness
    best, plain = most_accurate(results), found["undisturbed"]["strange"]
    levels = {disturbance_phrase(name, level["strength"]): level for name, level in _levels(results)}
    always = [p for p, level in levels.items() if level["strange"]["mean"] >= ALWAYS]
    missed = [
        f"{p} ({percent(level['strange']['mean'], 0)})"
        for p, level in levels.items()
        if (change := level["models"][best]["more_accepted"]) and change["ci_high"] > SLIGHT and p not in always
    ]
    text = (
        f"A picture can be told to be strange by the {found['per_seed']} training pictures alone: "
        f"{percent(plain['mean'])} of the undisturbed ones are ({interval(plain)}; at most "
        f"{percent(1 / (found['per_seed'] + 1))} would be if they came as those did, but their items are new), and "
        f"at least {percent(ALWAYS, 0)} under {listed(always) if always else 'no disturbance'}."
    )
    if missed:
        text += (
            f" Where {variant_phrase(best)} lets more invalid paths through, or may, less often are those under "
            f"{listed(missed)}."
        )
    return text


def _mislabelled(results: Results) -> list[str]:
    """What wrong labels among the demonstrations cost, for each variant that was fitted to them."""
    levels, as_is = results.robustness["disturbed"][LABELS], _as_is(results)
    out = []
    for variant in results.variants:
        asked = [level for level in levels if variant in level["models"]]
        if asked:
            shares = listed([percent(level["strength"], 0) for level in asked])
            scores = listed([percent(level["models"][variant]["accuracy"]["mean"]) for level in asked])
            out.append(
                f"Fitted to demonstrations of which {shares} are labelled wrongly, {variant_phrase(variant)} is right "
                f"about {scores} of the paths, instead of {percent(as_is[variant])}."
            )
    return out
