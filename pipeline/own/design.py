"""Choose the table and path whose judgement best separates the rules that a person may follow.

A rule is a variant of one of the clearance model's rule families, and a margin for each kind of item. It refuses a path
that passes an item within its kind's margin, where the variant counts the item: on the right of the path, say. Of many
tables and paths, the next one has the largest expected information on the rule (Lindley, 1956). An answer is wrong with
probability LAPSES, whatever the rule, so that is the one of which the rules, by weight, are closest to half and half.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.special import entr

from pipeline.world.layout import point_segment_distance, segment_distance

VARIANTS = {  # where an item counts, and the rule family (models.clearance.clearance.FAMILIES)
    "anywhere": "margin",
    "beside a tenth of the path": "dwell",
    "on the right of the path": "side",
    "on the left of the path": "side",
    "beside another item": "proximity",
    "away from other items": "proximity",
    "in the first half of the path": "progress",
    "in the second half of the path": "progress",
}
MARGINS_M = np.arange(7) / 100  # 0: the kind does not matter, and paths may touch it
DWELL_SHARE, CROWDED_M = 0.1, 0.1  # of the path; largest gap to an item that another stands beside
LAPSES = 0.05  # share of answers that no rule explains
MOST_RULES = 20_000  # above it, rules are drawn from the prior; four kinds have 19,208
Question = Float[Array, "*question variant kind"]  # margin [m] from which a rule refuses; inf where none does


@dataclass(frozen=True)
class Rules:
    """Rules that may be a person's, and the probability of each."""

    variant: Int[Array, " rule"]  # index into VARIANTS
    margin: Int[Array, "rule kind"]  # index into MARGINS_M
    weight: Float[Array, " rule"]

    @classmethod
    def of(
        cls, variant: Float[Array, " variant"], margin: Float[Array, "kind margin"], rng: np.random.Generator
    ) -> "Rules":
        """Return rules with a prior: P(variant), and P(margin of MARGINS_M) by kind, independent."""
        sizes = len(variant), *[len(MARGINS_M)] * len(margin)
        if np.prod(sizes, dtype=float) <= MOST_RULES:
            which, *index = np.indices(sizes).reshape(len(sizes), -1)
            weight = variant[which] * np.prod([p[i] for p, i in zip(margin, index, strict=True)], axis=0)
        else:
            which, *index = (rng.choice(len(p), MOST_RULES, p=p / p.sum()) for p in (variant, *margin))
            weight = np.ones(MOST_RULES)
        return cls(which, np.stack(index, -1), weight / weight.sum())

    @classmethod
    def unknown(cls, kinds: int, rng: np.random.Generator) -> "Rules":
        """Return rules of which nothing is known: families, and their variants and margins, are equally likely."""
        return cls.of(by_family({}), np.full((kinds, len(MARGINS_M)), 1 / len(MARGINS_M)), rng)

    def accept(self, questions: Question) -> Bool[Array, "question rule"]:
        """Return which rules accept each path."""
        accepted, allowed = np.ones((len(questions), len(self.variant)), bool), clear(questions)
        for k, margin in enumerate(self.margin.T):
            accepted &= allowed[:, self.variant, k, margin]
        return accepted

    def information(self, accepted: Array) -> Float[Array, " question"]:
        """Return the expected information [bit] of answers, given which rules accept (`accept`), to nine decimals."""
        p = LAPSES + (1 - 2 * LAPSES) * (accepted @ self.weight)
        return ((entr(p) + entr(1 - p) - entr(LAPSES) - entr(1 - LAPSES)) / np.log(2)).round(9)

    def told(self, accepted: Bool[Array, " rule"], answer: bool) -> "Rules":
        """Return the rules after an answer to a question that these rules accept."""
        weight = self.weight * np.where(accepted == answer, 1 - LAPSES, LAPSES)
        return replace(self, weight=weight / weight.sum())

    def known(self) -> tuple[Float[Array, " variant"], Float[Array, "kind margin"]]:
        """Return the probability of each variant, and of each margin by kind."""
        margins = [np.bincount(column, self.weight, len(MARGINS_M)) for column in self.margin.T]
        return np.bincount(self.variant, self.weight, len(VARIANTS)), np.array(margins)


def clear(clearance: Float[Array, "*c"]) -> Bool[Array, "*c margin"]:
    """Return whether paths with a clearance [m] keep each of MARGINS_M; 0 is kept by all."""
    return clearance[..., None] >= np.where(MARGINS_M > 0, MARGINS_M, -np.inf)


def question(
    path: Float[Array, "point 2"],
    ends: Float[Array, "item 2 2"],
    radius: Float[Array, " item"],
    kind: Int[Array, " item"],
    kinds: int,
) -> Question:
    """Return what a path [m] beside capsules [m] asks of each variant and kind.

    path: points at even distances (`evenly`); kind: index, or -1 for an item that rules do not refuse.
    """
    away = point_segment_distance(path[:, None], ends[:, 0], ends[:, 1]) - radius  # (point, item)
    passed, least = away.argmin(0), away.min(0)
    heading, towards = np.gradient(path, axis=0)[passed], ends.mean(1) - path[passed]
    right = heading[:, 1] * towards[:, 0] > heading[:, 0] * towards[:, 1]
    gap = segment_distance(ends[:, None], ends) - radius[:, None] - radius
    crowded = np.where(np.eye(len(ends), dtype=bool), np.inf, gap).min(1) < CROWDED_M
    early = passed < len(path) / 2
    counted = (right, ~right, crowded, ~crowded, early, ~early)
    bounds = np.stack([least, np.quantile(away, DWELL_SHARE, axis=0), *(np.where(c, least, np.inf) for c in counted)])
    return np.stack([bounds[:, kind == k].min(1, initial=np.inf) for k in range(kinds)], axis=-1)


def evenly(path: Float[Array, "_ 2"], points: int) -> Float[Array, "point 2"]:
    """Return points at even distances along a polyline."""
    along = np.append(0, np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum())
    places = np.linspace(0, along[-1], points)
    return np.stack([np.interp(places, along, column) for column in path.T], axis=-1)


def by_family(posterior: dict[str, float]) -> Float[Array, " variant"]:
    """Return P(variant), split evenly in each family; half of it, or all without a posterior, even over families."""
    names = list(VARIANTS.values())
    even, total = 1 / len(set(names)), sum(posterior.values())
    shares = [(even + posterior.get(name, 0.0) / total) / 2 if total else even for name in names]
    return np.array([share / names.count(name) for share, name in zip(shares, names, strict=True)])


def of_members(
    clearance: Float[Array, " question"], accepted: Bool[Array, "question member"]
) -> Float[Array, " margin"]:
    """Return P(margin) of a kind: the share of a model's members whose answers it explains best, half of it even.

    clearance: of paths from an item of the kind [m]. The even half is there because demonstrations are few.
    """
    wrong = (clear(clearance)[:, None] != accepted[..., None]).sum(0)  # (member, margin)
    counts = np.bincount(wrong.argmin(-1), minlength=len(MARGINS_M))
    return (counts / counts.sum() + 1 / len(MARGINS_M)) / 2
