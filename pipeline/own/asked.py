"""Plan what `ask` shows a person of their own pictures, read their answers, and compare them with their model's.

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
from pipeline.causal.experiment import EXTRA, LOOKS, NEAR_M, STICKER, UNCHANGED, answered
from pipeline.own import files, kinds
from pipeline.own.demonstrations import read_samples
from pipeline.own.files import CUTOUTS, KEY, KINDS, SCENES, SETTINGS, Faults
from pipeline.own.fitting import Fitted
from pipeline.own.folder import Folder
from pipeline.own.frame import outline
from pipeline.perception.objects import Objects
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import bezier
from pipeline.world.layout import segment_distance
from pipeline.world.rules import line_clearance

ASKED, ANSWERS = "asked", ["trial", "valid", "response_ms"]  # folder; columns of a sitting's csv
WORDS = {"true": True, "false": False}  # a spreadsheet may write others
REAL = "-real"  # behind the number of a sitting: answers to its trials about real items, and their photographs
POINTS = 60  # of a path that is shown
STICKER_M, STICKER_PX, STICKER_RGBA = 0.07, 96, (236, 214, 96, 255)  # a flat round sticker: diameter, and picture
QUARTERS = 4  # of NEAR_M over which near places are spread evenly
MOST_PLACES = 200  # free places that are tried for one trial
REPAIRS = 6  # invalid demonstrations whose repair, detour and original are judged
DETOURS = 256  # random paths of which the detour keeps farthest from everything
WIDE_M = 0.3  # how far they bend, as kinds.SPREAD_M
REPAIR, ORIGINAL, DETOUR, VALID = "repair", "unrepaired", "detour", "valid"
QUESTIONS = [
    "Local effect: does an item whose edge is within 4 cm of a path that the person accepts change the answer?",
    "Average effect: does an item at a random free place beside the path change it?",
    "How often do the person and the model agree, and the person with themself?",
    "Which repaired paths does the person accept?",
]
Path2 = Float[Array, "point 2"]  # [m on the table]


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

    def trials(self) -> pd.DataFrame:
        """Return the answered rows of the plan."""
        return answered(self.plan, self.answers)


def real_trials(sitting: Sitting) -> pd.DataFrame:
    """Return the answered trials with an item near the path, which `ask --real` asks again; no repeats."""
    trials = sitting.trials()
    kinds_only = ~trials["condition"].isin([UNCHANGED, STICKER, EXTRA])
    return trials[kinds_only & trials["near"].astype(bool) & (trials["repeats"] < 0)]


def digest(path: Path) -> str:
    """Return a digest of what trials are made of: pictures, corners and cut-outs, no file that a system adds."""
    cutouts = [file for kind in sorted(path.glob(f"{KINDS}/[!.]*/")) for file in files.listed(kind, ".png")]
    used = [path / SETTINGS, path / CUTOUTS, *files.listed(path / SCENES, *files.ENDINGS), *cutouts]
    parts = [f"{file.relative_to(path)}".encode() + file.read_bytes() for file in used if file.is_file()]
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]


def sittings(path: Path, suffix: str = "") -> dict[Path, Sitting]:
    """Return all sittings of a folder by file, in the order of their numbers; suffix: of the files' stems."""
    return {file: Sitting.read(file) for file in sorted((path / ASKED).glob(f"[0-9][0-9][0-9]{suffix}.json"))}


def prepare(folder: Folder, user: str, seed: str) -> dict[str, Any]:
    """Return a sitting to write: its questions, rule, paths and trials. Raise InputError if nothing can be asked."""
    rng, paths = stream("own", "ask", seed), accepted_paths(folder, user)
    if not paths:
        raise InputError(f"{user} has no valid demonstration: record some first (python -m pipeline.own record)")
    scenes = sorted({path["scene"] for path in paths.values()})
    by_scene = [rng.permutation([n for n, path in paths.items() if path["scene"] == s]).tolist() for s in scenes]
    rounds = [rng.permutation(len(scenes)) for _ in range(-(-LOOKS[-1] // len(scenes)))]
    pairs = np.concatenate(rounds)[: LOOKS[-1]]
    shown = [by_scene[s][i // len(scenes) % len(by_scene[s])] for i, s in enumerate(pairs)]
    extras = repairs(folder, user, rng)
    names = [kind for kind in sorted(folder.cutouts) if kind not in (UNCHANGED, STICKER, EXTRA)]
    index = [folder.scenes.index(scenes[s]) for s in pairs]
    plan = experiment.design(rng, names, np.array(index), [folder.scenes.index(e["scene"]) for e in extras.values()])
    plan["path"] = [shown[p] if p >= 0 else list(extras)[e] for p, e in zip(plan["pair"], plan["extra"], strict=True)]
    paths |= extras
    plan, share_near = with_places(rng, folder, plan, {name: np.array(path["points"]) for name, path in paths.items()})
    asked = set(plan["condition"]) - {UNCHANGED, STICKER}
    if not asked:
        raise InputError(f"there is nothing to ask {user}: add cut-outs to {KINDS}/ that have room beside valid paths")
    return {
        "user": user,
        "digest": digest(folder.path),
        "seed": seed,
        "questions": QUESTIONS,
        "rule": {
            "looks_after_pairs": LOOKS,
            "level_of_effects": experiment.SPENT,
            "level_of_equivalence": experiment.EQUIVALENCE_LEVEL,
            "smallest_local_effect": experiment.SMALLEST_LOCAL_EFFECT,
            "near_m": NEAR_M,
            "stops": "a kind is asked until its verdict is effect or negligible",
        },
        "no_room_for": sorted(set(names) - asked),
        "share_near": share_near,
        "paths": {name: paths[name] for name in sorted(set(plan["path"]))},
        "trials": json.loads(plan.to_json(orient="records", double_precision=6)),
    }


def accepted_paths(folder: Folder, user: str) -> dict[str, dict[str, Any]]:
    """Return the demonstrations that a user called valid, as drawn: scene, role and points [m on the table] by name."""
    samples = read_samples(folder.path, folder.scenes, files.read_settings(folder.path), Faults())
    assert samples is not None  # the folder was read without a fault
    rows = samples[(samples["user"] == user) & samples["valid"]]
    return {
        f"{VALID} {scene} {demo}": {"scene": scene, "role": VALID, "points": thinned(part[["x", "y"]].to_numpy(float))}
        for (scene, _, demo), part in rows.groupby(KEY, sort=True)
    }


def thinned(points: Path2) -> list[list[float]]:
    """Return a path's points, at most POINTS, with its ends."""
    index = np.unique(np.linspace(0, len(points) - 1, POINTS).round().astype(int))
    return points[index].round(4).tolist()


def repairs(folder: Folder, user: str, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return repairs of the last report with their originals, and a wide detour in the same scene; none without one."""
    file = folder.path / "report" / "tables" / "repaired.parquet"
    if not file.is_file():
        return {}
    table, points = pd.read_parquet(file).dropna(), pd.read_parquet(file.with_name("repaired_paths.parquet"))
    table = table[(table["user"] == user) & table["scene"].isin(folder.scenes) & (table["moved_m"] > 0)]
    table = table.sample(frac=1, random_state=int(rng.integers(2**31))).sort_values("scene", kind="stable")
    turn = table.groupby("scene").cumcount()
    made: dict[str, dict[str, Any]] = {}
    for row in table.loc[turn.sort_values(kind="stable").index].head(REPAIRS).itertuples():
        demos, key = folder.demos, {"user": user, "scene": row.scene, "demo": row.demo}
        controls = folder.controls(demos[(demos[KEY] == pd.Series(key)[KEY]).all(axis=1)])
        end = points[(points[KEY] == pd.Series(key)[KEY]).all(axis=1)]
        if not len(controls) or not len(end):
            continue  # of a report on an earlier state of the folder
        lines = {ORIGINAL: folder.frame.to_table(bezier(controls[0], POINTS)), REPAIR: end[["x", "y"]].to_numpy()}
        lines[DETOUR] = detour(folder, folder.scenes.index(row.scene), controls[0], rng)
        for role, line in lines.items():
            made[f"{role} {row.scene} {row.demo}"] = {"scene": row.scene, "role": role, "points": thinned(line)}
    return made


def detour(folder: Folder, scene: int, controls: Float[Array, "control 2"], rng: np.random.Generator) -> Path2:
    """Return the path between these ends [m of the model], on the table, that keeps farthest from what is seen."""
    bent = kinds.bent(rng, np.repeat(controls[None], DETOURS, axis=0), WIDE_M)
    lines = folder.frame.to_table(bezier(bent, POINTS))
    inside = ((lines > 0) & (lines < folder.frame.size_m)).all((1, 2))
    lines = lines[inside] if inside.any() else lines
    seen = folder.seen.objects[[scene]]
    away = line_clearance(kinds.capsules(seen.ends, seen.radius, seen.present), folder.frame.to_model(lines)[None])
    return lines[away[0].min(-1).argmax()]


def sticker() -> UInt8[Array, "row column 4"]:
    """Return the cut-out of a flat, round sticker."""
    rows, columns = np.mgrid[:STICKER_PX, :STICKER_PX] - (STICKER_PX - 1) / 2
    inside = np.hypot(rows, columns) < STICKER_PX / 2 - 1
    return np.where(inside[..., None], np.array(STICKER_RGBA), 0).astype(np.uint8)


def with_places(
    rng: np.random.Generator, folder: Folder, plan: pd.DataFrame, paths: Mapping[str, Path2]
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return a plan with a place for each added item, and for each kind the share of free places that are near.

    Trials whose item finds no place are left out. Places are random free ones beside the path. Near ones are spread
    evenly over QUARTERS of NEAR_M where there is room. A repeat has the place of its original.
    """
    cutouts = {**folder.cutouts, STICKER: [(sticker(), STICKER_M)]}
    capsules = {name: [kinds.footprint(*cutout) for cutout in several] for name, several in cutouts.items()}
    path_ends = kinds.ends_of_paths(folder)
    objects, counts = folder.seen.objects, {name: np.zeros(2) for name in folder.cutouts}
    places: list[tuple] = []
    for row in plan.itertuples():
        if row.repeats >= 0 or row.condition not in capsules:
            places.append(places[row.repeats] if row.repeats >= 0 else (-1, np.nan, np.nan, np.nan, np.nan))
            continue
        which = row.pair % len(capsules[row.condition])
        capsule, line = capsules[row.condition][which], folder.frame.to_model(paths[row.path])
        pieces, free = np.stack([line[:-1], line[1:]], axis=1), path_ends[folder.scenes[row.scene]]
        quarter = (row.pair + sorted(capsules).index(row.condition)) % QUARTERS
        best: tuple = ()
        for _ in range(MOST_PLACES):
            place = kinds.free_place(rng, folder.frame, objects, row.scene, capsule, free)
            if place is None:
                break
            ends = kinds.ends_of(folder.frame, capsule, *place)
            clearance = float(segment_distance(pieces, ends).min()) / folder.frame.scale - capsule.radius
            if clearance < 0:
                continue
            near = clearance <= NEAR_M
            if row.condition in counts:
                counts[row.condition] += [near, 1]
            if near == row.near:
                best = (which, *map(float, place[0]), place[1], clearance)
                if not near or min(int(clearance / NEAR_M * QUARTERS), QUARTERS - 1) == quarter:
                    break
        places.append(best)
    plan[["cutout", "x", "y", "angle", "clearance_m"]] = [place or (-2, *[np.nan] * 4) for place in places]
    kept = plan["cutout"] > -2
    number = kept.cumsum() - 1
    plan["repeats"] = [int(number[r]) if r >= 0 else -1 for r in plan["repeats"]]
    plan = plan[kept].reset_index(drop=True).astype({"cutout": int})
    shown = set(plan["condition"])
    return plan, {n: float(near / total) for n, (near, total) in counts.items() if total and n in shown}


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
        seen: Objects = folder.seen.objects[rows["scene"].tolist()]
        if condition not in (UNCHANGED, EXTRA):
            seen = seen_with(folder, rows, str(condition))
        for i, (row, scene) in enumerate(zip(rows["position"], rows["scene"], strict=True)):
            name = folder.scenes[scene]
            known = name in fitted.data.scenes
            model = fitted.unseeing(fitted.data.scenes.index(name)) if known else fitted.model
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
    `You` and `Your model`. asked_average, asked_distances and asked_agreement: as `experiment` gives them.
    asked_repairs: the share accepted by role of the path. asked_real: how often a composited item got the same answer
    as the real one, by kind.
    """
    parts = dict[str, list[pd.DataFrame]]()
    for sitting, second in answers:
        trials = sitting.trials()
        p = model_answers(folder, fitted[sitting.user], sitting, trials)
        effects = experiment.local_verdicts(sitting.plan, sitting.answers)
        effects["model_effect"] = [_model_effect(trials.assign(p=p), kind) for kind in effects["kind"]]
        effects["varied"] = len(set(sitting.answers.values())) > 1
        ends = effects["effect"], effects["ci_low"], effects["ci_high"]
        both = {"You": ends, "Your model": (effects["model_effect"],) * 3}
        compared = [
            pd.DataFrame({"kind": effects["kind"], "who": who, "effect": e, "ci_low": low, "ci_high": high})
            for who, (e, low, high) in both.items()
        ]
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


def _model_effect(trials: pd.DataFrame, kind: str) -> float:
    """Return the model's mean change of P(valid) in the pairs of a kind; NaN without one."""
    first = trials[(trials["repeats"] < 0) & trials["near"]]
    p = {c: first[first["condition"] == c].set_index("pair")["p"] for c in (UNCHANGED, kind)}
    return float((p[kind] - p[UNCHANGED]).mean())
