"""Results as the stages would leave them: the contract's tables with made-up numbers clearly in range."""

from collections.abc import Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.causal.interventions import PAPER_BOLD
from pipeline.report.derived import DISTANCE_LABELS, NOTHING, by_slice
from pipeline.report.results import PAPER_ACCURACY, PAPER_TABLE_2, DrawnScenes, Results
from pipeline.stages.report import DECISIONS, HISTORY
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, Layouts, random_layouts
from tests.factories import MARGINS, RULES

DATA = Path("data")
catalogue_of = cache(read_catalogue)
VARIANTS = ("full", "ae", "classifier", "irl_maxent", "irl_ranked", "clearance")
READINGS, BLIND = ("few_routes_4cm", "few_routes_8cm", "random_routes"), ("nearest_demonstration", "position_only")
SPLITS = ("seen_scenes", "new_scenes", "new_items")
N_DEMOS, SEEDS, SCENES, STARTS, STEPS, SIDE = (1, 9), (0, 1), 3, 2, 4, 12
LEVEL = {"full": 0.54, "ae": 0.54, "classifier": 0.55, "irl_maxent": 0.84, "irl_ranked": 0.91, "clearance": 0.97}
TRAIN = {"steps": 600, "rate": 0.003, "weight_decay": 0.01, "adam_beta2": 0.99}
TRAIN |= {"model": {"latent": 15, "channels": [16, 8, 4], "hidden": 64}}
FACTS = {
    "data_md5": "9bf8cba6a5daf2c6", "patterned_top": "onyx", "root_seed": 2040, "profile": "paper",
    "studies": {"shift": "How much do worse images hurt?"}, "scenes_per_seed": 20, "test_scenes": SCENES,
    "items_per_scene": [2, 3],
    "effect_scenes": SCENES, "repair_steps": STEPS, "optimiser": "adam", "repair_rate": 0.5, "distance_penalty": 0.3,
    "weights": {"alpha": 10.0, "beta": 0.005, "gamma": 1.0}, "train": TRAIN,
}  # fmt: skip


def grid(**keys: Iterable) -> pd.DataFrame:
    """Return a row for each combination of values."""
    return pd.DataFrame(list(product(*keys.values())), columns=list(keys))


def around(table: pd.DataFrame, mean: Any, name: str = "", **ends: float) -> pd.DataFrame:
    """Return a table with a mean, quartiles .01 and an interval .02 away from it; `name` begins their columns."""
    reach = {"q1": -0.01, "q3": 0.01, "ci_low": -0.02, "ci_high": 0.02, "ci90_low": -0.017, "ci90_high": 0.017} | ends
    return table.assign(**{name.rstrip("_") or "mean": mean}, **{name + end: mean + by for end, by in reach.items()})


def tables(
    variants: Sequence[str] = VARIANTS, users: Sequence[str] = tuple(MARGINS), shown: Sequence[str] = ()
) -> dict[str, pd.DataFrame]:
    """Return every table the pages draw from, made once."""
    made = _tables(tuple(variants), tuple(users), tuple(shown) or _shown(variants))
    return {name: table.copy() for name, table in made.items()}


@cache
def _tables(variants: tuple[str, ...], users: tuple[str, ...], shown: tuple[str, ...]) -> dict[str, pd.DataFrame]:
    judged = [user for user in ("careful", "normal") if user in users]
    accuracy = grid(variant=variants, split=SPLITS, n_demos=N_DEMOS)
    raised = 0.02 * (accuracy["split"] == "seen_scenes") - 0.1 * (accuracy["n_demos"] == 1)
    blind = pd.concat([
        grid(variant=["position_only"], split=SPLITS, n_demos=N_DEMOS).assign(mean=0.59),
        grid(variant=["nearest_demonstration"], split=["seen_scenes"], n_demos=N_DEMOS).assign(mean=0.78),
    ])  # fmt: skip
    calibration = grid(variant=variants, split=SPLITS, low=np.arange(10) / 10)
    scores = grid(variant=[*variants, "position_only"], split=SPLITS)
    ends = {f"{name}_{end}": 0.1 for name in ("ece", "brier", "bias", "auroc") for end in ("q1", "q3")}
    others = [name for name in variants if name != "full"]
    comparisons = grid(variant=[v for v in variants if v == "full"], against=others, n_demos=(9, 1), split=SPLITS)
    comparisons = comparisons[(comparisons["n_demos"] == 9) | comparisons["against"].str.startswith("irl")]
    difference = LEVEL["full"] - comparisons["against"].map(LEVEL).astype(float)
    interventions = _questions(variants, users)
    repair = pd.concat([
        grid(method=["gradient", "plain", "nearest"], variant=variants, user=judged),
        grid(method=["same_starts"], variant=variants, user=users),
        grid(method=["random_path", "constant_detour", "oracle"], variant=[""], user=judged),
    ], ignore_index=True)  # fmt: skip
    success = repair["variant"].map(LEVEL).fillna(repair["method"].map({"constant_detour": 0.8}).fillna(0.5))
    repair = around(repair, success, "success_", q1=-0.02, q3=0.02, ci_low=-0.1, ci_high=0.02)
    model = repair["variant"] != ""
    curve = grid(reading=READINGS, split=("held_out", "new_items"), variant=("full", *BLIND), n_demos=N_DEMOS)
    curve = curve[(curve["split"] == "held_out") | (curve["variant"] != BLIND[0])]
    paper = (curve["reading"] != "random_routes") & (curve["split"] == "held_out")  # these are as in the paper
    mean = curve["n_demos"].map({n: mean for n, (mean, *_) in PAPER_ACCURACY.items()}).where(paper, 0.7)
    p_valid = grid(user=users, added=PAPER_TABLE_2.columns)
    printed = [float(PAPER_TABLE_2.loc[user, added]) for user, added in p_valid.itertuples(index=False)]  # pyright: ignore
    demos = grid(seed=SEEDS, user=users, scene=range(SCENES), demo=range(3))
    paths = _judged(shown, judged)
    made = {
        "accuracy": pd.concat([around(accuracy, accuracy["variant"].map(LEVEL) + raised), blind.assign(
            q1=blind["mean"], q3=blind["mean"])], ignore_index=True),
        "calibration": calibration.assign(
            count=20, confidence=calibration["low"] + 0.05, frequency=calibration["low"] + 0.02),
        "scores": scores.assign(ece=0.03, brier=0.12, bias=0.01, **ends).assign(
            auroc=scores["variant"].map(LEVEL).fillna(0.6)),
        "comparisons": comparisons.assign(
            difference=difference, q1=difference - 0.01, q3=difference + 0.01, ci90_high=0.03, p_holm=0.03,
            significant=difference.abs() > 0.05),
        "repair": repair.assign(
            starts=SCENES * STARTS, displacement_ratio=1.3, accepted=model.where(model) * 0.9,
            unsafe=(1 - success).where(model)),
        "repairs": pd.concat([
            grid(method=[method], variant=variants, user=of, seed=SEEDS, scene=range(SCENES), start=range(STARTS))
            for method, of in (("gradient", judged), ("same_starts", users), ("policy", users))
        ]).assign(z_x=0.3, z_y=0.6).assign(valid_end=True),
        "seeds": pd.DataFrame({"headline": "accuracy.full.new_items", "seed": SEEDS, "value": 0.5}),
        "interventions": interventions,
        "bold": _bold(variants, users),
        "curve": around(curve, mean).assign(users="paper", fits=6, passed=5, passed_mean=mean),
        "p_valid": p_valid.assign(truth=np.subtract(printed, 0.01), paper=printed, difference=-0.01),
        "recordings": grid(variant=variants, user=users).assign(run="full-careful-s0"),
        "demos": demos.assign(z_x=0.3 * demos["demo"], z_y=0.9 - 0.3 * demos["demo"], valid=demos["demo"] > 0),
        "convergence": grid(variant=[v for v in ("full", "ae") if v in variants]).assign(
            reconstruction_over_flat=2.2, own_demonstrations=0.9, passed=0.0),
        "loss": grid(user=users, n_demos=N_DEMOS).assign(reconstruction=1.0, kl=1.0, classification=2.0, total=4.0),
        "judged": paths,
        "slices": by_slice(paths),
    }  # fmt: skip
    return made | {name: pd.read_csv(DECISIONS / file) for name, file in HISTORY.items()}


def _judged(shown: Sequence[str], users: Sequence[str]) -> pd.DataFrame:
    """Return judged paths: every fifth answer is wrong, and the description of a path follows its number."""
    judges, splits = [*shown, "position_only", "nearest_demonstration"], ("seen_scenes", "new_items")
    rows = grid(variant=judges, user=users, split=splits, seed=SEEDS, scene=range(SCENES), query=range(5))
    rows = rows[(rows["variant"] != "nearest_demonstration") | (rows["split"] == "seen_scenes")]
    number, valid = rows["query"], (rows["query"] + rows["scene"]) % 2 == 0
    return rows.assign(
        valid=valid, p=np.where(valid ^ (number == 3), 0.7, 0.2), z_x=0.2 * number, z_y=0.9 - 0.2 * number,
        distance=number.map(dict(enumerate(DISTANCE_LABELS))), nearest=number.map(dict(enumerate([*SYMBOLS, NOTHING]))),
        items=2 + rows["scene"] % 2, table_top="oak",
    )  # fmt: skip


def _bold(variants: Sequence[str], users: Sequence[str]) -> pd.DataFrame:
    """Return Table 2: the paper's model and its ablations see nothing, the others all that the paper has in bold."""
    rows = grid(source=("the paper", "truth", *variants), user=users, change=PAPER_TABLE_2.columns)
    bold = [(user, change) in PAPER_BOLD and LEVEL.get(source, 1.0) >= 0.6 for source, user, change in rows.to_numpy()]
    cells = zip(rows["user"], rows["change"].where(bold, "none"), strict=True)
    rows = around(rows, np.array([float(PAPER_TABLE_2.loc[cell]) for cell in cells])).assign(bold=bold, beyond=bold)
    rows = rows.assign(effect=-0.15 * rows["bold"], p_holm=np.where(rows["change"] == "none", np.nan, 0.01))
    rows.loc[rows["source"] == "the paper", ["q1", "q3", "p_holm"]] = np.nan
    return rows


def _questions(variants: Sequence[str], users: Sequence[str]) -> pd.DataFrame:
    """Return answers to added items and to changes of user; the paper's model sees no effect of items."""
    rows = []
    for variant, user in product(variants, users):
        for symbol in SYMBOLS:
            truth = -0.15 if MARGINS[user][symbol] is not None else 0.0
            rows.append((f"add_{symbol}", "add", symbol, variant, user, truth if LEVEL[variant] >= 0.6 else 0.0, truth))
        others = [other for other in users if other != user]
        rows += [(f"another_user_{other}", "user", "", variant, user, 0.2, 0.2) for other in others]
    made = pd.DataFrame(rows, columns=["question", "kind", "symbol", "variant", "user", "effect", "truth"])
    said = {of: np.where(made[of].abs() > 0.05, "effect", "negligible") for of in ("effect", "truth")}
    made = made.assign(verdict=said["effect"], truth_verdict=said["truth"], right=said["effect"] == said["truth"])
    made = around(made.drop(columns="effect"), made["effect"], "").rename(columns={"mean": "effect"})
    return made.assign(p_holm=0.01)


def _shown(variants: Sequence[str]) -> tuple[str, ...]:
    return tuple(v for v in ("full", "clearance", "irl_ranked") if v in variants) or (variants[0],)


@cache
def _layouts() -> Layouts:
    catalogue = catalogue_of(DATA)
    return random_layouts(np.random.default_rng(0), SCENES, catalogue.footprints, catalogue.pool("unseen"), RULES)


def results(
    variants: Sequence[str] = VARIANTS, users: Sequence[str] = tuple(MARGINS), shown: Sequence[str] = (), **changes
) -> Results:
    """Return results of these variants and users, drawn as plain grey with smooth maps; `changes` replace tables."""
    judged, shown = [user for user in ("careful", "normal") if user in users], list(shown or _shown(variants))
    steps = np.linspace([1.0, 0.1], [0.5, 0.5], STEPS + 1)
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    maps, grey = np.stack([(x + y) / 2] * SCENES), np.full((SCENES, 100, 100, 3), 150, np.uint8)
    drawn = DrawnScenes(
        images=grey, layouts=_layouts(), mapped=list(range(SCENES)),
        maps={v: dict.fromkeys(users, maps) for v in shown}, truth={u: maps > 0.5 for u in users},
        patterned=grey, patterned_maps={v: dict.fromkeys(users, 1 - maps) for v in shown},
        added_user=judged[-1], added_images=np.stack([grey[0]] * 5),
        added_maps={"truth": np.stack([maps[0] > 0.5] * 5), shown[0]: np.stack([maps[0]] * 5)}, training=grey,
    )  # fmt: skip
    runs = [f"{v}-{u}-s{s}" for v, u, s in product(variants, judged, SEEDS)] + [f"same_starts-{u}" for u in users]
    return Results(
        variants=list(variants), users={user: MARGINS[user] for user in users}, judged_users=judged, seeds=list(SEEDS),
        n_demos=list(N_DEMOS), main_n_demos=9, shown=shown, tables=tables(variants, users, shown) | changes,
        paths=dict.fromkeys(runs, np.stack([steps] * SCENES * STARTS)), drawn=drawn,
        facts=FACTS | {"studies": dict(FACTS["studies"])},
    )  # fmt: skip
