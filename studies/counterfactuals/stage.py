"""Stage counterfactual: which item each model blames for a rejected path, and how far it would have to move."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import check_weights, predict_all
from pipeline.causal.counterfactual import (
    DECISION,
    NOBODY,
    Removals,
    Tables,
    away,
    blame,
    crossing,
    first,
    fits,
    keep,
    move_study,
    nulls,
    removals,
    rounded,
    slide,
    study,
    unlike,
)
from pipeline.launch import launch
from pipeline.params import need
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import Margins, clearance, slack, valid

# (seed, case) each: [m], NaN if none is found; whether the path is rejected at first
LeastMoves = tuple[np.ndarray, np.ndarray]
FINE = 10  # parts of a step between two pictures in which the true least move is sought


@dataclass(frozen=True)
class World:
    """The scenes asked about, the paths in them, z_theta [m] (scene, path, 2), and every table behind the questions."""

    layouts: Layouts
    looks: pd.DataFrame
    palette: Palette
    z_theta: np.ndarray
    tables: Tables

    def picture(self, layouts: Layouts, scene: np.ndarray) -> np.ndarray:
        """These tables, each under the light and on the table top of its scene."""
        look = self.looks.iloc[scene]
        return render_scenes(layouts, list(look["texture"]), list(look["render_seed"]), self.palette)


@dataclass(frozen=True)
class Moves:
    """One user's items to blame, moved away from one path each; distance 0 is where they stand."""

    scene: np.ndarray  # (case,), likewise path and slot
    path: np.ndarray
    slot: np.ndarray
    distance: np.ndarray  # (step,) [m]
    layouts: Layouts  # (case * step)
    true_m: np.ndarray  # (case,) the least move that makes the path valid


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json, moves.parquet and examples.npz."""
    check_weights(cfg)
    users = [u for u, margins in cfg.users.items() if any(m is not None for m in margins.values())]
    world = _set_world(cfg)
    tables, z = world.tables, world.z_theta
    layouts = keep(world.layouts[tables.scene], tables.kept)
    images = world.picture(layouts, tables.scene)
    truth = {u: tables.fold(valid(layouts, z[tables.scene], cfg.users[u]).astype(float)) for u in users}
    asked = predict_all(cfg, users, images, z[tables.scene], "counterfactual")
    answers = {v: {u: tables.fold(p[i]) for i, u in enumerate(users)} for v, p in asked.items()}
    moves = {u: _set_moves(cfg, world, truth[u], cfg.users[u]) for u in users}
    found = {u: _least_moves(cfg, world, u, moves[u], {v: a[u] for v, a in answers.items()}) for u in users}
    rows = [_move_rows(cfg, v, u, moves[u], *found[u][v]) for v in cfg.variants for u in users]
    examples, arrays = _examples(cfg, world, truth, answers, images)
    cells = {v: {u: _cell(world, truth[u], a[u], moves[u], found[u][v]) for u in users} for v, a in answers.items()}
    metrics = {
        "counterfactual": {v: dict.fromkeys(cfg.users) | by_user for v, by_user in cells.items()},
        "truth": dict.fromkeys(cfg.users) | {u: _truth_cell(t) for u, t in truth.items()},
        "examples": examples,
        "scenes": len(world.layouts),
        "paths": cfg.counterfactual.paths,
        "pictures": len(images),
        "seeds": len(cfg.protocol.seeds),
    }
    write_table(out_dir / "moves.parquet", pd.concat(rows, ignore_index=True))
    write_arrays(out_dir / "examples.npz", arrays)
    write_json(out_dir / "metrics.json", metrics)


def _set_world(cfg: DictConfig) -> World:
    """Read the first scenes of the split and draw the paths in them."""
    s, scenes = cfg.counterfactual, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[cfg.counterfactual.split]
    scenes.check_has(pool)
    most = len(scenes.layouts[pool])
    need(cfg, "counterfactual.scenes", s.scenes <= most, f"at most the {most} scenes of {pool}")
    layouts = scenes.layouts[pool][: s.scenes]
    z_theta = random_z_theta(stream(s.root_seed, "counterfactual"), len(layouts), s.paths)
    palette = Palette(read_catalogue(Path(cfg.paths.data)))
    return World(layouts, scenes.appearances[pool], palette, z_theta, removals(layouts.present))


def _set_moves(cfg: DictConfig, world: World, truth: Removals, margins: Margins) -> Moves:
    """In each of the first scenes that allow it, the first invalid path that moving its one culprit makes valid.

    The item slides away from the path, along its normal. Everywhere on the way it must be where scenes may have an
    item, and before its end the path must become valid.
    """
    s, culprit = cfg.counterfactual, blame(truth.necessity)
    scene, path = np.nonzero(culprit != NOBODY)
    slot = culprit[scene, path]
    distance = s.move_step * np.arange(s.move_steps + 1)

    def slid(case: np.ndarray, by: np.ndarray) -> tuple[Layouts, np.ndarray]:
        """Every case's item moved by every distance, and the slack [m] (case, step) of its path."""
        layouts, z = world.layouts[scene[case]], world.z_theta[scene[case], path[case]]
        moved = slide(layouts, slot[case], away(layouts, slot[case], z), by)
        room = slack(moved, clearance(moved, np.repeat(z, len(by), axis=0)[:, None]), margins)
        return moved, room.reshape(len(case), len(by))

    moved, room = slid(np.arange(len(scene)), distance)
    free = fits(moved, np.repeat(slot, len(distance)), LayoutRules.of(cfg.scenes.layout)).reshape(room.shape)
    possible = np.flatnonzero(free.all(1) & (room > 0).any(1))
    case = possible[np.unique(scene[possible], return_index=True)[1]][: s.moved_scenes]
    fine = s.move_step / FINE * np.arange(FINE * s.move_steps + 1)
    true_m = crossing(fine, slid(case, fine)[1], 0.0)
    return Moves(scene[case], path[case], slot[case], distance, slid(case, distance)[0], true_m)


def _least_moves(
    cfg: DictConfig, world: World, user: str, moves: Moves, answers: dict[str, Removals]
) -> dict[str, LeastMoves]:
    """By variant, the least moves that each seed's model accepts."""
    if len(moves.scene) == 0:
        none = np.empty((len(cfg.protocol.seeds), 0))
        return dict.fromkeys(answers, (none, none.astype(bool)))
    scene = np.repeat(moves.scene, len(moves.distance))
    changed = np.arange(len(scene)) % len(moves.distance) > 0  # all but where the items stand
    images = world.picture(moves.layouts[changed], scene[changed])
    z = world.z_theta[scene, np.repeat(moves.path, len(moves.distance))][changed, None]
    asked = predict_all(cfg, [user], images, z, f"moves, {user}")
    found = {}
    for variant, p in asked.items():
        before = answers[variant].whole[:, moves.scene, moves.path, None]
        after = p[0, ..., 0].reshape(*before.shape[:2], -1)  # (seed, case, step)
        c = np.concatenate([before, after], axis=-1)
        found[variant] = crossing(moves.distance, c, DECISION), c[..., 0] <= DECISION
    return found


def _move_rows(
    cfg: DictConfig, variant: str, user: str, moves: Moves, found_m: np.ndarray, rejected: np.ndarray
) -> pd.DataFrame:
    """One row per (seed, case)."""
    seed, case = (i.ravel() for i in np.indices(found_m.shape))
    return pd.DataFrame(
        {
            "variant": variant,
            "user": user,
            "seed": np.array(cfg.protocol.seeds)[seed],
            "scene": moves.scene[case],
            "path": moves.path[case],
            "slot": moves.slot[case],
            "symbol": np.array(SYMBOLS)[moves.layouts.symbol[:: len(moves.distance)][case, moves.slot[case]]],
            "true_m": moves.true_m[case],
            "rejected": rejected.ravel(),
            "found_m": found_m.ravel(),
        }
    )


def _cell(world: World, truth: Removals, answer: Removals, moves: Moves, found: LeastMoves) -> dict | None:
    """What metrics.json says of one variant and user; None if no path is rejected by both."""
    layouts = world.layouts
    culprit, clearances = blame(truth.necessity), clearance(layouts, world.z_theta)
    chances = nulls(culprit, layouts.present, layouts.symbol, clearances)
    cell = study(answer, truth, layouts.present, chances)
    return cell and cell | {"least_move": move_study(*found, moves.true_m)}


def _truth_cell(truth: Removals) -> dict[str, float]:
    """The share of paths that are invalid, and of these the share with a single item to blame."""
    invalid, single = truth.whole == 0, blame(truth.necessity) != NOBODY
    return {"invalid": rounded(invalid.mean()), "single": rounded(single.sum() / max(invalid.sum(), 1))}


def _examples(
    cfg: DictConfig,
    world: World,
    truth: dict[str, Removals],
    answers: dict[str, dict[str, Removals]],
    images: np.ndarray,
) -> tuple[list[dict], dict[str, np.ndarray]]:
    """Worked examples, by rules fixed before any was seen, each the first path of the first scene no other one has.

    1. The first two users both reject it and disagree on whom to blame. 2. The first blames an item, the second
    accepts it. 3. A model of `example_variant` (the first seed's) rejects what is invalid and blames another than
    the culprit. Arrays: pictures of the table as it stands, empty, without each slot's item and with it alone.
    """
    rejected = np.stack([t.whole == 0 for t in truth.values()])
    culprit = np.stack([blame(t.necessity) for t in truth.values()])
    wrong = {
        u: (a.whole[0] <= DECISION) & (c != NOBODY) & (blame(a.necessity[0]) != c)
        for (u, a), c in zip(answers[cfg.counterfactual.example_variant].items(), culprit, strict=True)
    }
    rules = {"model wrong": np.any(list(wrong.values()), axis=0)}
    if len(truth) > 1:
        rules = dict(zip(("disagree", "one accepts"), unlike(rejected, culprit), strict=True)) | rules
    examples, taken = [], []
    for kind, where in rules.items():
        at = first(where, [scene for scene, _ in taken])
        if at is not None:
            taken.append(at)
            told = {u: {"truth": _told(truth[u], world, at)} for u in truth}
            for u in truth:
                told[u] |= {v: _told(_of_seed(a[u], 0), world, at) for v, a in answers.items()}
            where_wrong = {"wrong_for": [u for u, w in wrong.items() if w[at]]} if kind == "model wrong" else {}
            examples.append(_setting(world, at) | {"kind": kind, "users": told} | where_wrong)
    tables = world.tables.index[[scene for scene, _ in taken]]  # (example, question)
    slots = world.layouts.present.shape[1]
    questions = {"whole": tables[:, 0], "empty": tables[:, 1]}
    questions |= {"without": tables[:, 2 : 2 + slots], "alone": tables[:, 2 + slots :]}
    return examples, {name: images[index] for name, index in questions.items()}


def _of_seed(answer: Removals, seed: int) -> Removals:
    return Removals(answer.whole[seed], answer.empty[seed], answer.without[seed], answer.alone[seed])


def _setting(world: World, at: tuple[int, int]) -> dict:
    """Where an example happens: its scene, path and items; lengths in metres."""
    scene, path = at
    layouts = world.layouts
    room = clearance(layouts[[scene]], world.z_theta[[scene]])[0, path]
    items = [
        {
            "slot": int(slot),
            "symbol": SYMBOLS[layouts.symbol[scene, slot]],
            "x_m": rounded(layouts.centre[scene, slot, 0]),
            "y_m": rounded(layouts.centre[scene, slot, 1]),
            "clearance_m": rounded(room[slot]),
        }
        for slot in np.flatnonzero(layouts.present[scene])
    ]
    return {"scene": scene, "path": path, "z_theta": [rounded(x) for x in world.z_theta[scene, path]], "items": items}


def _told(answer: Removals, world: World, at: tuple[int, int]) -> dict:
    """P(valid) on every table of an example, PN and PS by item, and the slot blamed (None: no single item)."""
    present, blamed = world.layouts.present[at[0]], int(blame(answer.necessity)[at])
    by_item = {"p_without": answer.without, "p_alone": answer.alone, "pn": answer.necessity, "ps": answer.sufficiency}
    told = {"p": rounded(answer.whole[at]), "p_empty": rounded(answer.empty[at])}
    told |= {
        name: [rounded(x) if np.isfinite(x) else None for x in values[at][present]] for name, values in by_item.items()
    }
    return told | {"blame": None if blamed == NOBODY else blamed}


if __name__ == "__main__":
    launch(main, "counterfactual")
