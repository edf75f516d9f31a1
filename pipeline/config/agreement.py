"""What the parameters of each stage must be to those of other groups: what a run of that stage needs, and no more."""

from collections import Counter
from collections.abc import Collection

from pydantic import model_validator

from pipeline.config.settings import Settings
from pipeline.config.values import need

NULLS = NEAREST, _ = "nearest_demonstration", "position_only"  # as results call them
MOST_TESTS = 25  # of 10 seeds the smallest p is 2/1024: Holm over more tests could never find anything


def _some(name: str, values: Collection[str], known: Collection[str], none: bool = False) -> None:
    some = (none or len(values) > 0) and set(values) <= set(known)
    need(some, name, list(values), f"some of {', '.join(known)}")


def _one(name: str, value: str, known: Collection[str]) -> None:
    need(value in known, name, value, f"one of {', '.join(known)}")


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
        counts[c.family] += len(c.against) * len(c.splits) * ((c.n_demos or s.main_n_demos) in s.n_demos)
    for family, count in counts.items():
        few = f"at most {MOST_TESTS}, or Holm's correction leaves nothing to be found"
        need(count <= MOST_TESTS, "evaluate.comparisons", f"{count} tests in family {family}", few)


def _somebody_minds(s: Settings) -> None:
    minds = any(m is not None for margins in s.users.values() for m in margins.values())
    somebody = "one at least who minds an item, or no path is invalid"
    need(minds, "users", {user: dict(margins) for user, margins in s.users.items()}, somebody)


def repair(s: Settings) -> None:
    """Somebody whose paths can be invalid."""
    _somebody_minds(s)


def intervene(s: Settings) -> None:
    """Users to exchange."""
    _several_users(s)


def _several_users(s: Settings) -> None:
    need(len(s.users) > 1, "users", list(s.users), "two at least, for each is held against the others")


def record(s: Settings) -> None:
    """Variants that there are, and one split, since a recording shows repairs beside interventions."""
    _some("record.first", s.record.first, s.variants, none=True)
    same = f"repair.split = {s.repair.split!r}, since a recording shows both"
    need(s.intervene.split == s.repair.split, "intervene.split", s.intervene.split, same)


def report(s: Settings) -> None:
    """Variants that there are."""
    _some("report.shown", s.report.shown, s.variants)


AGREEMENTS = {f.__name__: f for f in (evaluate, repair, intervene, record, report)}


class Agreed(Settings):
    """All of conf/, and what the stages listed in the context need."""

    @model_validator(mode="after")
    def _agreed(self, info):
        for stage in info.context or ():
            if stage in AGREEMENTS:
                AGREEMENTS[stage](self)
        return self
