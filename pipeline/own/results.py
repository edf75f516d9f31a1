"""All results of one folder: what the page shows and the tables hold."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.own import kinds, repairs, scoring
from pipeline.own.data import Scenes, UserData
from pipeline.own.fitting import VARIANT, Fitted, fit_user
from pipeline.own.folder import Folder

HEADLINES = ["accuracy", "ci_low", "ci_high", "balanced", "missed", "calibration_error"]


@dataclass(frozen=True)
class Results:
    """The results of one folder."""

    folder: Folder
    scenes: Scenes
    fitted: dict[str, Fitted]  # by user, in the order of their names
    added: dict[str, kinds.Added]  # by kind
    tables: dict[str, pd.DataFrame]  # with a row an observation, without those that the folder cannot fill
    unlisted: int  # detected objects that are not listed

    @property
    def metrics(self) -> dict:
        """Return the headlines: counts, and scores by user."""
        scores = self.tables["scores"].query("predictor == @VARIANT and share == 1").set_index("user")[HEADLINES]
        scores["gain_from_half"] = self.tables["enough"].set_index("user")["gain"]
        demos = self.tables["demonstrations"]
        counted: dict[str, float] = {"scenes": len(self.scenes.names), "demonstrations": len(demos)}
        counted |= {"need_more_control_points": int(demos["needs_more"].sum())}
        if "detections" in self.tables:
            counted["recall"] = round(float(self.tables["detections"]["detected"].mean()), 6)
        return {"users": scores.astype(float).round(6).to_dict("index"), **counted}


def compute(folder: Folder, kept: Path, progress: Callable[[str], object]) -> Results:
    """Fit all users' models and return all results; models fitted before an interruption are read from `kept`."""
    scenes, scale = Scenes.of(folder), folder.frame.scale
    fitted = {u: fit_user(UserData.of(u, folder.demos, scenes), kept, progress) for u in folder.users}

    def by_user(ask: Callable[[Fitted], pd.DataFrame]) -> pd.DataFrame:
        return pd.concat([ask(one) for one in fitted.values()], ignore_index=True)

    judged = by_user(lambda one: one.judged)
    tables = {
        "demonstrations": folder.demos,
        "predictions": judged,
        "scores": scoring.scores(judged),
        "reliability": scoring.calibration(judged),
        "enough": scoring.enough(judged, VARIANT),
        "disagreement": by_user(lambda one: scoring.disagreement(one, scenes)),
    }
    progress("interventions")
    placed = {kind: kinds.add_kind(folder, scenes, kind) for kind in sorted(folder.cutouts)}
    added = {kind: places for kind, places in placed.items() if places is not None}
    if added:
        effects = {user: kinds.effects(one, added) for user, one in fitted.items()}
        tables["interventions"] = pd.concat(effects.values(), ignore_index=True)
        tables["distances"] = by_user(lambda one: kinds.envelopes(one, added, scenes, effects[one.data.user], scale))
    progress("repairs")
    tables["repaired"] = by_user(lambda one: repairs.repairs(one, scale))
    unlisted = 0
    if folder.items is not None:
        tables["detections"], unlisted = scenes.detected(folder.items, folder.frame)
    return Results(folder, scenes, fitted, added, tables, unlisted)
