"""Interventions and counterfactuals of a toy model by the pipeline and by another library, dowhy.gcm.

tests/dowhy/stages.py runs this first. It prints both answers.
"""

import networkx as nx
import numpy as np
import pandas as pd
from dowhy import gcm
from dowhy.gcm.causal_mechanisms import FunctionalCausalModel

from pipeline.causal.scm import PARENTS, chance_of_change, specification_scm

UNITS = 20_000
USERS = ("careful", "normal", "aggressive")
SLOPE = np.array([4.0, 2.0, 0.0])  # how strongly each user keeps away from the item
FIXED = {"S": "normal", "O": 0.7, "T": 0.2}  # the interventions


class Mechanism(FunctionalCausalModel):
    """A given mechanism for dowhy; parents come as columns in alphabetical order."""

    def __init__(self, assign, draw):
        self.assign, self.draw = assign, draw

    def fit(self, X, Y):
        """Do nothing: the mechanism is given."""

    def draw_noise_samples(self, num_samples):
        return self.draw(num_samples)

    def evaluate(self, parent_samples, noise_samples):
        return self.assign(noise_samples.ravel(), *np.asarray(parent_samples, dtype=float).T)

    def clone(self):
        return Mechanism(self.assign, self.draw)


def same(what: str, ours: float, theirs: float, limit: float) -> bool:
    """Print both numbers and return whether they lie within `limit` of each other."""
    agree = bool(abs(ours - theirs) <= limit)
    word = "same" if agree else "DIFFERENT"
    print(f"{word:10}{what}: {ours:.4f} by the pipeline, {theirs:.4f} by dowhy (within {limit:.4f})")
    return agree


def classify(users: np.ndarray, z_image: np.ndarray, z_theta: np.ndarray) -> np.ndarray:
    """Return C_s of a one-dimensional scene: the nearer the item to the path, the less valid."""
    slope = SLOPE[[USERS.index(u) for u in users]]
    return 1 / (1 + np.exp(slope - 6 * slope * np.abs(z_image - z_theta.mean(-1)) - 1))


def graph(units: pd.DataFrame, rng: np.random.Generator):
    """Return the model's graph for dowhy; roots are the drawn units themselves."""
    edges = [(parent, node) for node, parents in PARENTS.items() for parent in parents if parent != "Z_theta"]
    scm = gcm.StructuralCausalModel(nx.DiGraph([*edges, ("Z_theta_x", "V"), ("Z_theta_y", "V")]))

    def valid(noise, s, z_image, x, y):
        return (noise < classify(np.array(USERS)[s.astype(int)], z_image, np.stack([x, y], -1))).astype(float)

    image = Mechanism(lambda n, items, table_top: items + table_top + n, lambda k: rng.normal(0, 0.05, k))
    scm.set_causal_mechanism("I", image)
    scm.set_causal_mechanism("Z_I", Mechanism(lambda n, image: image, np.zeros))
    scm.set_causal_mechanism("V", Mechanism(valid, rng.random))
    for root in ("S", "O", "T", "Z_theta_x", "Z_theta_y"):
        scm.set_causal_mechanism(root, gcm.EmpiricalDistribution())
    gcm.fit(scm, units)
    return scm


def toy() -> bool:
    """Compare E[V | do(...)] over other draws, V of the same units under another action, and the closed form."""
    rng = np.random.default_rng(0)
    ours = specification_scm(
        USERS, lambda light, items, table_top: items + table_top + light, lambda image: image, classify
    )
    noise = {
        "S": rng.integers(len(USERS), size=UNITS), "O": rng.uniform(size=UNITS), "T": rng.uniform(0, 0.1, UNITS),
        "Z_theta": rng.uniform(size=(UNITS, 2)), "I": rng.normal(0, 0.05, UNITS), "Z_I": np.zeros(UNITS),
        "V": rng.random(UNITS),
    }  # fmt: skip
    factual, agree = ours.entail(noise), True
    x, y = noise["Z_theta"].T
    shared = {name: noise[name] for name in ("S", "O", "T")} | {"Z_theta_x": x, "Z_theta_y": y}
    units = pd.DataFrame(shared | {name: factual[name] for name in ("I", "Z_I", "V")}).astype(float)
    noises = pd.DataFrame(shared | {name: noise[name] for name in ("I", "Z_I", "V")}).astype(float)
    theirs = graph(units, rng)
    for name, value in FIXED.items():
        acted = ours.do(**{name: value})
        mine, rejected = acted.entail(noise)["V"], ~factual["V"]
        coded = float(USERS.index(value) if name == "S" else value)  # dowhy's columns are numbers
        action = {name: lambda _, v=coded: v}
        drawn = gcm.interventional_samples(theirs, action, num_samples_to_draw=UNITS)["V"].mean()
        agree &= same(f"E[V | do({name} := {value})]", mine.mean(), drawn, 4 * (0.5 / UNITS) ** 0.5)
        flipped = gcm.counterfactual_samples(theirs, action, noise_data=noises)["V"].to_numpy()
        agree &= same(f"V under do({name} := {value}), units that agree", np.mean(mine == flipped), 1.0, 0.0)
        chance = chance_of_change(False, ours.expectation("V", noise), acted.expectation("V", noise))[rejected].mean()
        limit = 4 * (0.25 / rejected.sum()) ** 0.5
        agree &= same(f"P(V = 1 under do({name} := {value}) | V = 0)", chance, flipped[rejected].mean(), limit)
    return agree
