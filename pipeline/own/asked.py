"""Read what `ask` asked a person about their own pictures and what they answered, and compare it with their model.

A sitting is two files in FOLDER/asked/: NUMBER.json, written before the first trial, holds the questions, the rule of
stopping and every trial in its order; NUMBER.csv a row for each answer.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from pipeline.causal import experiment
from pipeline.causal.experiment import EXTRA, STICKER, UNCHANGED, answered
from pipeline.own import files, kinds
from pipeline.own.files import CUTOUTS, KINDS, SCENES, SETTINGS
from pipeline.own.fitting import Fitted
from pipeline.own.folder import Folder
from pipeline.own.frame import outline
from pipeline.perception.objects import Objects
from pipeline.runtime.errors import InputError
from pipeline.stats.scores import DECISION

ASKED, ANSWERS = "asked", ["trial", "valid", "response_ms"]  # folder; columns of a sitting's csv
WORDS = {"true": True, "false": False}  # a spreadsheet may write others
REAL = "-real"  # behind the number of a sitting: answers to its trials about real items, and their photographs
STICKER_M, STICKER_PX, STICKER_RGBA = 0.07, 96, (236, 214, 96, 255)  # a flat round sticker: diameter, and picture
REPAIR, ORIGINAL, DETOUR, VALID = "repair", "unrepaired", "detour", "valid"


@dataclass(frozen=True)
class Sitting:
    """Hold what one person was asked about one state of a folder, and the answers by row of the plan, in order."""

    user: str
    digest: str  # of the folder's pictures and cut-outs
    plan: pd.DataFrame  # as `experiment.design`, with path, cutout, x, y [m], angle [rad] and clearance_m
    paths: dict[str, dict[str, Any]]  # by name: scene, role and points [m on the table]
    share_near: dict[str, float]  # share of free places beside the path that is near, by kind
    answers: dict[int, bool]
    response_ms: list[float]

    @classmethod
    def read(cls, path: Path, rows: Path | None = None) -> "Sitting":
        """Return the sitting of a json file and a csv, the one beside it. Raise InputError if they are no sitting."""
        rows = rows or path.with_suffix(".csv")
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            table = pd.read_csv(rows) if rows.is_file() else pd.DataFrame(columns=ANSWERS)
            plan = pd.DataFrame(content["trials"])
            for word in table["valid"]:
                if str(word).lower() not in WORDS:
                    raise ValueError(f"valid is {word!r}: expected True or False")
            valid = [WORDS[str(word).lower()] for word in table["valid"]]
            answers = dict(zip(table["trial"].astype(int).tolist(), valid, strict=True))
            if len(answers) < len(table) or not answers.keys() <= set(plan.index):
                raise ValueError("a trial has two answers, or is not of this sitting")
            times = table["response_ms"].astype(float).tolist()
            user, state = content["user"], content["digest"]
            return cls(user, state, plan, content["paths"], content["share_near"], answers, times)
        except (ValueError, KeyError, TypeError, OSError) as error:
            what = f"{path.name} or {rows.name} in {ASKED}/ cannot be read ({error!r})"
            raise InputError(f"{what}: restore them, or move both away") from error


def real_trials(sitting: Sitting) -> pd.DataFrame:
    """Return the answered trials with an item near the path, which `ask --real` asks again; no repeats."""
    trials = answered(sitting.plan, sitting.answers)
    kinds_only = ~trials["condition"].isin([UNCHANGED, STICKER, EXTRA])
    return trials[kinds_only & trials["near"].astype(bool) & (trials["repeats"] < 0)]


def digest(path: Path, *others: str) -> str:
    """Return a digest of what trials are made of, pictures, corners and cut-outs, and of other files of the folder."""
    cutouts = [file for kind in sorted(path.glob(f"{KINDS}/[!.]*/")) for file in files.listed(kind, ".png")]
    named = (path / name for name in (SETTINGS, CUTOUTS, *others))
    used = [*named, *files.listed(path / SCENES, *files.ENDINGS), *cutouts]
    parts = [f"{file.relative_to(path)}".encode() + file.read_bytes() for file in used if file.is_file()]
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]


def sittings(path: Path, suffix: str = "") -> dict[Path, Sitting]:
    """Return all sittings of a folder by file, in the order of their numbers; suffix: of the files' stems."""
    return {file: Sitting.read(file) for file in sorted((path / ASKED).glob(f"[0-9][0-9][0-9]{suffix}.json"))}


def sticker() -> UInt8[Array, "row column 4"]:
    """Return the cut-out of a flat, round sticker."""
    rows, columns = np.mgrid[:STICKER_PX, :STICKER_PX] - (STICKER_PX - 1) / 2
    inside = np.hypot(rows, columns) < STICKER_PX / 2 - 1
    return np.where(inside[..., None], np.array(STICKER_RGBA), 0).astype(np.uint8)


def picture(folder: Folder, row: Any) -> UInt8[Array, "side side 3"]:
    """Return the rectified table of a row of the plan, with its item if it has one."""
    canvas, side = folder.canvases[folder.scenes[row.scene]], max(folder.frame.size_m)
    if row.cutout < 0:
        return canvas
    cutout, width = cutout_of(folder, row)
    return kinds.paste(canvas, cutout, width / side, np.array([row.x, row.y]) / side, row.angle)


def cutout_of(folder: Folder, row: Any) -> tuple[UInt8[Array, "row column 4"], float]:
    """Return the cut-out of a row's item and the width of its picture [m]."""
    return (sticker(), STICKER_M) if row.condition == STICKER else folder.cutouts[row.condition][row.cutout]


def model_answers(folder: Folder, fitted: Fitted, sitting: Sitting, plan: pd.DataFrame) -> Float[Array, " trial"]:
    """Return P(valid) of rows of a plan by models that were not fitted to their scenes."""
    lines = [folder.frame.to_model(np.array(sitting.paths[name]["points"])) for name in plan["path"]]
    p = np.zeros(len(plan))
    for condition, rows in plan.assign(position=range(len(plan))).groupby("condition"):
        bare = condition in (UNCHANGED, EXTRA)
        seen = folder.seen.objects[rows["scene"].tolist()] if bare else seen_with(folder, rows, str(condition))
        for i, (row, scene) in enumerate(zip(rows["position"], rows["scene"], strict=True)):
            model = fitted.unseeing(folder.scenes[scene])
            p[row] = model.probability(seen[[i]], lines[row][None, None])[0, 0]
    return p


def seen_with(folder: Folder, rows: pd.DataFrame, condition: str) -> Objects:
    """Return what models see in rows of a plan with the item of one condition."""
    images = [folder.frame.image(picture(folder, row)) for row in rows.itertuples()]
    rings = [outline(*footprint(folder, row)) for row in rows.itertuples()]
    return folder.seen.with_items(rows["scene"].tolist(), images, rings, condition)


def footprint(folder: Folder, row: Any) -> tuple[Float[Array, "2 2"], np.float64]:
    """Return the ends and the radius [m of the model] of a row's added item."""
    capsule = kinds.footprint(*cutout_of(folder, row))
    ends = kinds.ends_of(folder.frame, capsule, np.array([row.x, row.y]), row.angle)
    return ends, np.float64(folder.frame.scale * capsule.radius)


class Given(NamedTuple):
    """Hold the sittings with answers about the folder as it is, each with the answers about real items."""

    kept: list[tuple[Sitting, dict[int, bool]]]
    apart: int  # others with answers: pictures or cut-outs have changed since, or the user has no demonstration now


def given(folder: Folder) -> Given:
    """Return what people answered; raise InputError for files that cannot be read."""
    judged = {file: sitting for file, sitting in sittings(folder.path).items() if sitting.answers}
    now, kept = digest(folder.path), list[tuple[Sitting, dict[int, bool]]]()
    for file, sitting in judged.items():
        if sitting.digest == now and sitting.user in folder.users:
            kept.append((sitting, Sitting.read(file, file.with_name(f"{file.stem}{REAL}.csv")).answers))
    return Given(kept, len(judged) - len(kept))


def tables(
    folder: Folder, fitted: Mapping[str, Fitted], answers: Sequence[tuple[Sitting, dict[int, bool]]]
) -> dict[str, pd.DataFrame]:
    """Return what people answered (`given`) beside what their models say; {} for nothing.

    All tables are by user. asked_effects: `experiment.local_verdicts` with model_effect, the mean change of P(valid) in
    the same pairs, and varied, whether the person gave both answers. asked_compared: effect, low and high by kind, of
    `You`, with the verdict, and `Your model`. asked_average, asked_distances and asked_agreement: as `experiment` gives
    them. asked_repairs: the share accepted by role of the path. asked_real: how often a composited item got the same
    answer as the real one, by kind.
    """
    parts = dict[str, list[pd.DataFrame]]()
    for sitting, second in answers:
        trials = answered(sitting.plan, sitting.answers)
        p = model_answers(folder, fitted[sitting.user], sitting, trials)
        effects = experiment.local_verdicts(sitting.plan, sitting.answers)
        first = trials.assign(p=p)[(trials["repeats"] < 0) & trials["near"] & (trials["pair"] >= 0)]
        by_pair = first.pivot(index="pair", columns="condition", values="p").reindex(columns=[UNCHANGED, *effects.kind])
        effects["model_effect"] = by_pair[effects["kind"]].sub(by_pair[UNCHANGED], axis=0).mean().to_numpy()
        effects["varied"] = len(set(sitting.answers.values())) > 1
        you = effects[["kind", "effect", "ci_low", "ci_high", "verdict"]].assign(who="You")
        model = effects["model_effect"]
        compared = you, you.assign(who="Your model", effect=model, ci_low=model, ci_high=model, verdict="")
        roles = trials.assign(role=[sitting.paths[name]["role"] for name in trials["path"]])
        roles = roles[(roles["repeats"] < 0) & roles["condition"].isin([UNCHANGED, EXTRA])]
        roles = roles.sort_values("role", key=lambda names: names.map([VALID, ORIGINAL, REPAIR, DETOUR].index))
        made = {
            "effects": effects,
            "compared": pd.concat(compared).dropna(),
            "average": experiment.average_effects(sitting.plan, sitting.answers, sitting.share_near),
            "distances": experiment.by_distance(trials),
            "agreement": experiment.agreement(trials, p > DECISION),
            "repairs": experiment.accepted_shares(roles, ["role"]),
        }
        composited = real_trials(sitting)
        again = composited[composited.index.isin(list(second))]
        if len(again):
            same = again.assign(kind=again["condition"], answer=again["answer"] == [second[i] for i in again.index])
            made["real"] = experiment.accepted_shares(same, ["kind"])
        for name, table in made.items():
            parts.setdefault(f"asked_{name}", []).append(table.assign(user=sitting.user))
    return {name: pd.concat(several, ignore_index=True) for name, several in parts.items()}
