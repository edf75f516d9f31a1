"""The command `ask --design`: the table and path that best separate the rules a person may follow come next."""

import json
from typing import Any

import cv2
import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.clearance.clearance import PATH_SAMPLES, ClearanceModel, passes
from pipeline.own.asked import VALID, Sitting, footprint, picture, seen_with
from pipeline.own.design import LAPSES, MARGINS_M, VARIANTS, Rules, by_family, evenly, of_members, question
from pipeline.own.fitting import UserData, fit_on
from pipeline.own.folder import Folder
from pipeline.own.frame import CANVAS_PX
from pipeline.own.recorder.asking import Asking, png
from pipeline.own.trials import accepted_paths, with_places
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.runtime.writing import atomic_write
from pipeline.world.layout import segment_distance

PLACES, FARTHEST_M = 100, 0.1  # tried for each kind, half of them near; clearance from the path, at most
LEAST_BITS = 0.05  # of expected information; below it nothing is asked
POINTS = 120  # along a path
YELLOW = (240, 228, 66)  # as the page draws paths


class Designing(Asking):
    """Sittings whose plan holds the tables to choose among; each answer decides which comes next."""

    suffix = "-design"

    def __init__(self, folder: Folder, user: str | None, minutes: float) -> None:
        super().__init__(folder, user, minutes)
        self.before: dict[str, tuple[Rules, Array]] = {}  # each user's rules before any answer, and what they accept
        self.names = sorted(folder.cutouts)

    def prepared(self, user: str) -> dict[str, Any]:
        """Return tables to choose among: a path that the user accepts, and an item at a random free place near it."""
        seed, paths = f"{self.digest}/{user}", accepted_paths(self.folder, user)
        rng, plan = stream("own", "design", seed), pd.DataFrame()
        if paths and self.names:
            number = np.repeat(np.arange(PLACES), len(self.names))  # counts the places of each kind
            plan = pd.DataFrame({"pair": number, "near": number < PLACES // 2, "repeats": -1})
            plan["condition"] = np.resize(self.names, len(plan))
            plan["path"] = rng.choice(sorted(paths), len(plan))
            plan["scene"] = [self.folder.scenes.index(paths[name]["scene"]) for name in plan["path"]]
            lines = {name: np.array(path["points"]) for name, path in paths.items()}
            plan, _ = with_places(rng, self.folder, plan, lines)
            plan = plan[plan["clearance_m"] <= FARTHEST_M]
        if plan.empty:
            raise InputError(f"there is nothing to ask {user}: add cut-outs, and paths that {user} calls valid")
        trials = json.loads(plan.to_json(orient="records", double_precision=6))
        common = {"user": user, "digest": self.digest, "seed": seed, "share_near": {}}
        return common | {"lapses": LAPSES, "paths": paths, "trials": trials}

    def questions(self, sitting: Sitting) -> Float[Array, "row variant kind"]:
        """Return what the rows of a plan ask (`design.question`), in metres on the table."""
        frame, seen, made = self.folder.frame, self.folder.seen.objects, []
        for row in sitting.plan.itertuples():
            present = seen.present[row.scene]
            ends, radius = footprint(self.folder, row)
            ends = frame.to_table(np.concatenate([seen.ends[row.scene, present], ends[None]]))
            radii = np.append(seen.radius[row.scene, present], radius) / frame.scale
            kind = np.append(np.full(present.sum(), -1), self.names.index(row.condition))
            path = evenly(np.array(sitting.paths[row.path]["points"], float), POINTS)
            made.append(question(path, ends, radii, kind, len(self.names)))
        return np.stack(made)

    def start(self, user: str) -> tuple[Rules, Array]:
        """Return a user's rules by a model fitted to all demonstrations, and which rows of the plan each accepts."""
        sitting, data = self.kept[user], UserData.of(user, self.folder)
        model = fit_on(data, np.arange(len(data.scenes)))
        assert isinstance(model, ClearanceModel)
        margins = np.full((len(self.names), len(MARGINS_M)), 1 / len(MARGINS_M))
        for kind, rows in sitting.plan.groupby("condition"):
            paths = [evenly(np.array(sitting.paths[name]["points"]), PATH_SAMPLES) for name in rows["path"]]
            lines = torch.as_tensor(self.folder.frame.to_model(np.stack(paths))[:, None], dtype=torch.float32)
            with torch.no_grad():
                percept = model.see(seen_with(self.folder, rows, str(kind)))
                p = model.log_valid(percept, passes(percept, lines))[..., 0].exp()  # (member, row)
            accepted = (p > 0.5).T.numpy()
            margins[self.names.index(str(kind))] = of_members(rows["clearance_m"].to_numpy(float), accepted)
        families = dict(zip(model.families, model.posterior().tolist(), strict=False))  # the last one is the constant
        rules = Rules.of(by_family(families), margins, stream("own", "rules", sitting.digest, user))
        return rules, rules.accept(self.questions(sitting))

    def rules(self, user: str) -> Rules:
        """Return what a user's answers leave of the rules."""
        if user not in self.before:
            self.before[user] = self.start(user)
        rules, accepted = self.before[user]
        for trial, answer in self.kept[user].answers.items():
            rules = rules.told(accepted[trial], answer)
        return rules

    def rows(self, user: str) -> list[int]:
        """Return the row whose answer tells most about the rules; none if no answer tells LEAST_BITS."""
        bits = self.rules(user).information(self.before[user][1])
        bits[list(self.kept[user].answers)] = 0
        return [int(bits.argmax())] if bits.max() >= LEAST_BITS else []

    def beside(self, user: str, row: int | None) -> dict[str, Any]:
        """Return the sentence that describes the table, which is also printed and drawn; in the end, what is known."""
        if row is None:
            variant, margins = self.rules(user).known()
            known = [f"Items count {list(VARIANTS)[variant.argmax()]}: {sure(variant.max())}."]
            for name, p in zip(self.names, margins, strict=True):
                margin = f"keeps {100 * MARGINS_M[p.argmax()]:.0f} cm away" if p.argmax() else "does not matter"
                known.append(f"{name}: {margin}, {sure(p.max())}.")
            print("\n".join(known), flush=True)
            return {"known": known}
        (trial,), file = self.kept[user].plan.iloc[[row]].itertuples(), self.files[user].with_suffix(".png")
        scene, away = self.folder.scenes[trial.scene], f"{100 * trial.clearance_m:.0f} cm"
        path = f"the path of demonstration {trial.path.removeprefix(f'{VALID} {scene} ')}"
        print(note := f"On {scene}, a {placed(self.folder, trial)}; {path} passes it at {away}.", flush=True)
        canvas = picture(self.folder, trial).copy()
        points = self.folder.frame.to_model(np.array(self.kept[user].paths[trial.path]["points"]))
        pixels = ((points * [1, -1] + [0, 1]) * CANVAS_PX).round().astype(np.int32)
        drawn = png(cv2.polylines(canvas, [pixels], False, YELLOW, 3, cv2.LINE_AA))
        atomic_write(file, lambda part: part.write_bytes(drawn))
        return {"note": note}


def placed(folder: Folder, row: Any) -> str:
    """Return the kind and place of an added item, in words: centimetres on the table, and the nearest other item."""
    frame, seen = folder.frame, folder.seen.objects
    ends, radius = footprint(folder, row)
    x, y = 100 * frame.to_table(ends.mean(0))
    words = f"{row.condition} {x:.0f} cm from the left and {y:.0f} cm from the near edge"
    present = np.flatnonzero(seen.present[row.scene])
    if len(present):
        gaps = segment_distance(ends, seen.ends[row.scene, present].astype(float)) - radius
        gaps = (gaps - seen.radius[row.scene, present]) / frame.scale
        told = [kind for kind, _ in folder.seen.told.get(row.scene, [])]
        other = (told[gaps.argmin()] if len(told) == len(present) else "") or "item"
        words += f", {100 * gaps.min():.0f} cm from the nearest {other}"
    return words


def sure(p: float) -> str:
    """Return a probability in words; never certainty, which no answers give."""
    return f"{p:.0%} sure" if p < 0.995 else "more than 99% sure"
