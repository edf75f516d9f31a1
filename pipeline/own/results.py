"""All results of one folder: what the page shows and the tables hold."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.own import advice, detection, kinds, repairs, scoring
from pipeline.own.data import model_images, user_data
from pipeline.own.fitting import VARIANT, Fitted, fit_user
from pipeline.own.folder import Folder


@dataclass(frozen=True)
class Results:
    """The results of one folder; tables have a row an observation, and None stands for what the folder cannot tell."""

    folder: Folder
    demos: pd.DataFrame
    scenes: kinds.Scenes
    fitted: dict[str, Fitted]
    added: dict[str, kinds.Added]
    judged: pd.DataFrame
    scores: pd.DataFrame
    calibration: pd.DataFrame
    enough: pd.DataFrame
    effects: pd.DataFrame | None
    envelopes: pd.DataFrame | None
    repairs: pd.DataFrame
    advice: pd.DataFrame
    detected: pd.DataFrame | None
    unlisted: int | None

    @property
    def users(self) -> list[str]:
        """Return the users in the order of their names."""
        return list(self.fitted)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Return the tables by name, without those that the folder cannot fill."""
        named = {
            "demonstrations": self.demos,
            "predictions": self.judged,
            "scores": self.scores,
            "reliability": self.calibration,
            "learning": self.enough,
            "interventions": self.effects,
            "distances": self.envelopes,
            "repaired": self.repairs,
            "disagreement": self.advice,
            "detections": self.detected,
        }
        return {name: table for name, table in named.items() if table is not None}

    @property
    def metrics(self) -> dict:
        """Return the headlines."""
        users = scoring.metrics(self.scores, VARIANT)
        for row in self.enough.to_dict("records"):
            users[row["user"]] |= {"gain_from_half": round(row["gain"], 6)}
        counted: dict[str, float] = {"scenes": len(self.scenes.names), "demonstrations": len(self.demos)}
        counted |= {"need_more_control_points": int(self.demos["needs_more"].sum())}
        if self.detected is not None:
            counted["recall"] = round(float(self.detected["detected"].mean()), 6)
        return {"users": users, **counted}


def compute(folder: Folder, demos: pd.DataFrame, kept: Path, progress: Callable[[str], object]) -> Results:
    """Fit all users' models and return all results; models fitted before an interruption are read from `kept`."""
    images = model_images(folder)
    scenes = kinds.read_scenes(images)
    fitted = {user: fit_user(user_data(user, demos, images), kept, progress) for user in folder.users}
    judged = pd.concat([one.judged for one in fitted.values()], ignore_index=True)
    judged["demo"] = demos["demo"].to_numpy()[judged.pop("row")]
    progress("interventions")
    placed = {kind: kinds.add_kind(folder, scenes, kind) for kind in sorted(folder.cutouts)}
    added = {kind: places for kind, places in placed.items() if places is not None}
    effects = pd.concat([kinds.effects(one, added) for one in fitted.values()], ignore_index=True) if added else None
    envelopes = None
    if effects is not None:
        scale = folder.frame.scale
        of_users = [
            kinds.envelopes(one, added, scenes, effects[effects["user"] == user], scale) for user, one in fitted.items()
        ]
        envelopes = pd.concat(of_users, ignore_index=True)
    progress("repairs")
    repaired = pd.concat([repairs.repairs(one, folder.frame.scale) for one in fitted.values()], ignore_index=True)
    repaired.insert(2, "demo", demos["demo"].to_numpy()[repaired.pop("row").astype(int)])
    has_items = folder.items is not None
    return Results(
        folder=folder,
        demos=demos.drop(columns="row"),
        scenes=scenes,
        fitted=fitted,
        added=added,
        judged=judged,
        scores=scoring.scores(judged),
        calibration=scoring.calibration(judged),
        enough=scoring.enough(judged, VARIANT),
        effects=effects,
        envelopes=envelopes,
        repairs=repaired,
        advice=pd.concat([advice.disagreement(one, scenes) for one in fitted.values()], ignore_index=True),
        detected=detection.detected(folder, scenes) if has_items else None,
        unlisted=detection.unlisted(folder, scenes) if has_items else None,
    )
