"""The command `ask --design`: the table and path that best separate the rules a person may follow come next."""

import json
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.models.clearance.clearance import PATH_SAMPLES, ClearanceModel, passes
from pipeline.own import kinds
from pipeline.own.asked import VALID, accepted_paths, footprint, picture, seen_with, sittings
from pipeline.own.design import LAPSES, VARIANTS, Rules, evenly, from_models, question
from pipeline.own.fitting import UserData, fit_on
from pipeline.own.folder import Folder
from pipeline.own.frame import CANVAS_PX
from pipeline.own.recorder.asking import Asking, png
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.world.layout import segment_distance

PLACES, FARTHEST_M = 80, 0.1  # of each kind among which the next one is chosen; clearance from the path, at most
TRIES = 12  # free places tried for each of these
LEAST_BITS = 0.05  # of expected information; below it nothing is asked
POINTS = 120  # along a path
YELLOW = (240, 228, 66)  # as the page draws paths


class Designing(Asking):
    """Sittings whose plan holds the tables to choose among; each answer decides which comes next."""

    suffix = "-design"

    def __init__(self, folder: Folder, user: str | None, minutes: float) -> None:
        """Open a folder, as `Asking`."""
        super().__init__(folder, user, minutes)
        self.before: dict[str, Rules] = {}  # each user's rules before this sitting's answers
        self.accepted: dict[str, Bool[Array, "trial rule"]] = {}
        self.names = sorted(folder.cutouts)

    def prepared(self, user: str) -> dict[str, Any]:
        """Return tables to choose among: a path that the user accepts, and an item at a random free place near it."""
        seed = f"{self.digest}/{user}"
        rng, paths, rows = stream("own", "design", seed), accepted_paths(self.folder, user), []
        path_ends, objects = kinds.ends_of_paths(self.folder), self.folder.seen.objects
        for name in self.names if paths else ():
            for i in range(PLACES):
                cutout = i % len(self.folder.cutouts[name])
                capsule = kinds.footprint(*self.folder.cutouts[name][cutout])
                for _ in range(TRIES):
                    path = sorted(paths)[rng.integers(len(paths))]
                    scene = self.folder.scenes.index(paths[path]["scene"])
                    ends = path_ends[paths[path]["scene"]]
                    place = kinds.free_place(rng, self.folder.frame, objects, scene, capsule, ends)
                    if place is None:
                        continue
                    row = {"scene": scene, "path": path, "condition": name, "cutout": cutout, "angle": place[1]}
                    row |= {"x": float(place[0][0]), "y": float(place[0][1])}
                    clearance = float(self.questions([pd.Series(row)], paths).min())
                    if 0 < clearance <= FARTHEST_M:
                        rows.append(row | {"clearance_m": clearance})
                        break
        if not rows:
            raise InputError(f"there is nothing to ask {user}: add cut-outs, and paths that {user} calls valid")
        plan = pd.DataFrame(rows)
        trials = json.loads(plan.to_json(orient="records", double_precision=6))
        shown = {name: paths[name] for name in sorted(set(plan["path"]))}
        common = {"user": user, "digest": self.digest, "seed": seed, "share_near": {}, "paths": shown}
        return common | {"lapses": LAPSES, "trials": trials}

    def questions(self, rows: Iterable[Any], paths: dict[str, dict[str, Any]]) -> Float[Array, "row variant kind"]:
        """Return what rows of a plan ask (`design.question`), in metres on the table."""
        frame, seen, made = self.folder.frame, self.folder.seen.objects, []
        for row in rows:
            present = seen.present[row.scene]
            ends, radius = footprint(self.folder, row)
            ends = frame.to_table(np.concatenate([seen.ends[row.scene, present], ends[None]]))
            radii = np.append(seen.radius[row.scene, present], radius) / frame.scale
            kind = np.append(np.full(present.sum(), -1), self.names.index(row.condition))
            path = evenly(np.array(paths[row.path]["points"], float), POINTS)
            made.append(question(path, ends, radii, kind, len(self.names)))
        return np.stack(made)

    def start(self, user: str) -> None:
        """Take a user's rules from a model fitted to all demonstrations, and from what `ask` was answered."""
        sitting, data = self.kept[user], UserData.of(user, self.folder)
        asked = self.questions(sitting.plan.itertuples(), sitting.paths)
        model = fit_on(data, np.arange(len(data.scenes)))
        assert isinstance(model, ClearanceModel)
        *posterior, _ = model.posterior().tolist()
        accepted = members(self.folder, model, sitting.plan, sitting.paths)
        kind = [self.names.index(name) for name in sitting.plan["condition"]]
        prior = from_models(dict(zip(model.families, posterior, strict=True)), asked, kind, accepted)
        rules = Rules.of(*prior, stream("own", "rules", sitting.digest, user))
        for earlier in sittings(self.folder.path).values():
            if earlier.user == user and earlier.digest == sitting.digest:
                trials = earlier.trials()
                trials = trials[trials["condition"].isin(self.names)]
                for row in trials.itertuples():
                    (said,) = rules.accept(self.questions([row], earlier.paths))
                    rules = rules.told(said, bool(row.answer))
        self.before[user], self.accepted[user] = rules, rules.accept(asked)

    def rules(self, user: str) -> Rules:
        """Return what a user's answers leave of the rules."""
        if user not in self.before:
            self.start(user)
        rules = self.before[user]
        for trial, answer in self.kept[user].answers.items():
            rules = rules.told(self.accepted[user][trial], answer)
        return rules

    def rows(self, user: str) -> list[int]:
        """Return the row whose answer tells most about the rules; none if no answer tells LEAST_BITS."""
        bits = self.rules(user).information(self.accepted[user])
        bits[list(self.kept[user].answers)] = 0
        return [int(bits.argmax())] if bits.max() >= LEAST_BITS else []

    def beside(self, user: str, row: int | None) -> dict[str, Any]:
        """Return the sentence that describes the table, which is also printed and drawn; in the end, what is known."""
        if row is None:
            print("\n".join(known := remaining(self.rules(user), self.names)), flush=True)
            return {"known": known}
        (trial,), file = self.kept[user].plan.iloc[[row]].itertuples(), self.files[user].with_suffix(".png")
        print(note := sentence(self.folder, trial), flush=True)
        canvas = picture(self.folder, trial).copy()
        points = self.folder.frame.to_model(np.array(self.kept[user].paths[trial.path]["points"]))
        pixels = ((points * [1, -1] + [0, 1]) * CANVAS_PX).round().astype(np.int32)
        file.write_bytes(png(cv2.polylines(canvas, [pixels], False, YELLOW, 3, cv2.LINE_AA)))
        return {"note": note}


def members(
    folder: Folder, model: ClearanceModel, plan: pd.DataFrame, paths: dict[str, dict[str, Any]]
) -> dict[str, Bool[Array, "row member"]]:
    """Return by family which rows of a plan each member of a model accepts."""
    accepted = np.empty((len(plan), model.margin.numel()), bool)
    for kind, rows in plan.groupby("condition"):
        lines = [folder.frame.to_model(evenly(np.array(paths[name]["points"]), PATH_SAMPLES)) for name in rows["path"]]
        with torch.no_grad():
            percept = model.see(seen_with(folder, rows, str(kind)))
            passing = passes(percept, torch.as_tensor(np.stack(lines)[:, None], dtype=torch.float32))
            accepted[rows.index] = (model.log_valid(percept, passing)[..., 0].exp() > 0.5).T.numpy()
    by_family = accepted.reshape(len(plan), len(model.families), -1)
    return {name: by_family[:, i] for i, name in enumerate(model.families)}


def sentence(folder: Folder, row: Any) -> str:
    """Return what to put where, in words: centimetres on the table, and the nearest other item."""
    frame, scene, seen = folder.frame, folder.scenes[row.scene], folder.seen.objects
    ends, radius = footprint(folder, row)
    x, y = 100 * frame.to_table(ends.mean(0))
    where = f"{x:.0f} cm from the left and {y:.0f} cm from the near edge"
    present = np.flatnonzero(seen.present[row.scene])
    if len(present):
        gaps = segment_distance(ends, seen.ends[row.scene, present].astype(float)) - radius
        gaps = (gaps - seen.radius[row.scene, present]) / frame.scale
        told = [kind for kind, _ in folder.seen.told.get(row.scene, [])]
        other = (told[gaps.argmin()] if len(told) == len(present) else "") or "item"
        where += f", {100 * gaps.min():.0f} cm beside the {other}"
    pair = f"the path passes it at {100 * row.clearance_m:.0f} cm"
    return f"On {scene}, a {row.condition} {where}; {pair} (draw {row.path.removeprefix(f'{VALID} {scene} ')})."


def remaining(rules: Rules, names: list[str]) -> list[str]:
    """Return what is known of the rules, in words: the likeliest variant, and each kind's likeliest margin."""
    variant, margins = rules.known()
    lines = [f"Items count {list(VARIANTS)[variant.argmax()]}: {variant.max():.0%} sure."]
    for name, p in zip(names, margins, strict=True):
        margin = f"keeps {p.argmax()} cm away" if p.argmax() else "does not matter"
        lines.append(f"{name}: {margin}, {p.max():.0%} sure.")
    return lines
