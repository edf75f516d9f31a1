"""Compute all results of a folder: the tables that its report shows and holds."""

import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import pandas as pd
from jaxtyping import Float
from matplotlib.font_manager import findfont, get_font
from numpy import ndarray as Array

from pipeline.own import asked, fitting, kinds
from pipeline.own.files import DEMONSTRATIONS
from pipeline.own.fitting import VARIANT, Fitted, UserData, fit_user
from pipeline.own.folder import Folder
from pipeline.own.seen import compared
from pipeline.runtime.parallel import map_jobs

HEADLINES = ["accuracy", "ci_low", "ci_high", "balanced", "missed", "calibration_error"]


@dataclass(frozen=True)
class Results:
    """Hold what the page shows and the tables are written from."""

    folder: Folder
    fitted: dict[str, Fitted]  # by user, in the order of their names
    added: dict[str, kinds.Added]  # by kind
    tables: dict[str, pd.DataFrame]  # with a row an observation, without those that the folder cannot fill
    unlisted: int  # detected objects that are not listed
    apart: int  # sittings of `ask` that are left out
    state: str  # digest of pictures, cut-outs and demonstrations

    def table(self, name: str) -> pd.DataFrame:
        """Return a table by its name, which is also how a number of it names its source."""
        return self.tables[name]

    def source(self, name: str) -> str:
        """Return how a number of a table names it."""
        return name

    def title(self, user: str) -> str:
        """Return a user's name for a figure, or the user's number where figures cannot write it."""
        return _written(user) or f"user {list(self.fitted).index(user) + 1}"

    def kind_title(self, kind: str) -> str:
        """Return the name of a kind that somebody was asked about, or its number where figures cannot write it."""
        return _written(kind) or f"kind {self.tables['asked_compared']['kind'].unique().tolist().index(kind) + 1}"

    @property
    def unwritten(self) -> dict[str, str]:
        """Return the names of users and kinds that figures cannot write, by what stands for them there."""
        kinds_asked = self.tables["asked_compared"]["kind"].unique() if "asked_compared" in self.tables else []
        named = {self.title(user): user for user in self.fitted} | {self.kind_title(one): one for one in kinds_asked}
        return {title: name for title, name in named.items() if not _written(name)}

    def repaired_paths(self, user: str, scene: str) -> dict[str, Float[Array, "point 2"]]:
        """Return the points [m on the table] of a user's repaired paths in a scene, by demonstration."""
        rows = self.tables["repaired_paths"]
        rows = rows[(rows["user"] == user) & (rows["scene"] == scene)]
        return {str(demo): path[["x", "y"]].to_numpy(float) for demo, path in rows.groupby("demo", sort=False)}

    @property
    def metrics(self) -> dict:
        """Return the headlines: counts, and scores by user."""
        scores = self.tables["scores"].query("predictor == @VARIANT and share == 1").set_index("user")[HEADLINES]
        scores["gain_from_seeing"] = self.tables["seeing"].set_index("user")["gain"]
        scores["gain_from_half"] = self.tables["enough"].set_index("user")["gain"]
        demos = self.tables["demonstrations"]
        counted: dict[str, float] = {"scenes": len(self.folder.scenes), "demonstrations": len(demos)}
        counted |= {"degree": int(self.tables["degrees"].query("chosen")["degree"].iloc[0])}
        if "detections" in self.tables:
            counted["recall"] = round(float(self.tables["detections"]["detected"].mean()), 6)
        return {"state": self.state, "users": scores.astype(float).round(6).to_dict("index"), **counted}


def _written(name: str) -> str:
    """Return a name for a figure; "" if the font lacks a letter, or one runs from right to left."""
    font = get_font(findfont("DejaVu Sans"))
    can = all(font.get_char_index(ord(c)) and unicodedata.bidirectional(c) not in ("R", "AL") for c in name)
    return name.replace("\\", "\\\\").replace("$", r"\$") if can else ""


def compute(folder: Folder, given: asked.Given) -> Results:
    """Fit all users' models and return all results, with progress bars; given: answers to `ask` (`asked.given`)."""
    state = asked.digest(folder.path, DEMONSTRATIONS)
    fitted = {user: fit_user(UserData.of(user, folder)) for user in folder.users}

    def by_user(desc: str, ask: Callable[[Fitted], pd.DataFrame]) -> pd.DataFrame:
        return pd.concat(map_jobs(ask, list(fitted.values()), fitting.WORKERS, desc), ignore_index=True)

    judged = pd.concat([one.judged for one in fitted.values()], ignore_index=True)
    tables = {
        "demonstrations": folder.demos,
        "degrees": folder.degrees,
        "predictions": judged,
        "scores": (scored := fitting.scores(judged)),
        "seeing": fitting.gain_from_seeing(judged, scored),
        "enough": fitting.enough(judged, VARIANT),
        "disagreement": by_user("disagreement", lambda one: fitting.disagreement(one, folder)),
    }
    kinds_named = sorted(folder.cutouts)
    placed = map_jobs(partial(kinds.add_kind, folder), kinds_named, fitting.WORKERS, "items added")
    added = {kind: places for kind, places in zip(kinds_named, placed, strict=True) if places is not None}
    if added:
        effects = by_user("interventions", lambda one: kinds.effects(one, added, folder))
        tables["interventions"] = effects
        tables["by_detector"] = by_user("detector's part", lambda one: kinds.by_detector(one, added, folder))
        tables["distances"] = by_user("distances kept", lambda one: kinds.envelopes(one, added, folder, effects))
    repaired = map_jobs(partial(fitting.repairs, folder=folder), list(fitted.values()), fitting.WORKERS, "repairs")
    for name, parts in zip(("repaired", "repaired_paths"), zip(*repaired, strict=True), strict=True):
        tables[name] = pd.concat(parts, ignore_index=True)
    tables |= asked.tables(folder, fitted, given.kept)
    unlisted = 0
    if folder.told:
        tables["detections"], unlisted = compared(folder.seen, folder.scenes)
    return Results(folder, fitted, added, tables, unlisted, given.apart, state)
