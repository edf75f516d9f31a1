"""Everything the report tabulates and says, in one place, and the check that nothing of it is missing."""

from dataclasses import dataclass

import pandas as pd

from pipeline.errors import InputError
from pipeline.table.layout import SYMBOLS

NULLS = NEAREST, POSITION = "null_nearest", "null_position"  # as stages call them
AVERAGED = "path_averaged"  # as stage misspecify calls the model that it fits beside the variants


@dataclass(frozen=True)
class Results:
    """The stages' numbers as they come; `splits` maps split to pool (None: each seed's own scenes)."""

    users: list[str]
    variants: list[str]
    seeds: list[int]
    ns: list[int]
    study_n: int
    splits: dict[str, str | None]
    judged_users: list[str]  # users that accuracies are averaged over
    world: dict  # stage scenes
    demos: pd.DataFrame
    accuracy: pd.DataFrame  # stage evaluate, one row per variant, user, n, seed, split
    comparisons: pd.DataFrame
    calibration: pd.DataFrame
    evaluation: dict
    per_seed: int  # training scenes
    efficiency: dict  # accuracy against training scenes, and where a threshold is reached
    efficiency_curve: pd.DataFrame  # by variant, scenes and n
    ablation: dict  # what each ingredient of the path model is worth
    acceptance: dict  # paths accepted with a promise, and whether it is kept
    accepted: pd.DataFrame  # the same for several promises
    repairs: pd.DataFrame
    repair: dict  # variant -> user -> numbers
    search: dict  # variant, or "truth" -> user with something invalid -> method -> numbers
    effects: pd.DataFrame
    intervention: dict
    refutation: dict  # questions whose true answer is "nothing"
    confounding: dict  # association against intervention where a common cause acts
    robustness: dict  # accuracy where pictures, tables or labels are worse than in training
    misspecification: dict  # users whose rules are of another form
    counterfactual: dict  # which item is to blame for a rejected path
    envelope: dict  # how far from each symbol validity flips
    planner: str  # the variant whose envelopes specification.yaml holds
    identification: dict  # which user labelled a few paths
    identified: pd.DataFrame  # its rates by variant and number of paths
    selftest: dict  # what the causal procedure makes of simulated families
    curves: dict[str, pd.DataFrame]  # by variant
    recorded: pd.DataFrame  # by recording: its digest and, of a run, the share of its maps that agrees with the truth

    @property
    def main(self) -> str:
        """The paper's own model."""
        return self.variants[0]

    @property
    def refitted(self) -> list[str]:
        """The variants that were fitted to several numbers of scenes."""
        return [v for v in self.variants if len(self.sizes(v)) > 1]

    def sizes(self, variant: str) -> list[int]:
        """The numbers of training scenes a variant was fitted to, at study_n."""
        return sorted(int(name.removeprefix("s")) for name in self.efficiency["accuracy"][variant])

    @property
    def promises(self) -> list[tuple[str, str, dict]]:
        """Variant, split and what became of each rule of accepting paths, in the report's order."""
        found = self.acceptance["acceptance"]
        return [(v, s, found[v][s]) for v in self.variants if v in found for s in self.splits if s in found[v]]

    @property
    def refuters(self) -> list[str]:
        """The attempts to refute, in their order; one made on several tables has a name for each, `kind/table`."""
        return list(self.refutation["order"])

    def refuter(self, name: str) -> dict[str, str]:
        """What is done in an attempt to refute, what it asks, its null hypothesis and how to read its p."""
        return self.refutation["said"][name.partition("/")[0]]

    @property
    def rejecting(self) -> list[str]:
        """Users of whom some variant rejects a path rightly, so that there is someone to blame."""
        cells = self.counterfactual["counterfactual"].values()
        return [u for u in self.users if any(by_user[u] is not None for by_user in cells)]

    @property
    def best_blamer(self) -> str:
        """The variant that most often blames the right item for a rejected path, mean over users."""
        cells = self.counterfactual["counterfactual"]

        def right(variant: str) -> float:
            return sum(c["blame_right"] or 0.0 for c in cells[variant].values() if c is not None)

        return max(self.variants, key=right)

    @property
    def regimes(self) -> dict[str, dict]:
        """The self-test's regimes by name, the variants' own first."""
        found = self.selftest["regimes"]
        return {name: found[name] for name in dict.fromkeys([*self.selftest["measured"], *found])}


def check(results: Results) -> None:
    """Raise InputError naming the first variant, user, seed, n, split or symbol without its results."""
    _check_accuracy(results)
    for variant in results.variants:
        for user in results.users:
            _check_repair(results, variant, user)
            if results.repair[variant][user]["success"] is not None and not results.search.get(variant, {}).get(user):
                raise _missing(f"searches of {variant} for user {user}", "search")
            cells = results.intervention.get("interventions", {}).get(variant, {}).get(user, {})
            lacking = [s for s in SYMBOLS if s not in cells]
            if lacking:
                raise _missing(f"interventions of {variant} for user {user} with {lacking}", "intervene")
        _check_rows(results.effects, results, variant, list(results.users), "effects", "intervene")
        if variant not in results.curves or results.curves[variant].empty:
            raise _missing(f"learning curves of {variant}", "train, irl or path")
        _check_rows(
            results.curves[variant].assign(variant=variant),
            results, variant, list(results.users), "learning curves", "train, irl or path",
        )  # fmt: skip
    _check_answers(results)
    for user in results.users:
        lacking = {"none", *SYMBOLS} - set(results.world.get("p_valid", {}).get(user, {}))
        if lacking:
            raise _missing(f"the world's P(valid) of user {user} with {sorted(lacking)}", "scenes")
        have = set(results.demos.loc[results.demos["user"] == user, "seed"])
        if set(results.seeds) - have:
            raise _missing(f"demonstrations of user {user}, seeds {sorted(set(results.seeds) - have)}", "demos")


def _missing(what: str, stage: str) -> InputError:
    return InputError(f"the report lacks {what}: run stage {stage} with the same parameters, or `dvc repro`")


def _check_accuracy(results: Results) -> None:
    columns = ["variant", "user", "n", "seed", "split"]
    have = set(results.accuracy[columns].itertuples(index=False, name=None))
    for variant in [*results.variants, *NULLS]:
        for user in results.users:
            for n in results.ns:
                for seed in results.seeds:
                    for split, pool in results.splits.items():
                        if variant == "null_nearest" and pool is not None:
                            continue
                        if (variant, user, n, seed, split) not in have:
                            what = f"the accuracy of {variant}, user {user}, n {n}, seed {seed}, split {split}"
                            raise _missing(what, "evaluate")
        for split, pool in results.splits.items():
            if variant == "null_nearest" and pool is not None:
                continue
            for table in ("accuracy", "accuracy_all_users"):
                cells = results.evaluation.get(table, {}).get(variant, {}).get(split, {})
                lacking = [n for n in results.ns if f"n{n}" not in cells]
                if lacking:
                    raise _missing(f"{table} of {variant}, split {split}, n {lacking}", "evaluate")


def _check_answers(results: Results) -> None:
    """Every variant has its answers to the questions beyond the paper's."""
    if not results.confounding.get("interventions"):
        raise _missing("what stage confound says of any variant", "confound")
    if not results.ablation.get("ablations"):
        raise _missing("what stage ablate says of any ingredient", "ablate")
    if not results.misspecification.get("forms"):
        raise _missing("what stage misspecify says of any form", "misspecify")
    if not results.acceptance.get("acceptance"):
        raise _missing("what stage accept says of any variant", "accept")
    answers = {
        "efficiency": results.efficiency.get("accuracy", {}),
        "refute": results.refutation.get("mosaic", {}),
        "robustness": results.robustness.get("undisturbed", {}).get("models", {}),
        "counterfactual": results.counterfactual.get("counterfactual", {}),
        "envelope": results.envelope.get("envelope", {}),
        "identify": results.identification.get("identification", {}),
    }
    for stage, found in answers.items():
        lacking = [v for v in results.variants if v not in found]
        if lacking:
            raise _missing(f"what stage {stage} says of {', '.join(lacking)}", stage)


def _check_repair(results: Results, variant: str, user: str) -> None:
    cell = results.repair.get(variant, {}).get(user)
    if cell is None:
        raise _missing(f"repairs of {variant} for user {user}", "repair")
    if cell["seeds"] != len(results.seeds):
        what = f"repairs of {variant} for user {user} by {len(results.seeds)} seeds (found {cell['seeds']})"
        raise _missing(what, "repair")
    if cell["success"] is not None:
        for method in (variant, "null_constant", "null_random", "oracle"):
            rows = results.repairs.assign(variant=results.repairs["method"])
            _check_rows(rows, results, method, [user], "repairs", "repair")


def _check_rows(rows: pd.DataFrame, results: Results, variant: str, users: list[str], what: str, stage: str) -> None:
    """Every (user, seed) of a variant has at least one row."""
    have = set(rows.loc[rows["variant"] == variant, ["user", "seed"]].itertuples(index=False, name=None))
    for user in users:
        for seed in results.seeds:
            if (user, seed) not in have:
                raise _missing(f"{what} of {variant}, user {user}, seed {seed}", stage)
