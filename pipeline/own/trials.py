"""Plan what `ask` shows a person of their own pictures: pairs with and without an item, repairs, and their order."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.artifacts.files import read_json
from pipeline.causal import experiment
from pipeline.causal.experiment import LOOKS, NEAR_M, STICKER, UNCHANGED
from pipeline.own import kinds
from pipeline.own.asked import DETOUR, ORIGINAL, REPAIR, STICKER_M, VALID, digest, sticker
from pipeline.own.files import DEMONSTRATIONS, KEY, KINDS
from pipeline.own.fitting import REPAIRED_POINTS as POINTS
from pipeline.own.folder import Folder
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.world.bezier import bezier
from pipeline.world.layout import segment_distance
from pipeline.world.rules import line_clearance

QUARTERS = 4  # of NEAR_M over which near places are spread evenly
MOST_PLACES = 200  # free places that are tried for one trial
REPAIRS = 6  # invalid demonstrations whose repair, detour and original are judged
DETOURS = 256  # random paths of which the detour keeps farthest from everything
WIDE_M = 0.3  # how far they bend, as kinds.SPREAD_M
QUESTIONS = [
    "Local effect: does an item whose edge is within 4 cm of a path that the person accepts change the answer?",
    "Average effect: does an item at a random free place beside the path change it?",
    "How often do the person and the model agree, and the person with themself?",
    "Which repaired paths does the person accept?",
]
Path2 = Float[Array, "point 2"]  # [m on the table]


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
    index = [folder.scenes.index(scenes[s]) for s in pairs]
    scenes_of_extras = [folder.scenes.index(extra["scene"]) for extra in extras.values()]
    plan = experiment.design(rng, sorted(folder.cutouts), np.array(index), scenes_of_extras)
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
        "no_room_for": sorted(folder.cutouts.keys() - asked),
        "share_near": share_near,
        "paths": {name: paths[name] for name in sorted(set(plan["path"]))},
        "trials": json.loads(plan.to_json(orient="records", double_precision=6)),
    }


def accepted_paths(folder: Folder, user: str) -> dict[str, dict[str, Any]]:
    """Return a user's valid demonstrations by name: scene, role and points of a curve as smooth as repairs [m]."""
    rows = folder.demos[(folder.demos["user"] == user) & folder.demos["valid"]]
    lines = folder.frame.to_table(bezier(folder.controls(rows), POINTS))
    return {
        f"{VALID} {row.scene} {row.demo}": {"scene": row.scene, "role": VALID, "points": line.round(4).tolist()}
        for row, line in zip(rows.itertuples(), lines, strict=True)
    }


def has_report(path: Path) -> bool:
    """Return whether a folder's report is about the pictures, cut-outs and demonstrations that are there now."""
    file = path / "report" / "metrics.json"
    return file.is_file() and read_json(file).get("state") == digest(path, DEMONSTRATIONS)


def repairs(folder: Folder, user: str, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return repairs of the last report with their originals, and wide detours in the same scenes; {} without one."""
    if not has_report(folder.path):
        return {}
    file = folder.path / "report" / "tables" / "repaired.parquet"
    table, points = pd.read_parquet(file).dropna(), pd.read_parquet(file.with_name("repaired_paths.parquet"))
    table = table[(table["user"] == user) & (table["moved_m"] > 0)]
    table = table.sample(frac=1, random_state=int(rng.integers(2**31))).sort_values("scene", kind="stable")
    turn = table.groupby("scene").cumcount()
    made: dict[str, dict[str, Any]] = {}
    for row in table.loc[turn.sort_values(kind="stable").index].head(REPAIRS).itertuples():
        key = pd.Series({"user": user, "scene": row.scene, "demo": row.demo})[KEY]
        demo, end = (table[(table[KEY] == key).all(axis=1)] for table in (folder.demos, points))
        controls = folder.controls(demo)
        lines = {ORIGINAL: folder.frame.to_table(bezier(controls[0], POINTS)), REPAIR: end[["x", "y"]].to_numpy()}
        lines[DETOUR] = detour(folder, folder.scenes.index(row.scene), controls[0], rng)
        for role, line in lines.items():
            path = {"scene": row.scene, "role": role, "points": line.round(4).tolist()}
            made[f"{role} {row.scene} {row.demo}"] = path
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
