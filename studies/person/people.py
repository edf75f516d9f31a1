"""Simulated people: a margin around each kind, and what makes a person's answers worse than a rule's."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.causal.experiment import LOOKS, NEAR_M, STICKER, UNCHANGED, design, due

SLACK_M = 0.0, 0.08  # of paths that the person accepts: clearance beyond the margin, uniform [m]


@dataclass(frozen=True)
class Person:
    """A margin for each kind, and habits; the defaults make a rule."""

    margins: Mapping[str, float]  # [m]; 0: paths may touch the item
    lapses: float = 0.0  # share of answers given without looking
    accepting: float = 0.5  # share of these that accept: a preferred key
    blur_m: float = 0.0  # standard deviation of a distance as the person sees it
    drift_m: float = 0.0  # growth over 100 judgements of the distance wanted from everything
    order: float = 0.0  # probability that an answer repeats the one before
    compositing: float = 0.0  # probability that a composited item is refused whatever it is

    def accepts(
        self,
        rng: np.random.Generator,
        kind: Array,
        clearance_m: Float[Array, " trial"],
        slack_m: Float[Array, " trial"],
        before: int = 0,
    ) -> Array:
        """Return the answers to trials in their order; clearance_m: of the added item; slack_m: of the path without it.

        before: judgements made earlier.
        """
        margin = np.array([self.margins.get(name, 0.0) for name in kind])
        drift = self.drift_m * (before + np.arange(len(kind))) / 100
        added = kind != UNCHANGED
        seen = np.where(added, np.minimum(slack_m, clearance_m - margin), slack_m)
        answers = seen - drift + self.blur_m * rng.standard_normal(len(kind)) > 0
        answers &= ~(added & (rng.random(len(kind)) < self.compositing))
        answers = np.where(rng.random(len(kind)) < self.lapses, rng.random(len(kind)) < self.accepting, answers)
        for i in np.flatnonzero(rng.random(len(kind)) < self.order):
            answers[i] = answers[max(i - 1, 0)]
        return answers.astype(bool)

    def true_effects(self, rng: np.random.Generator, draws: int) -> dict[str, float]:
        """Return the local effect of each kind and of a sticker, over random scenes and near places, without drift."""
        slack, near = rng.uniform(*SLACK_M, draws), rng.uniform(0, NEAR_M, draws)
        base = self.accepts(rng, np.full(draws, UNCHANGED), near, slack).mean()
        kinds = (*self.margins, STICKER)
        return {kind: float(self.accepts(rng, np.full(draws, kind), near, slack).mean() - base) for kind in kinds}


def sit(person: Person, rng: np.random.Generator, scenes: int) -> tuple[pd.DataFrame, dict[int, bool]]:
    """Return a plan and the person's answers to it until each kind's verdict stands or the last look; no far places."""
    scene = np.concatenate([rng.permutation(scenes) for _ in range(-(-LOOKS[-1] // scenes))])[: LOOKS[-1]]
    plan = design(rng, list(person.margins), scene)
    slack = rng.uniform(*SLACK_M, scenes)[plan["scene"]]  # one path in each scene: pairs of a scene are alike
    quarter = rng.permuted(np.tile(np.arange(4), (len(person.margins) + 1, 7)), axis=1)
    order = {name: i for i, name in enumerate((STICKER, *person.margins))}
    row = [order.get(name, 0) for name in plan["condition"]]
    near = (quarter[row, plan["pair"]] + rng.random(len(plan))) / 4 * NEAR_M
    repeats = plan["repeats"].to_numpy()
    near = np.where(repeats >= 0, near[repeats], near)
    answers: dict[int, bool] = {}
    while (rows := due(plan, answers)) and plan["stage"].iloc[rows[0]] < len(LOOKS):
        judged = person.accepts(rng, plan["condition"].to_numpy()[rows], near[rows], slack[rows], len(answers))
        answers |= dict(zip(rows, judged.tolist(), strict=True))
    return plan, answers
