"""Design and analyse an experiment on a person: the person judges the same path with and without a composited item.

Two estimands. The *local effect* of a kind, over scenes and paths that the person accepted earlier,

    E[V | do(add an item whose edge is within NEAR_M of the path)] - E[V | do(add nothing)]

is settled by a dozen pairs. The unchanged picture is judged anew, since the earlier judgement selected the path. The
*average effect*, over random free places, adds far places by inverse sampling weights. It needs hundreds of judgements.

A pair is one path in one scene, judged once under each condition, in random order. If the item matters no more than
nothing, both answers of a pair are exchangeable: lapses, drift, a preferred key and effects of order then only add
noise. A person may also react to compositing itself. So an effect must differ from that of a flat sticker, too.

Data are looked at after LOOKS pairs. Effects spend SPENT of the level at each look, Holm's correction over kinds
within it. Equivalence is tested at the same one-sided level at each look (Pocock, 1977). EQUIVALENCE_LEVEL is such that
an effect of SMALLEST_LOCAL_EFFECT is called negligible with probability at most 5 % over all looks, however often the
person errs; a test computes it. The looks were chosen by such calculations, for people who err in 2 % of answers.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.stats import binomtest

from pipeline.causal.paired import Scenes, interval, sign_flip
from pipeline.stats.tests import holm, verdict

UNCHANGED, STICKER, EXTRA = "unchanged", "sticker", "extra"  # conditions beside the kinds
NEAR_M = 0.04  # largest clearance of a near item from the path [m on the table]
SMALLEST_LOCAL_EFFECT = 0.25  # smallest local effect of interest: one answer in four changes
LOOKS = 13, 20, 27  # pairs after which the data are looked at
SPENT = 0.032, 0.009, 0.009  # of the two-sided level of effects; eight pairs that all change pass at the first look
EQUIVALENCE_LEVEL = 0.042  # one-sided, at each look
WITHOUT_STICKER = range(10, LOOKS[0])  # pairs: ten stickers do before the first look, unless an effect waits for more
BLOCK = 4  # pairs that are mixed in random order: whoever stops early has whole pairs
EARLY = 3  # extra trials before the first look: a repair, its original and a detour, within 60 trials of four kinds
REPEATED, LEAST_BETWEEN = 0.1, 6  # share of trials that are asked again, and trials in between
STOPS = "effect", "negligible"  # verdicts that stand
DISTANCES_M = 0.0, 0.01, 0.02, 0.03, 0.04, 0.08  # lower ends of intervals of clearance
BOUNDS = "ci_low", "ci_high", "ci90_low", "ci90_high"


def design(rng: np.random.Generator, kinds: Sequence[str], scene: Scenes, extra: Sequence[int] = ()) -> pd.DataFrame:
    """Return all trials in the order in which they may be asked; the rule of `due` skips some.

    scene: of each of the last look's pairs; extra: scenes of trials that are asked in any case, the first EARLY of them
    in the second block of pairs, the others after the first look. Columns: stage (the look that the trial precedes;
    len(LOOKS) for far places), pair, scene, condition (UNCHANGED, STICKER, a kind, or "extra"), near, extra (its
    position, or -1) and repeats (the row that is asked again, or -1).
    """
    rows: list[dict] = []
    stages = np.searchsorted(LOOKS, np.arange(len(scene)), side="right")
    parts = [(s, np.flatnonzero(stages == s)) for s in range(len(LOOKS))] + [(len(LOOKS), np.arange(len(scene)))]
    blocks = [(s, b.tolist()) for s, pairs in parts for b in np.array_split(pairs, max(1, len(pairs) // BLOCK))]
    later = next(i for i, (stage, _) in enumerate(blocks) if stage > 0)
    extras = {1: range(len(extra))[:EARLY], later: range(len(extra))[EARLY:]}  # by block
    for i, (stage, block) in enumerate(blocks):
        near = stage < len(LOOKS)
        conditions = (UNCHANGED, STICKER, *kinds) if near else kinds
        trials = [(p, c, -1) for p in block for c in conditions if c != STICKER or p not in WITHOUT_STICKER]
        trials += [(-1, EXTRA, e) for e in extras.get(i, [])]
        scenes = [int(scene[pair]) if pair >= 0 else int(extra[e]) for pair, _, e in trials]
        begin = len(rows)
        for t in _apart(rng, scenes):
            pair, condition, e = trials[t]
            row = {"stage": stage, "pair": pair, "scene": scenes[t], "condition": condition, "near": near, "extra": e}
            rows.append(row | {"repeats": -1})
        early = range(begin, max(begin + 1, len(rows) - LEAST_BETWEEN))
        count = min(len(early), int(REPEATED * len(trials) + rng.uniform()))
        rows += [rows[i] | {"repeats": i} for i in sorted(rng.choice(early, count, replace=False).tolist())]
    return pd.DataFrame(rows, columns=["stage", "pair", "scene", "condition", "near", "extra", "repeats"])


def _apart(rng: np.random.Generator, scenes: Sequence[int]) -> list[int]:
    """Return the positions of trials in random order, none after one of its own scene if that can be avoided."""
    left, order = rng.permutation(len(scenes)).tolist(), list[int]()
    while left:
        last = scenes[order[-1]] if order else -1
        common, count = Counter(scenes[i] for i in left).most_common(1)[0]
        rush = 2 * count > len(left) and common != last  # or two of this scene would meet at the end
        pick = next((i for i in left if scenes[i] != last and (not rush or scenes[i] == common)), left[0])
        left.remove(pick)
        order.append(pick)
    return order


def due(plan: pd.DataFrame, answers: Mapping[int, bool]) -> list[int]:
    """Return the rows of the plan that are to be asked next, in order, all of one stage; none if all is asked.

    A kind is asked until its verdict stands, and unchanged pictures as long as any kind is, or extra trials are.
    Stickers are asked before the first look, and later as long as an open kind changes SMALLEST_LOCAL_EFFECT of the
    answers. Far places come last, of all kinds. answers: by row of the plan.
    """
    stage, condition = plan["stage"].to_numpy(), plan["condition"].to_numpy()
    wanted = set(condition)
    for step in range(len(LOOKS) + 1):
        rows = np.flatnonzero((stage == step) & np.isin(condition, list(wanted)))
        if left := [i for i in rows.tolist() if i not in answers]:
            return left
        wanted = set(condition)
        if step < len(LOOKS) - 1:
            table = local_verdicts(plan, answers, step)
            table = table[~table["verdict"].isin(STOPS) & (table["kind"] != STICKER)]
            mixed = len(table) or EXTRA in condition[stage == step + 1]  # extra trials come among unchanged ones
            wanted = {*table["kind"], UNCHANGED, EXTRA} if mixed else set()
            if (table["effect"].abs() >= SMALLEST_LOCAL_EFFECT).any():
                wanted.add(STICKER)
    return []


def answered(plan: pd.DataFrame, answers: Mapping[int, bool]) -> pd.DataFrame:
    """Return the rows of the plan that have an answer, with column `answer`."""
    rows = sorted(answers)
    return plan.iloc[rows].assign(answer=[bool(answers[i]) for i in rows])


def local_verdicts(plan: pd.DataFrame, answers: Mapping[int, bool], last: int = len(LOOKS) - 1) -> pd.DataFrame:
    """Return one row for each kind, and for the sticker, with the local effect and its verdict, up to a `last` look.

    It is that of the look that decided: the first at which the verdict stands, or the last one reached; an unfinished
    stage counts as its look. Columns: kind; look, 1 for the first; pairs; effect; ci_low, ci_high (95 % over all
    looks); ci90_low, ci90_high (for equivalence); beyond_sticker (effect less the sticker's, in the same pairs);
    p_holm (over kinds, the larger one of both contrasts); verdict. An effect that is not significant in both contrasts
    is `undecided`. So is everything if all answers are the same: nothing then shows that the person looks.
    """
    names = [UNCHANGED, STICKER, *sorted(set(plan["condition"]) - {UNCHANGED, STICKER, EXTRA})]
    stage, varied = plan["stage"].to_numpy(), len(set(answers.values())) > 1
    matrix, scene = _matrix(plan, answers, names, True)
    rows: list[dict] = []
    for look in range(min(last, int(stage[list(answers)].max(initial=0))) + 1):
        now = _effects(names, matrix[:, : LOOKS[look]], scene[: LOOKS[look]], look, varied)
        stands = [row["verdict"] in STOPS and row["kind"] != STICKER for row in rows or now]
        rows = [old if stand else new for old, stand, new in zip(rows or now, stands, now, strict=True)]
    return pd.DataFrame(rows)


def _matrix(plan: pd.DataFrame, answers: Mapping[int, bool], names: Sequence[str], near: bool) -> tuple[Array, Scenes]:
    """Return the answers (condition, pair), 0 or 1, NaN where none is, and each pair's scene; repeats do not count."""
    pair, conditions, repeats, is_near = (plan[c].to_numpy() for c in ("pair", "condition", "repeats", "near"))
    table = np.full((len(names), max(int(pair.max(initial=0)) + 1, LOOKS[-1])), np.nan)
    scene, row = np.zeros(table.shape[1], int), {name: i for i, name in enumerate(names)}
    scene[pair[pair >= 0]] = plan["scene"].to_numpy()[pair >= 0]
    for i, answer in answers.items():
        name = conditions[i]
        if name in row and repeats[i] < 0 and is_near[i] == (near or name == UNCHANGED):
            table[row[name], pair[i]] = answer
    return table, scene


def _effects(
    names: Sequence[str], matrix: Float[Array, "condition pair"], scene: Scenes, look: int, varied: bool
) -> list[dict]:
    """Return the rows of `local_verdicts` at one look."""
    rows, contrasts = [], []
    for name, answers in zip(names[1:], matrix[1:], strict=True):
        differences = [answers - matrix[0], answers - matrix[1]]  # over the unchanged picture, and over the sticker
        scenes = [scene[~np.isnan(one)] for one in differences]
        changes = [one[~np.isnan(one)].astype(int) for one in differences]
        contrasts.append([sign_flip(*contrast) for contrast in zip(changes, scenes, strict=True)])
        effect, beyond = (float(change.mean()) if len(change) else np.nan for change in changes)
        levels = SPENT[look] / 2, EQUIVALENCE_LEVEL
        bounds = [bound for level in levels for bound in interval(changes[0], scenes[0], level)]
        row = {"kind": name, "look": look + 1, "pairs": len(changes[0]), "effect": effect}
        rows.append(row | dict(zip(BOUNDS, bounds, strict=True)) | {"beyond_sticker": beyond})
    adjusted = [contrasts[0][0], *holm(np.max(contrasts[1:], axis=1)).tolist()] if len(rows) > 1 else [contrasts[0][0]]
    for row, p in zip(rows, adjusted, strict=True):
        word = verdict(*(row[bound] for bound in BOUNDS), smallest=SMALLEST_LOCAL_EFFECT)
        unproven = word in ("effect", "present") and p >= SPENT[look]
        row |= {"p_holm": p, "verdict": "undecided" if unproven or not varied else word}
    return rows


def average_effects(plan: pd.DataFrame, answers: Mapping[int, bool], share_near: Mapping[str, float]) -> pd.DataFrame:
    """Return one row for each kind with its average effect over random free places.

    share_near: the share of free places that is near the path, by kind. Near and far pairs are weighted by these shares
    over the shares in which they were asked. The 95 % interval adds the exact ones of both, each at 97.5 %. Columns:
    kind, share_near, near_pairs, far_pairs, effect (NaN without a pair on either side), ci_low, ci_high.
    """
    rows, names = [], [UNCHANGED, *share_near]
    sides = [_matrix(plan, answers, names, side) for side in (True, False)]
    for i, (kind, share) in enumerate(share_near.items(), 1):
        ends, effect, pairs = np.zeros(2), 0.0, []
        for (matrix, scene), weight in zip(sides, (share, 1 - share), strict=True):
            difference = matrix[i] - matrix[0]
            both = ~np.isnan(difference)
            change = difference[both].astype(int)
            ends += weight * np.array(interval(change, scene[both], 0.0125))
            effect += weight * (change.mean() if len(change) else np.nan)
            pairs.append(len(change))
        rows.append((kind, share, *pairs, effect, *ends))
    return pd.DataFrame(rows, columns=["kind", "share_near", "near_pairs", "far_pairs", "effect", "ci_low", "ci_high"])


def accepted_shares(trials: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Return the share of answers that accept, by columns, with Wilson's 95 % interval; columns count and share."""
    groups = trials.groupby(list(by), sort=False)["answer"]
    rows = [(*key, len(part), *wilson(int(part.sum()), len(part))) for key, part in groups]
    return pd.DataFrame(rows, columns=[*by, "count", "share", "ci_low", "ci_high"])


def wilson(hits: int, count: int) -> tuple[float, float, float]:
    """Return a share with its 95 % interval (Wilson, 1927); NaN without a trial."""
    if not count:
        return np.nan, np.nan, np.nan
    ends = binomtest(hits, count).proportion_ci(method="wilson")
    return hits / count, float(ends.low), float(ends.high)


def by_distance(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the share that is accepted by kind and interval of the item's clearance [m]: the person's own envelope.

    trials: with column clearance_m. Columns: kind, from_m, count, share, ci_low, ci_high.
    """
    added = trials[(trials["repeats"] < 0) & ~trials["condition"].isin([UNCHANGED, STICKER, EXTRA])]
    index = np.searchsorted(DISTANCES_M, added["clearance_m"].to_numpy(float), side="right") - 1
    added = added.assign(kind=added["condition"], from_m=np.array(DISTANCES_M)[np.maximum(index, 0)])
    return accepted_shares(added.sort_values(["kind", "from_m"]), ["kind", "from_m"])


def agreement(trials: pd.DataFrame, accepted: Bool[Array, " trial"]) -> pd.DataFrame:
    """Return how often the person agrees with a model and with themself, with Wilson's 95 % intervals.

    accepted: the model's answers, from models that were not fitted to the trial. Rows `model`, `self` (over repeats)
    and `ceiling`, which follows from `self`: a model that knew everything but the person's lapses, which are a share e
    of answers, would agree on 1 - e, and the person agrees with themself on 1 - 2 e (1 - e).
    """
    first = trials["repeats"].to_numpy() < 0
    answers = dict(zip(trials.index, trials["answer"], strict=True))
    again = [(answers[r], a) for r, a in zip(trials["repeats"], trials["answer"], strict=True) if r in answers]
    same = trials["answer"].to_numpy(bool) == accepted
    rows = [("model", int(first.sum()), *wilson(int(same[first].sum()), int(first.sum())))]
    rows.append(("self", len(again), *wilson(sum(a == b for a, b in again), len(again))))
    rows.append(("ceiling", len(again), *((1 + np.sqrt(np.maximum(2 * np.array(rows[1][2:]) - 1, 0))) / 2)))
    return pd.DataFrame(rows, columns=["who", "count", "share", "ci_low", "ci_high"])


def smallest_settled(pairs: int) -> float:
    """Return the smallest effect that this many pairs without any change call absent, at one look."""
    return -interval(np.zeros(pairs, int), np.arange(pairs), EQUIVALENCE_LEVEL)[0]


def pairs_within(judgements: int, kinds: int) -> int:
    """Return how many whole pairs of so many kinds fit into a number of judgements, repeats and stickers included."""
    return int(judgements / (1 + REPEATED) / (kinds + 2))
