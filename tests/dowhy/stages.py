"""The numbers of stages intervene and counterfactual by dowhy.gcm, from the models' answers that lie in outputs/.

Every effect of an added item, every difference between users, and the probabilities of necessity and sufficiency of
the worked examples. `make check-dowhy` runs this after `dvc repro`; it ends with an error where the two differ.
"""

import json
import sys
import warnings
from pathlib import Path

import networkx as nx
import numpy as np
import pandas as pd
from dowhy import gcm

from tests.dowhy.graph import Mechanism, said

EFFECTS, CAUSES = Path("outputs/intervene"), Path("outputs/counterfactual")
UNITS = 200_000
RNG = np.random.default_rng(0)
APART = 5 * (2 * 0.25 / UNITS) ** 0.5  # two means of so many coins: apart by more once in a million comparisons


def graph(p: np.ndarray, *parents: str):
    """Discrete roots, all values alike, and V = 1 with the chance that the table `p` (*parents) has for them."""
    assert list(parents) == sorted(parents), "dowhy hands them over in this order"
    scm = gcm.StructuralCausalModel(nx.DiGraph([(parent, "V") for parent in parents]))
    chance = Mechanism(lambda u, *at: (u < p[tuple(x.astype(int) for x in at)]).astype(float), RNG.random)
    scm.set_causal_mechanism("V", chance)
    for parent in parents:
        scm.set_causal_mechanism(parent, gcm.EmpiricalDistribution())
    units = pd.DataFrame(np.stack([i.ravel() for i in np.indices(p.shape)], -1), columns=list(parents), dtype=float)
    gcm.fit(scm, units.assign(V=0.0))
    return scm


def effect(scm, before: dict[str, int], after: dict[str, int]) -> float:
    """E[V | do(after)] - E[V | do(before)]."""
    fixed = [{name: lambda _, v=float(v): v for name, v in do.items()} for do in (after, before)]
    return gcm.average_causal_effect(scm, "V", *fixed, num_samples_to_draw=UNITS)


def interventions() -> bool:
    """Both inequalities of the paper, for every variant: do(O := O + symbol) for each user, and do(S := s)."""
    told, rows = json.loads((EFFECTS / "metrics.json").read_text()), pd.read_parquet(EFFECTS / "effects.parquet")
    fine, by = True, ["seed", "user", "scene", "symbol"]
    for variant, of in rows.groupby("variant"):
        cells = of.groupby(by)[["baseline", "intervened"]].mean()  # over placements
        seeds, users, scenes, symbols = (list(cells.index.unique(name)) for name in by)
        shape = (len(seeds), len(users), len(scenes), len(symbols))
        before, after = (cells[name].to_numpy().reshape(shape) for name in ("baseline", "intervened"))
        p = np.concatenate([before[..., :1], after], -1)  # added: nothing, or a symbol
        scm = graph(np.moveaxis(p, -1, 0), "added", "model", "s", "scene")
        for s, user in enumerate(users):
            for added, symbol in enumerate(symbols, 1):
                ours = told["interventions"][variant][user][symbol]["effect"]
                theirs = effect(scm, {"added": 0, "s": s}, {"added": added, "s": s})
                fine &= said(f"{variant}, {user}: a {symbol} is added", ours, theirs, APART)
            for other in (u for u in users if u != user):
                ours = told["specifications"][variant][user][other]["effect"]
                theirs = effect(scm, {"added": 0, "s": s}, {"added": 0, "s": users.index(other)})
                fine &= said(f"{variant}: {user} becomes {other}", ours, theirs, APART)
    return fine


def counterfactuals() -> bool:
    """Necessity and sufficiency of every item in the worked examples, by every variant and the truth."""
    fine = True
    for example in json.loads((CAUSES / "metrics.json").read_text())["examples"]:
        for user, variants in example["users"].items():
            for variant, x in variants.items():
                for j in range(len(example["items"])):
                    where = f"{example['kind']}, {user}, {variant}, item {j}"
                    fine &= cause(f"necessity: {where}", x["pn"][j], [x["p_without"][j], x["p"]], present=1)
                    fine &= cause(f"sufficiency: {where}", x["ps"][j], [x["p_empty"], x["p_alone"][j]], present=0)
    return fine


def cause(what: str, ours: float | None, p: list[float], present: int) -> bool:
    """P(V changes if the item comes or goes), among units that are invalid with it (1) or valid without it (0).

    `p`: chance of V = 1 without and with the item. None where no unit is such.
    """
    units = pd.DataFrame({"there": float(present), "V": RNG.random(UNITS)})  # V: its noise
    seen = units["V"] < p[present]
    kept = units[~seen if present else seen]
    if ours is None or kept.empty:
        rare = p[present] if not present else 1 - p[present]
        return said(f"units of {what}", rare, 0.0, 1e-4)
    scm = graph(np.array(p), "there")
    after = gcm.counterfactual_samples(scm, {"there": lambda _: float(1 - present)}, noise_data=kept)["V"]
    return said(what, ours, float((after == present).mean()), 1e-5 + 5 * (0.25 / len(kept)) ** 0.5)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    gcm.config.disable_progress_bars()
    gcm.util.general.set_random_seed(0)
    if missing := [str(f) for f in (EFFECTS / "effects.parquet", CAUSES / "metrics.json") if not f.exists()]:
        sys.exit(f"error: {', '.join(missing)} is not there; run `dvc repro intervene counterfactual` first")
    if not all([interventions(), counterfactuals()]):
        sys.exit("error: the libraries differ; the lines above say where")
