"""Tables that the paper's pages show and no stage writes: paths by slices, and rows put beside others."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray as Array

from pipeline.causal.interventions import NONE, PAPER, TRUTH
from pipeline.report.results import PAPER_TABLE_1, PAPER_TABLE_2, Results, paper_accuracy
from pipeline.report.style import label
from pipeline.world.bezier import curve
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins, clearance, slack

DISTANCES = (0.0, 0.01, 0.02, 0.04, 0.08, np.inf)  # edges of the slices by distance to the boundary [m]
DISTANCE_LABELS = ["0 to 1 cm", "1 to 2 cm", "2 to 4 cm", "4 to 8 cm", "over 8 cm"]
NOTHING = "nothing to avoid"  # slice of paths in scenes without an item that the user avoids
SLICES = {"user": "user", "nearest": "kind of item nearest", "items": "items on the table", "table_top": "table top"}
SLICES |= {"distance": "distance to the boundary"}
MIN_PATHS = 20  # fewest paths in a bin of stated probabilities that is drawn
REACTS = ("full", "clearance")  # models whose reactions to users are shown
KINDS = {symbol: symbol for symbol in SYMBOLS}  # of items: the columns of `margins`, by title
TABLE_2: dict[str, Any] = {"columns": {"source": "Source", "user": "User", "mean": ""}, "across": "change"}
TABLE_2 |= {"formats": {"": "rate"}, "quartiles": True, "bold": "bold", "beyond": "beyond"}  # how bold.csv is shown
TABLE_2["note"] = lambda row: rests_on(row)
TABLE_2["words"] = {
    "source": lambda name: {PAPER: "The paper, as printed", TRUTH: "Truth in our world"}.get(name) or label(name),
    "change": lambda name: "No intervention" if name == NONE else name.capitalize(),
}
POINTS = 65  # points along a path of which its length is the sum
WORST = 5  # scenes shown, those with most errors


def rests_on(row: Mapping[str, Any]) -> str:
    """Return what a number of Table 2 rests on: the change, its 95 % interval, corrected p, and what is chance."""
    if row["source"] == PAPER:
        return "as printed"
    chance = "scenes and items are chance" if row["source"] == TRUTH else "training sets, scenes and items are chance"
    if pd.isna(row["p_holm"]):
        return chance
    ends = f"95 % interval {row['ci_low']:+.3f} to {row['ci_high']:+.3f}, p {row['p_holm']:.2g} after Holm"
    return f"change {row['effect']:+.3f}, {ends}; {chance}"


def describe(layouts: Layouts, z_theta: Array, margins: Margins, table_tops: Sequence[str]) -> pd.DataFrame:
    """Return a row per path of z_theta (scene, path, 2) [m], in order: scene, query, z_x, z_y, and what it is like.

    distance: slice of |slack|; nearest: the avoided kind of item with the least slack; items: their number in the
    scene; table_top.
    """
    clearances = clearance(layouts, z_theta)
    alone = [{name: margins[name] if name == symbol else None for name in SYMBOLS} for symbol in SYMBOLS]
    slacks = np.stack([slack(layouts, clearances, one) for one in alone])  # (symbol, scene, path)
    least, nearest = slacks.min(0), np.array(SYMBOLS, dtype=object)[slacks.argmin(0)]
    bins = np.digitize(np.abs(least), DISTANCES[1:-1])
    scene, query = np.indices(least.shape)
    columns = {"scene": scene, "query": query, "z_x": z_theta[..., 0], "z_y": z_theta[..., 1]}
    columns["distance"] = np.where(np.isinf(least), NOTHING, np.array(DISTANCE_LABELS)[bins])
    columns["nearest"] = np.where(np.isinf(least), NOTHING, nearest)
    columns |= {"items": layouts.present.sum(1)[scene], "table_top": np.asarray(table_tops)[scene]}
    return pd.DataFrame({name: values.ravel() for name, values in columns.items()})


def by_slice(judged: pd.DataFrame) -> pd.DataFrame:
    """Return scores by variant, split and slice (`all` first), a row for each value that has paths.

    accuracy, with its quartiles q1 and q3 over seeds; unsafe: share of accepted paths that are invalid; refused: share
    of valid paths rejected; both NaN if there are none, and 0 for `all`; share: of all paths.
    """
    accepted, valid = judged["p"] > 0.5, judged["valid"]
    errors = {"unsafe": np.where(accepted, ~valid, np.nan), "refused": np.where(valid, ~accepted, np.nan)}
    table = judged.assign(right=accepted == valid, **errors, all="all")
    parts = []
    for name in ("all", *SLICES):
        keys = ["variant", "split", name]
        groups = table.groupby(keys, observed=True)
        part = groups[["right", *errors]].mean().assign(count=groups.size())
        by_seed = table.groupby([*keys, "seed"], observed=True)["right"].mean().groupby(keys, observed=True)
        part = part.assign(q1=by_seed.quantile(0.25), q3=by_seed.quantile(0.75)).reset_index()
        parts.append(part.rename(columns={name: "value", "right": "accuracy"}).assign(slice=name))
    rows = pd.concat(parts, ignore_index=True)
    rows["value"] = rows["value"].astype(str)
    whole = rows["slice"] == "all"
    rows.loc[whole, [*errors]] = rows.loc[whole, [*errors]].fillna(0.0)  # who accepts nothing accepts nothing invalid
    total = rows[whole].set_index(["variant", "split"])["count"]
    rows["share"] = rows["count"] / total.loc[list(zip(rows["variant"], rows["split"], strict=True))].to_numpy()
    return rows[["variant", "split", "slice", "value", "accuracy", "q1", "q3", "unsafe", "refused", "share", "count"]]


def failing(results: Results) -> str:
    """Return the variant whose failures are shown: the clearance model, or the first one shown."""
    return "clearance" if "clearance" in results.shown else results.shown[0]


def slices(results: Results) -> pd.DataFrame:
    """Return scores of the slices of unseen-item paths in the order of SLICES, distances from near to far.

    blind: accuracy of the guess by position; paths: their number.
    """
    table = results.table("slices").query("split == 'new_items' and slice != 'all'")
    blind = table[table["variant"] == "position_only"].set_index(["slice", "value"])["accuracy"]
    table = table[table["variant"] == failing(results)].join(blind.rename("blind"), on=["slice", "value"])
    order = {name: i for i, name in enumerate([*DISTANCE_LABELS, NOTHING])}
    by = table.assign(a=table["slice"].map(list(SLICES).index), b=table["value"].map(lambda value: order.get(value, 0)))
    rows = by.sort_values(["a", "b", "value"])
    return rows.assign(slice=rows["slice"].map(SLICES), paths=rows["count"] / len(results.seeds))


def worst_scenes(results: Results) -> pd.DataFrame:
    """Return the scenes and users with the lowest accuracy on unseen items, one user a scene.

    Columns scene, user, table_top, items, accuracy, unsafe (share of answers: invalid and accepted), errors (share of
    all errors).
    """
    judged = results.table("judged")
    judged = judged[(judged["variant"] == failing(results)) & (judged["split"] == "new_items")]
    accepted = judged["p"] > 0.5
    judged = judged.assign(right=accepted == judged["valid"], unsafe=accepted & ~judged["valid"])
    groups = judged.groupby(["scene", "user", "table_top", "items"], observed=True)
    rows = groups[["right", "unsafe"]].mean().reset_index().rename(columns={"right": "accuracy"})
    rows["errors"] = groups["right"].agg(lambda right: (~right).sum()).to_numpy() / max((~judged["right"]).sum(), 1)
    return rows.sort_values("accuracy", kind="stable").drop_duplicates("scene").head(WORST)


def unsafe(results: Results) -> pd.DataFrame:
    """Return how often accepted paths are invalid and valid ones refused, in new scenes with unseen items.

    With quartiles over training sets of the first kind; the last row accepts every path.
    """
    judged, rows = results.table("judged").query("split == 'new_items'"), []
    for variant in dict.fromkeys([failing(results), *results.shown]):
        accepted = judged[(judged["variant"] == variant) & (judged["p"] > 0.5)]
        q1, q3 = (1 - accepted.groupby("seed")["valid"].mean()).quantile([0.25, 0.75])
        rates = {column: results.sliced(variant, column) for column in ("unsafe", "refused")}
        rows.append({"variant": variant, "q1": q1, "q3": q3} | rates)
    paths = judged[judged["variant"] == failing(results)]
    rows.append({"variant": "blind", "unsafe": 1 - paths["valid"].mean(), "refused": 0.0})
    return pd.DataFrame(rows)


def paper_curve(results: Results) -> pd.DataFrame:
    """Return accuracy by demonstrations: each reading on held-out paths beside the paper's, the first on new tables."""
    table, first = results.table("curve").query("users == 'paper'"), results.readings[0]
    parts = []
    for reading in results.readings:
        held_out = table[(table["split"] == "held_out") & (table["reading"] == reading)]
        rows = pd.concat([held_out, paper_accuracy()], ignore_index=True)
        parts.append(rows.assign(place=f"Training tables,\n{label(reading)}"))
    new = table[(table["split"] == "new_items") & (table["reading"] == first)]
    return pd.concat([*parts, new.assign(place=f"New tables and items,\n{label(first)}")], ignore_index=True)


def by_demonstrations(results: Results) -> pd.DataFrame:
    """Return accuracy by the number of demonstrations, the paper's where it most likely applies."""
    return pd.concat([results.table("accuracy"), paper_accuracy(split="seen_scenes")], ignore_index=True)


def by_distance(results: Results) -> pd.DataFrame:
    """Return accuracy in the training scenes by distance to the boundary, with the share of paths in its name."""
    rows = "split == 'seen_scenes' and slice == 'distance' and variant != 'position_only'"
    table = results.table("slices").query(rows)
    share = table.groupby("value")["share"].first()
    names = {value: f"{value}\n{100 * share[value]:.0f} % of paths" for value in DISTANCE_LABELS if value in share}
    return pd.concat([table[table["value"] == value].assign(distance=name) for value, name in names.items()])


def calibration(results: Results) -> pd.DataFrame:
    """Return the bins of stated probabilities that have enough paths."""
    return results.table("calibration").query("count >= @MIN_PATHS")


def by_model(results: Results) -> pd.DataFrame:
    """Return the results of repairs by method, model and user; a baseline is its own model."""
    table = results.table("repair")
    return table.assign(variant=table["variant"].where(table["variant"] != "", table["method"]))


def success(results: Results) -> pd.DataFrame:
    """Return success of gradient repair by model and user, of one detour for all, and the paper's rate."""
    table = by_model(results)
    rows, users = table[(table["method"] == "gradient") | (table["variant"] == "constant_detour")], set(table["user"])
    paper = [{"variant": "paper", "user": user, "success": p} for user, p in PAPER_TABLE_1.items() if user in users]
    return pd.concat([rows, pd.DataFrame(paper * ("full" in results.variants))], ignore_index=True)


def table_1(results: Results) -> pd.DataFrame:
    """Return success of gradient repair by model and user, all users from the same starts, and the paper's."""
    paper = pd.DataFrame([{"variant": "paper", "user": user, "success": p} for user, p in PAPER_TABLE_1.items()])
    return pd.concat([paper[paper["user"].isin(results.users)], by_model(results).query("method == 'same_starts'")])


def policy(results: Results) -> pd.DataFrame:
    """Return the share of valid paths of highest return, and their mean length [m], by form of IRL and user."""
    rows = results.table("repairs").query("method == 'policy'")
    steps = np.diff(curve(rows[["z_x", "z_y"]].to_numpy(), POINTS), axis=1)
    rows = rows.assign(length=np.linalg.norm(steps, axis=-1).sum(-1))
    means = rows.groupby(["variant", "user"], sort=False)[["valid_end", "length"]].mean().reset_index()
    return means.assign(valid_end=means["valid_end"].astype(float))


def score(results: Results) -> pd.DataFrame:
    """Return each model's number of right verdicts on added items and on changes of user, and those of no image."""
    rows = [(v, results.verdicts_right(v), results.verdicts_right(v, "user")) for v in results.variants]
    rows.append(("A model that never sees the image", results.image_blind_right(), results.image_blind_right("user")))
    rows.append(("Questions", results.questions(), results.questions("user")))
    return pd.DataFrame(rows, columns=["variant", "added", "user"])


def margins(results: Results) -> pd.DataFrame:
    """Return each user's margins, and the share of random paths valid to them: here and in the paper."""
    rows = pd.DataFrame([{"user": user} | {s: rules[s] for s in SYMBOLS} for user, rules in results.users.items()])
    valid = [float(results.value("p_valid", "truth", user=user, added="none")) for user in results.users]
    paper = PAPER_TABLE_2["none"].reindex(rows["user"]).to_numpy()
    return rows.astype(dict.fromkeys(SYMBOLS, float)).assign(valid=valid, paper=paper)


def loss_shares(results: Results) -> pd.DataFrame:
    """Return the share of each term in the paper's loss after training, mean of the seeds, for each judged user."""
    loss = results.table("loss")
    loss = loss[(loss["n_demos"] == results.main_n_demos) & loss["user"].isin(results.judged_users)]
    last = loss.groupby("user").last()
    return last[["reconstruction", "kl", "classification"]].div(last["total"], axis=0).reset_index()


def reactions(results: Results) -> pd.DataFrame:
    """Return what each user reacts to: the effect of each added item by the truth, by models, and without an image."""
    truth, answers = _answers(results, "add")
    return pd.concat([truth, answers, truth.assign(variant="blind", effect=0.0)], ignore_index=True)


def change_of_user(results: Results) -> pd.DataFrame:
    """Return the effect of do(S := other) for each user and other: the truth, the shown models', and by counting.

    Counting: the difference between the two users' shares of valid random paths, which needs no image.
    """
    truth, answers = _answers(results, "user")
    share = results.table("p_valid").query("added == 'none'").set_index("user")["truth"]
    others = truth["question"].str.removeprefix("another_user_")
    counted = share[others].to_numpy() - share[truth["user"]].to_numpy()
    rows = pd.concat([truth, answers, truth.assign(variant="Counting valid paths", effect=counted)], ignore_index=True)
    return rows.assign(other=rows["question"].str.removeprefix("another_user_"))


def _answers(results: Results, kind: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the true effects of the questions of a kind, as answers without quartiles, and the models' answers."""
    asked = results.table("interventions").query("kind == @kind")
    truth = asked[asked["variant"] == results.variants[0]]
    truth = truth.assign(variant="truth", effect=truth["truth"], q1=np.nan, q3=np.nan)
    return truth, asked[asked["variant"].isin(REACTS)]
