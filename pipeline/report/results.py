"""The data of all pages: the stages' tables by name, and the arrays behind the figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from pipeline.causal.interventions import asked, bold_or_plain, right_verdicts
from pipeline.report.study import Data
from pipeline.report.tables import named
from pipeline.world.layout import Layouts
from pipeline.world.rules import PAPER_P_VALID

PAPER_TABLE_1 = {"careful": 0.75, "normal": 0.95, "aggressive": 1.0}  # success rate of repair by user (paper, Table 1)
PAPER_SCENES = 20  # test scenes of the paper: the largest number of repairs behind a rate of Table 1
PAPER_ACCURACY = {1: (0.72, 0.673, 0.775), 9: (0.99, 0.978, 0.998)}  # n_demos -> mean, q1, q3 ("Model Accuracy")
RANDOM_ROUTES = "random_routes"  # the reading of the main run (stage readings)
PAPER_TABLE_2 = pd.DataFrame.from_dict(PAPER_P_VALID, orient="index")  # by user
UNSURE = (0.3, 0.8)  # P(valid) of a path about which a model is unsure
SOURCES = (  # tables of whose numbers the pages' texts are made: written beside the pages
    "accuracy", "calibration", "scores", "comparisons", "repair", "interventions", "bold", "curve", "p_valid",
    "convergence", "slices", "seeds",
)  # fmt: skip


def paper_accuracy(**key: str) -> pd.DataFrame:
    """Return the paper's accuracy by demonstrations as rows of a table: variant, n_demos, mean, q1, q3, and `key`."""
    rows = pd.DataFrame.from_dict(PAPER_ACCURACY, orient="index", columns=["mean", "q1", "q3"])
    return rows.rename_axis("n_demos").reset_index().assign(variant="paper", **key)


@dataclass(frozen=True)
class DrawnScenes:
    """The scenes shown in figures: one pool's images and layouts, and the shown models' maps of P(valid).

    images: uint8 (scene, 100, 100, 3); maps: variant -> user -> (scene, side, side) as [y, x] on `lattice(side)`,
    for the scenes in `mapped`; truth: user -> bool of the same shape. patterned, patterned_maps: the images and maps of
    the same scenes on a patterned table top. added_images: uint8 (1 + symbol, 100, 100, 3),
    one scene without and with each added item; added_maps: "truth" or variant -> (1 + symbol, side, side), for
    `added_user`. training: uint8 (scene, 100, 100, 3), the first training scenes of the first seed.
    """

    images: np.ndarray
    layouts: Layouts
    mapped: list[int]
    maps: dict[str, dict[str, np.ndarray]]
    truth: dict[str, np.ndarray]
    patterned: np.ndarray
    patterned_maps: dict[str, dict[str, np.ndarray]]
    added_user: str
    added_images: np.ndarray
    added_maps: dict[str, np.ndarray]
    training: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Results(Data):
    """The results of one run.

    tables: accuracy, calibration, scores, comparisons, repair (summary), repairs, interventions (summary), bold,
    p_valid, recordings, convergence, demos, judged (paths, by `derived.describe`), slices, seeds (headlines by training
    set), curve, draws, changes, effort, sealed; paths: paths.npz of stage repair; facts: settings that pages print.
    """

    n_demos: list[int]
    shown: list[str]  # variants whose maps and repairs are drawn
    paths: Mapping[str, np.ndarray]
    drawn: DrawnScenes

    def __post_init__(self):
        """Make names that csv reads as missing, such as the variant of a baseline, empty ones."""
        object.__setattr__(self, "tables", {name: named(table) for name, table in self.tables.items()})

    def accuracy(self, variant: str, split: str, column: str = "mean", n: int | None = None) -> float:
        """Return one number of accuracy.csv, at main_n_demos unless `n` is given."""
        return self.value("accuracy", column, variant=variant, split=split, n_demos=n or self.main_n_demos)

    def curve(
        self, reading: str, variant: str, n: int, split: str = "held_out", users: str = "paper", column: str = "mean"
    ) -> Any:
        """Return one number of curve.csv: `users` are the paper's three, or "judged"."""
        return self.value("curve", column, reading=reading, variant=variant, n_demos=n, split=split, users=users)

    @property
    def readings(self) -> list[str]:
        """Return the readings of the paper, the main run's random routes last."""
        names = self.table("curve")["reading"].unique().tolist()
        return sorted(names, key=lambda name: name == RANDOM_ROUTES)

    @property
    def curve_ends(self) -> tuple[int, int]:
        """Return the least and the largest number of demonstrations that every reading has."""
        table = self.table("curve")
        shared = set.intersection(*(set(rows["n_demos"]) for _, rows in table.groupby("reading")))
        return min(shared), max(shared)

    def readings_as_in_the_paper(self, variant: str) -> list[str]:
        """Return the readings in which a variant's means lie within the paper's quartiles at both ends."""
        found = []
        for reading in self.readings:
            rows = self.table("curve").query("reading == @reading and variant == @variant")
            rows = rows.query("split == 'held_out' and users == 'paper'").set_index("n_demos")["mean"]
            if all(n in rows and low <= rows[n] <= high for n, (_, low, high) in PAPER_ACCURACY.items()):
                found.append(reading)
        return found

    def repair(self, method: str, variant: str, user: str, column: str = "success") -> float:
        """Return one number of repair/summary.csv; baselines have the variant \"\"."""
        return self.value("repair", column, method=method, variant=variant, user=user)

    def sliced(self, variant: str, column: str) -> Any:
        """Return one number over all judged paths in new scenes with unseen items."""
        return self.value("slices", column, variant=variant, split="new_items", slice="all", value="all")

    def unsure(self, variant: str) -> dict[str, float] | None:
        """Return the mean stated P(valid), the share valid and the number of the unseen-item paths given .3 to .8."""
        rows = self.table("judged")
        rows = rows[(rows["variant"] == variant) & (rows["split"] == "new_items") & rows["p"].between(*UNSURE)]
        return {"stated": rows["p"].mean(), "valid": rows["valid"].mean(), "count": len(rows)} if len(rows) else None

    def asked(self, kind: str, variant: str) -> pd.DataFrame:
        """Return a variant's rows for one kind of question; of "add", those for users with invalid paths."""
        rows = asked(self.table("interventions"), kind, self.judged_users)
        return rows[rows["variant"] == variant]

    def questions(self, kind: str = "add") -> int:
        """Return the number of these questions."""
        return len(self.asked(kind, self.variants[0]))

    def verdicts_right(self, variant: str, kind: str = "add") -> int:
        """Return the number of a variant's right verdicts on these questions."""
        return right_verdicts(self.table("interventions"), kind, self.judged_users).get(variant, 0)

    def image_blind_right(self, kind: str = "add") -> int:
        """Return the number of right verdicts of an image-blind model: items have no effect, users differ."""
        answers = self.asked(kind, self.variants[0])["truth_verdict"]
        return int((answers == ("negligible" if kind == "add" else "effect")).sum())

    @property
    def bold_or_plain(self) -> str:
        """Return the sentence on cells of Table 2 that are bold or plain as in the paper."""
        return bold_or_plain(self.table("bold"))

    @property
    def largest_difference(self) -> float | None:
        """Return how far a true share of valid paths is from the paper's Table 2 at most; None if it has none."""
        difference = self.table("p_valid")["difference"].abs().max()
        return None if np.isnan(difference) else float(difference)

    @property
    def pictured(self) -> list[str]:
        """Return the paper's model and the clearance model, if they are shown; else the first variant shown."""
        return [v for v in ("full", "clearance") if v in self.shown] or self.shown[:1]

    @property
    def content_users(self) -> list[str]:
        """Return the users who avoid nothing: every path is valid to them."""
        return [user for user, margins in self.users.items() if not any(margins.values())]

    @cached_property
    def repaired_users(self) -> list[str]:
        """Return the users with an invalid path to repair."""
        repaired = set(self.table("repair")["user"])
        return [user for user in self.judged_users if user in repaired]
