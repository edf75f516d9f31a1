"""Interventions and counterfactuals of a toy model by the pipeline and by another library, dowhy.gcm.

`make check-dowhy` runs this in an environment of its own, since dowhy pins other versions than the pipeline. It prints
both answers and ends with an error if they differ.
"""

import sys
import warnings

import networkx as nx
import numpy as np
import pandas as pd
from dowhy import gcm

from pipeline.causal.scm import PARENTS, specification_scm
from tests.dowhy.graph import Mechanism, same

UNITS = 20_000
USERS = ("careful", "normal", "aggressive")
SLOPE = np.array([4.0, 2.0, 0.0])  # how strongly each user keeps away from the item
CODES = {user: float(i) for i, user in enumerate(USERS)}  # dowhy's columns are numbers
FIXED = {"S": "normal", "O": 0.7, "T": 0.2}  # the interventions


def classify(users: np.ndarray, z_image: np.ndarray, z_theta: np.ndarray) -> np.ndarray:
    """Return C_s of a one-dimensional scene: the nearer the item to the path, the less valid."""
    slope = SLOPE[[USERS.index(u) for u in users]]
    return 1 / (1 + np.exp(slope - 6 * slope * np.abs(z_image - z_theta.mean(-1)) - 1))


def model():
    """Return the structural causal model of one-dimensional scenes."""
    return specification_scm(
        USERS,
        render=lambda light, items, table_top: items + table_top + light,
        encode=lambda image: image,
        classify=classify,
        draw_items=lambda rng, units: rng.uniform(size=units),
        draw_table_top=lambda rng, units: rng.uniform(0, 0.1, units),
        draw_render_seed=lambda rng, units: rng.normal(0, 0.05, units),
    )


def graph(units: dict, rng: np.random.Generator):
    """Return the same graph for dowhy; roots are the drawn units themselves."""
    edges = [(parent, node) for node, parents in PARENTS.items() for parent in parents if parent != "Z_theta"]
    scm = gcm.StructuralCausalModel(nx.DiGraph([*edges, ("Z_theta_x", "V"), ("Z_theta_y", "V")]))

    def valid(noise, s, z_image, x, y):
        users = np.array(USERS)[s.astype(int)]
        return (noise < classify(users, z_image, np.stack([x, y], -1))).astype(float)

    scm.set_causal_mechanism(
        "I", Mechanism(lambda n, items, table_top: items + table_top + n, lambda k: rng.normal(0, 0.05, k))
    )
    scm.set_causal_mechanism("Z_I", Mechanism(lambda n, image: image, np.zeros))
    scm.set_causal_mechanism("V", Mechanism(valid, rng.random))
    for root in ("S", "O", "T", "Z_theta_x", "Z_theta_y"):
        scm.set_causal_mechanism(root, gcm.EmpiricalDistribution())
    gcm.fit(scm, columns(units))
    return scm


def columns(values: dict) -> pd.DataFrame:
    """Return values as dowhy's columns of numbers."""
    path = np.asarray(values["Z_theta"], dtype=float)
    numbers = {name: values[name] for name in ("O", "T", "I", "Z_I", "V")}
    return pd.DataFrame(
        numbers | {"S": [CODES[u] for u in values["S"]], "Z_theta_x": path[:, 0], "Z_theta_y": path[:, 1]}
    )


def interventions(rng: np.random.Generator) -> bool:
    """Compare E[V | do(...)] over different draws: alike within chance."""
    ours, agree = model(), True
    other = graph(ours.sample(rng, UNITS), rng)
    for name, value in FIXED.items():
        mine = np.mean(ours.do(**{name: value}).sample(rng, UNITS)["V"])
        coded = CODES.get(value, value) if isinstance(value, str) else value
        theirs = gcm.interventional_samples(other, {name: lambda x, v=coded: v}, num_samples_to_draw=UNITS)["V"].mean()
        agree &= same(f"E[V | do({name} := {value})]", mine, theirs, 4 * (0.5 / UNITS) ** 0.5)
    return agree


def counterfactuals(rng: np.random.Generator) -> bool:
    """Compare V of the same units under another action: equal in every unit; and the closed form."""
    ours, agree = model(), True
    noise = ours.noise(rng, UNITS)
    values = ours.entail(noise)
    recorded = {name: n for name, n in noise.items() if name != "V"}
    abduced = ours.abduction(rng, recorded, {"V": values["V"]})
    other = graph(values, rng)
    table = columns(values | {"I": abduced["I"], "Z_I": abduced["Z_I"], "V": abduced["V"]})
    for name, value in FIXED.items():
        acted = ours.do(**{name: value})
        mine = acted.entail(abduced)
        coded = CODES.get(value, value) if isinstance(value, str) else value
        theirs = gcm.counterfactual_samples(other, {name: lambda x, v=coded: v}, noise_data=table)
        agree &= same(f"V under do({name} := {value}), units that agree", np.mean(mine["V"] == theirs["V"]), 1.0, 0.0)
        rejected = ~values["V"]
        chance = ours.probability_of_change(noise, v=False, **{name: value})[rejected].mean()
        flipped = theirs["V"].to_numpy()[rejected].mean()
        limit = 4 * (0.25 / rejected.sum()) ** 0.5
        agree &= same(f"P(V = 1 under do({name} := {value}) | V = 0)", chance, flipped, limit)
    return agree


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    gcm.config.disable_progress_bars()
    gcm.util.general.set_random_seed(0)
    generator = np.random.default_rng(0)
    if not all([interventions(generator), counterfactuals(generator)]):
        sys.exit("error: the libraries differ; the lines above say where")
