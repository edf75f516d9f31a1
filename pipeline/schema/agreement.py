"""What the parameters of each stage must be to those of other groups: what a run of that stage needs, and no more."""

from collections import Counter
from collections.abc import Collection

from pydantic import model_validator

from pipeline.schema.settings import Settings
from pipeline.schema.values import need
from pipeline.table.layout import SYMBOLS

NULLS = NEAREST, _ = "null_nearest", "null_position"  # as results call them
CONFOUNDED, CONTROL = "confounded", "control"  # worlds that stage confound cannot do without
OWN_FORM = "margin"  # the form of users' rules that stage misspecify cannot do without
RESTARTS = 5  # climbs of the search `multistart`
MOST_TESTS = 25  # of 10 seeds the smallest p is 2/1024: Holm over more tests could never find anything


def _some(name: str, values: Collection[str], known: Collection[str], none: bool = False) -> None:
    some = (none or len(values) > 0) and set(values) <= set(known)
    need(some, name, list(values), f"some of {', '.join(known)}")


def _one(name: str, value: str, known: Collection[str]) -> None:
    need(value in known, name, value, f"one of {', '.join(known)}")


def _widest(s: Settings) -> float:
    """The widest margin of any user [m]."""
    return max((m for margins in s.users.values() for m in margins.values() if m is not None), default=0.0)


def evaluate(s: Settings) -> None:
    """Scenes enough for an interval; comparisons where variants and nulls answer, at most MOST_TESTS a family."""
    splits, counts = dict(s.protocol.splits), Counter()
    several = s.scenes.validation > 1 or not {"val_scenes", "val_items"} & set(splits.values())
    need(several, "scenes.validation", s.scenes.validation, "2 at least, to say how much scenes differ")
    for c in s.evaluate.comparisons:
        for name in (c.variant, *c.against):
            _one("evaluate.comparisons", name, [*s.variants, *NULLS])
        for split in c.splits:
            answered = split in splits and (NEAREST not in (c.variant, *c.against) or splits[split] is None)
            where = f"one of {', '.join(splits)}; {NEAREST} has demonstrations only in seen scenes"
            need(answered, "evaluate.comparisons", f"{c.variant} against {', '.join(c.against)} on {split}", where)
        counts[c.family] += len(c.against) * len(c.splits) * ((c.n or s.study_n) in s.n)
    for family, count in counts.items():
        few = f"at most {MOST_TESTS}, or Holm's correction leaves nothing to be found"
        need(count <= MOST_TESTS, "evaluate.comparisons", f"{count} tests in family {family}", few)


def ablate(s: Settings) -> None:
    """A variant of stage path, at numbers of demonstrations that its own stage fits."""
    _one("ablate.variant", s.ablate.variant, [name for name, v in s.variants.items() if v.stage == "path"])
    some = len(s.ablate.n) > 0 and set(s.ablate.n) <= set(s.n)
    need(some, "ablate.n", s.ablate.n, f"some of {', '.join(map(str, s.n))}")


def efficiency(s: Settings) -> None:
    """Numbers of scenes beside the one that all variants are fitted to anyway."""
    own, sizes = s.scenes.per_seed, s.efficiency.scenes
    others = f"whole numbers from 1, each once, some of them other than scenes.per_seed = {own}"
    need(len(set(sizes)) == len(sizes) and bool(set(sizes) - {own}), "efficiency.scenes", sizes, others)
    _some("efficiency.variants", s.efficiency.variants, s.variants)


def _somebody_minds(s: Settings) -> None:
    minds = any(m is not None for margins in s.users.values() for m in margins.values())
    somebody = "one at least who minds an item, or no path is invalid"
    need(minds, "users", {user: dict(margins) for user, margins in s.users.items()}, somebody)


def repair(s: Settings) -> None:
    """Somebody whose paths can be invalid."""
    _somebody_minds(s)


def search(s: Settings) -> None:
    """Somebody whose paths can be invalid, evaluations enough, and rivals of a variant that there is."""
    _somebody_minds(s)
    enough, climbs = s.search.evaluations >= RESTARTS, f"{RESTARTS} at least, for multistart climbs from so many"
    need("multistart" not in s.search.rivals or enough, "search.evaluations", s.search.evaluations, climbs)
    spent, most = s.search.looks + s.search.climb, f"at most the {s.search.evaluations} evaluations"
    need(spent <= s.search.evaluations, "search.looks + search.climb", spent, most)
    if s.search.rivals:
        _one("search.rivals_of", s.search.rivals_of, s.variants)


def _no_more(s: Settings, name: str, scenes: int) -> None:
    need(scenes <= s.scenes.shared, name, scenes, f"at most scenes.shared = {s.scenes.shared}")


def intervene(s: Settings) -> None:
    """Users to exchange."""
    _several_users(s)


def _several_users(s: Settings) -> None:
    need(len(s.users) > 1, "users", list(s.users), "two at least, for each is held against the others")


def counterfactual(s: Settings) -> None:
    """Somebody to blame items for, an example's variant, no more scenes than there are, nor moved items than those."""
    _somebody_minds(s)
    c = s.counterfactual
    _no_more(s, "counterfactual.scenes", c.scenes)
    _one("counterfactual.example_variant", c.example_variant, s.variants)
    most = f"at most counterfactual.scenes = {c.scenes}"
    need(c.moved_scenes <= c.scenes, "counterfactual.moved_scenes", c.moved_scenes, most)


def refute(s: Settings) -> None:
    """Far from an item is where no user minds it; and what was added to a scene is taken as one item."""
    _no_more(s, "refute.scenes", s.refute.scenes)
    need(s.scenes.shared > 3, "scenes.shared", s.scenes.shared, "4 at least, for stage refute asks halves of them")
    _beyond_margins(s, "refute.far_m", s.refute.far_m)
    _some("refute.permuted", s.refute.permuted, s.variants, none=True)
    of_one = "1, for what was added to a scene is taken as one item"
    need(s.intervene.placements == 1, "intervene.placements", s.intervene.placements, of_one)


def envelope(s: Settings) -> None:
    """Clear of other items is where no user minds them."""
    _one("envelope.planner", s.envelope.planner, s.variants)
    _beyond_margins(s, "envelope.clear_of_others", s.envelope.clear_of_others)


def _beyond_margins(s: Settings, name: str, length: float) -> None:
    need(length > _widest(s), name, length, f"more than the widest margin in users, {_widest(s)} m: raise it")


def identify(s: Settings) -> None:
    """A stranger who is no known user, and numbers of paths that are shown."""
    _several_users(s)
    i = s.identify
    new = i.stranger not in s.users.values()
    need(new, "identify.stranger", i.stranger, "margins that no user has: nobody else can be told from a known user")
    need(max(i.reported) <= i.paths, "identify.reported", i.reported, f"whole numbers from 1 to {i.paths}")


def selftest(s: Settings) -> None:
    """Families no smaller than those it draws from."""
    cells = len(s.evaluate.users) * len(SYMBOLS)
    measured = f"at least the {cells} cells of evaluate.users"
    need(s.selftest.cells >= cells, "selftest.cells", s.selftest.cells, measured)


def confound(s: Settings) -> None:
    """Worlds with and without a common cause, in which things have room, and who is fitted in them."""
    c, layout = s.confound, s.scenes.layout
    need(
        {CONFOUNDED, CONTROL} <= set(c.worlds),
        "confound.worlds",
        list(c.worlds),
        f"{CONFOUNDED} and {CONTROL} among them",
    )
    together = c.worlds[CONTROL].together
    need(together == 0, f"confound.worlds.{CONTROL}.together", together, "0, no common cause")
    lengths = f"two lengths from scenes.layout.clear_of_items = {layout.clear_of_items} on, the smaller first [m]"
    for name, world in c.worlds.items():
        low, high = world.gap_m
        need(layout.clear_of_items <= low <= high, f"confound.worlds.{name}.gap_m", world.gap_m, lengths)
    room = layout.slots - max(layout.items_per_scene) + 1
    whole = f"a whole number from 1 to {room}, which scenes.layout.slots leaves room for"
    need(c.glasses <= room, "confound.glasses", c.glasses, whole)
    _some("confound.users", c.users, s.users)
    _some("confound.variants", c.variants, s.variants)
    for name, worlds in c.variants.items():
        those = f"{CONFOUNDED} and others of {', '.join(c.worlds)}"
        need(CONFOUNDED in worlds and set(worlds) <= set(c.worlds), f"confound.variants.{name}", worlds, those)


def robustness(s: Settings) -> None:
    """No more scenes than there are, and variants to be fitted to wrong labels."""
    _no_more(s, "robustness.scenes", s.robustness.scenes)
    _some("robustness.mislabelled", s.robustness.mislabelled, s.variants)


def misspecify(s: Settings) -> None:
    """The users' own form among the others, and variants that there are."""
    own, forms = OWN_FORM in s.misspecify.forms, list(s.misspecify.forms)
    need(own, "misspecify.forms", forms, f"{OWN_FORM} among them, for the others are held against it")
    many = s.misspecify.forms.get("several", 1)
    need(many >= 1, "misspecify.forms.several", many, "at least 1: no form forbids a path that the user's own allows")
    _some("misspecify.variants", s.misspecify.variants, s.variants)


def accept(s: Settings) -> None:
    """Scenes to fit models to and others to calibrate them in, and the promise among those drawn."""
    a, scenes = s.accept, s.scenes.per_seed
    _some("accept.variants", a.variants, s.variants)
    need(a.level in a.levels, "accept.levels", a.levels, f"numbers with accept.level = {a.level} among them")
    need(a.fitted < scenes, "accept.fitted", a.fitted, f"a whole number from 1 to {scenes - 1}")
    divides = f"a whole number from 2 that divides scenes.per_seed = {scenes}"
    need(scenes % a.folds == 0, "accept.folds", a.folds, divides)


def record(s: Settings) -> None:
    """Variants that there are, and one split, since a recording shows repairs beside interventions."""
    _some("record.first", s.record.first, s.variants, none=True)
    same = f"repair.split = {s.repair.split!r}, since a recording shows both"
    need(s.intervene.split == s.repair.split, "intervene.split", s.intervene.split, same)


def report(s: Settings) -> None:
    """Variants that there are."""
    _some("report.shown", s.report.shown, s.variants)


AGREEMENTS = {
    f.__name__: f
    for f in (
        evaluate, ablate, efficiency, repair, search, intervene, counterfactual, refute, envelope, identify, selftest,
        confound, robustness, misspecify, accept, record, report,
    )
}  # fmt: skip


class Agreed(Settings):
    """All of conf/, and what the stages listed in the context need."""

    @model_validator(mode="after")
    def _agreed(self, info):
        for stage in info.context or ():
            if stage in AGREEMENTS:
                AGREEMENTS[stage](self)
        return self
