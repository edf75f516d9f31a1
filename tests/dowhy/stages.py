"""The numbers of stage intervene by dowhy.gcm, from the models' answers in outputs/.

Effects of added items and differences between users, after those of a toy model. `make check-dowhy` runs this after
`dvc repro`, in an environment of its own, since dowhy pins other versions. It ends with an error where the two differ.
"""

import sys
import warnings
from pathlib import Path

import networkx as nx
import numpy as np
import pandas as pd
from dowhy import gcm

from tests.dowhy.toy import Mechanism, same, toy

EFFECTS, SUMMARY = Path("outputs/intervene/effects.parquet"), Path("outputs/intervene/summary.csv")
UNITS = 200_000
RNG = np.random.default_rng(0)
LIMIT = 5 * (2 * 0.25 / UNITS) ** 0.5  # of two means over so many units: exceeded once in a million comparisons


def graph(p: np.ndarray, *parents: str):
    """Return discrete roots, all values equally likely, and V = 1 with the probability `p` (*parents) has for them."""
    assert list(parents) == sorted(parents), "dowhy hands parents over in alphabetical order"
    scm = gcm.StructuralCausalModel(nx.DiGraph([(parent, "V") for parent in parents]))
    valid = Mechanism(lambda u, *values: (u < p[tuple(v.astype(int) for v in values)]).astype(float), RNG.random)
    scm.set_causal_mechanism("V", valid)
    for parent in parents:
        scm.set_causal_mechanism(parent, gcm.EmpiricalDistribution())
    units = pd.DataFrame(np.stack([i.ravel() for i in np.indices(p.shape)], -1), columns=list(parents), dtype=float)
    gcm.fit(scm, units.assign(V=0.0))
    return scm


def effect(scm, before: dict[str, int], after: dict[str, int]) -> float:
    """Return E[V | do(after)] - E[V | do(before)]."""
    fixed = [{name: lambda _, v=float(v): v for name, v in do.items()} for do in (after, before)]
    return gcm.average_causal_effect(scm, "V", *fixed, num_samples_to_draw=UNITS)


def interventions() -> bool:
    """Compare both inequalities of the paper for every variant: do(O := O + item) and do(S := s')."""
    effects, summary = pd.read_parquet(EFFECTS), pd.read_csv(SUMMARY)
    agree, keys = True, ["seed", "user", "scene"]
    for variant, asked in summary[summary["kind"].isin(["add", "user"])].groupby("variant"):
        added = asked.loc[asked["kind"] == "add", "question"].unique().tolist()
        rows = effects[(effects["variant"] == variant) & effects["question"].isin(added)]
        baseline = rows[rows["question"] == added[0]].set_index(keys)["baseline"].unstack("scene")
        seeds, users = (baseline.index.unique(name).tolist() for name in keys[:2])
        after = [rows[rows["question"] == q].set_index(keys)["intervened"].unstack("scene") for q in added]
        tables = [table.to_numpy().reshape(len(seeds), len(users), -1) for table in (baseline, *after)]
        scm = graph(np.stack(tables), "added", "model", "s", "scene")
        for row in asked.itertuples():
            s = users.index(row.user)
            if row.kind == "add":
                action = {"added": 1 + added.index(row.question), "s": s}
            else:
                action = {"added": 0, "s": next(i for i, u in enumerate(users) if row.question.endswith(f"_{u}"))}
            theirs = effect(scm, {"added": 0, "s": s}, action)
            agree &= same(f"{variant}, {row.user}: {row.question}", row.effect, theirs, LIMIT)
    return agree


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    gcm.config.disable_progress_bars()
    gcm.util.general.set_random_seed(0)
    if missing := [str(path) for path in (EFFECTS, SUMMARY) if not path.exists()]:
        sys.exit(f"error: {', '.join(missing)} missing: run `make repro` first")
    if not all([toy(), interventions()]):
        sys.exit("error: the libraries differ; the lines above say where")
