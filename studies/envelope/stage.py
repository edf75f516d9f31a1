"""Stage envelope: how far from each symbol validity flips, by every model, beside the true margins and put to use."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from omegaconf import DictConfig

from pipeline.artifacts.files import write_json
from pipeline.artifacts.interventions import AddedItems, read_interventions
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, predict_all
from pipeline.causal.envelope import dose_grid, nearest_plans, paths_at_doses, planning, study
from pipeline.causal.interventions import by_user
from pipeline.launch import launch
from pipeline.planning.oracle import nearest_valid
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.runtime.writing import atomic_write
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

BLOCK = 512  # paths
HEADER = """\
# Safety envelopes learned from labelled demonstrations by the model `{variant}`: user -> symbol. Lengths in metres.
# keep_clear_m: least distance a path of this user should keep from the item's outline, the interval's upper end;
#   null: no effect of the item on this user's paths was found, or, where the verdict is inconclusive, it was left
#   open: that is no leave to touch it. Plans that keep the distances and no more are not all valid, by the simulator's
#   truth in the scenes these distances are of; a robot elsewhere wants a margin on top:
{plans}
# radius_m, ci_low_m, ci_high_m: clearance at which half of the item's effect is gone, and its 95 % interval.
# drop_at_contact: what touching the item takes from the chance that a path which is clear of the others is valid.
# verdict: whether that is an effect; an envelope is drawn around no other. Inconclusive: more must be shown to tell.
"""


@dataclass(frozen=True)
class Tables:
    """The scenes as they are and with each symbol added, and random paths in them; images are uint8."""

    images: np.ndarray  # (scene, 100, 100, 3)
    layouts: Layouts
    added: AddedItems
    z_theta: np.ndarray  # (scene, candidate, 2) [m]
    clearances: np.ndarray  # (scene, candidate, slot) [m] from the scenes' own items
    to_added: np.ndarray  # (symbol, scene, candidate) [m]
    trained: tuple[int, ...]  # by symbol: items that the training scenes hold, whatever the seed


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json and specification.yaml."""
    check_weights(cfg)
    tables = _set_tables(cfg)
    grid, chosen = _choose_paths(cfg, tables)
    truth = _true_drops(cfg, tables, chosen)
    drops = _model_drops(cfg, tables, chosen)
    margins = [cfg.users[user][symbol] for user in cfg.users for symbol in SYMBOLS]
    true_drop = truth[:, 0].reshape(-1, *truth.shape[-2:])  # (user * symbol, scene, dose)
    item = np.tile(tables.added.item, (len(cfg.users), 1))  # (user * symbol, scene)
    trained, never = tables.trained * len(cfg.users), (None,) * len(margins)
    studies = {v: study(_cells(d), true_drop, item, trained, margins, grid) for v, d in drops.items()}
    studies["truth"] = study(_cells(truth), true_drop, item, never, margins, grid)
    envelopes = {v: by_user(list(cfg.users), cells) for v, (cells, _) in studies.items()}
    oracle, planner = envelopes.pop("truth"), cfg.envelope.planner
    nearest = _plan_nearest(cfg, tables, _keep_clear(envelopes[planner]))
    write_json(
        out_dir / "metrics.json",
        {
            "oracle": oracle,
            "envelope": envelopes,
            "curves": {v: by_user(list(cfg.users), studies[v][1]) for v in envelopes},
            "planning": {v: _plan(cfg, tables, _keep_clear(e)) for v, e in envelopes.items()},
            "planning_flips": {v: _plan(cfg, tables, _keep_clear(e, flips=True)) for v, e in envelopes.items()},
            "planning_nulls": {
                "no_envelope": _plan(cfg, tables, {user: dict.fromkeys(SYMBOLS) for user in cfg.users}),
                "true_margins": _plan(cfg, tables, cfg.users),
            },
            "nearest": nearest,
            "candidates": cfg.envelope.candidates,
            "scenes": len(tables.layouts),
            "seeds": len(cfg.protocol.seeds),
        },
    )
    _write_specification(out_dir / "specification.yaml", planner, envelopes[planner], nearest)


def _set_tables(cfg: DictConfig) -> Tables:
    """Read the scenes, and draw the candidates."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    images, layouts = scenes.images[pool], scenes.layouts[pool]
    added = read_interventions(Path(cfg.paths.intervene), layouts)
    if added.images.shape[1:] != images.shape:
        raise InputError(
            f"{cfg.paths.intervene}: pictures {added.images.shape} of added items, {images.shape} of the scenes of "
            f"{pool}; run the intervene stage again"
        )
    z_theta = random_z_theta(stream(cfg.envelope.root_seed, "envelope"), len(layouts), cfg.envelope.candidates)
    to_added = np.stack([_clearance(x, z_theta)[..., 0] for x in added.placed])
    trained = _trained_items(scenes, cfg.protocol.seeds)
    return Tables(images, layouts, added, z_theta, _clearance(layouts, z_theta), to_added, trained)


def _trained_items(scenes: SceneSet, seeds: Sequence[int]) -> tuple[int, ...]:
    layouts = [scenes.layouts[train_pool(seed)] for seed in seeds]
    shown = [set(np.concatenate([x.item[x.symbol == s] for x in layouts])) for s in range(len(SYMBOLS))]
    return tuple(
        max(1, len(items)) for items in shown
    )  # of a symbol never shown no less is known than of one shown once


def _clearance(layouts: Layouts, z_theta: np.ndarray) -> np.ndarray:
    """`clearance` in blocks that fit a processor's cache: nearly three times as fast as all at once."""
    starts = range(0, z_theta.shape[1], BLOCK)
    one = ((layouts[i : i + 1], z_theta[i : i + 1]) for i in range(len(layouts)))
    return np.concatenate([np.concatenate([clearance(x, z[:, s : s + BLOCK]) for s in starts], 1) for x, z in one])


def _choose_paths(cfg: DictConfig, tables: Tables) -> tuple[np.ndarray, np.ndarray]:
    """The doses (dose,) [m] and each one's candidates (symbol, scene, dose, path), -1 where a scene lacks the dose."""
    e, others = cfg.envelope, tables.clearances.min(-1)
    grid = dose_grid(e.step, e.doses)
    chosen = np.stack([paths_at_doses(own, others, grid, e.clear_of_others, e.paths) for own in tables.to_added])
    there = chosen[..., 0] >= 0  # (symbol, scene, dose)
    by_symbol = zip(tables.added.item, there, strict=True)
    items = np.array(
        [[len(np.unique(own[has])) for has in by_scene.T] for own, by_scene in by_symbol]
    )  # (symbol, dose)
    if items.min() < 2:
        symbol, dose = np.unravel_index(items.argmin(), items.shape)
        raise InputError(
            f"{items.min()} items have {e.paths} paths {grid[dose]:.4f} m from an added {SYMBOLS[symbol]} and in "
            "contact, in some scene: expected at least 2; raise envelope.candidates or lower envelope.doses, "
            "envelope.paths or envelope.clear_of_others, or intervene on more scenes"
        )
    return grid, chosen


def _paths(tables: Tables, chosen: np.ndarray) -> np.ndarray:
    """z_theta [m] of the chosen candidates, (symbol, scene, dose * path, 2); of any one where there is none."""
    flat = chosen.reshape(*chosen.shape[:2], -1)
    return np.take_along_axis(tables.z_theta[None], flat[..., None], axis=2)


def _drop(before: np.ndarray, after: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(..., symbol, scene, dose): mean over the paths at each dose of what the added item takes from P(valid)."""
    drop = (before - after).reshape(*before.shape[:-1], *chosen.shape[2:]).mean(-1, dtype=np.float64)
    return np.where(chosen[..., 0] >= 0, drop, np.nan)


def _true_drops(cfg: DictConfig, tables: Tables, chosen: np.ndarray) -> np.ndarray:
    """The world's own answers, as of one seed: (user, 1, symbol, scene, dose)."""
    z, pairs = _paths(tables, chosen), range(len(SYMBOLS))
    before = np.array([[valid(tables.layouts, z[s], m) for s in pairs] for m in cfg.users.values()], float)
    after = np.array([[valid(tables.added.layouts[s], z[s], m) for s in pairs] for m in cfg.users.values()], float)
    return _drop(before, after, chosen)[:, None]


def _model_drops(cfg: DictConfig, tables: Tables, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """By variant (user, seed, symbol, scene, dose). A scene as it is is seen once, with the paths of all symbols."""
    z, users = _paths(tables, chosen), list(cfg.users)  # (symbol, scene, path, 2)
    at = np.nonzero(chosen[:, :, 0, 0] >= 0)  # symbols and scenes that have a path in contact, hence any
    before = predict_all(cfg, users, tables.images, np.concatenate(z, axis=1), "envelope: as it is")
    after = predict_all(cfg, users, tables.added.images[at], z[at], "envelope: one more item")
    drops = {}
    for v in cfg.variants:
        p = before[v].reshape(*before[v].shape[:3], *z.shape[:1], -1)  # (user, seed, scene, symbol, path)
        as_is = np.moveaxis(p, 3, 2)
        more = np.full_like(as_is, np.nan)
        more[:, :, *at] = after[v]
        drops[v] = _drop(as_is, more, chosen)
    return drops


def _cells(drops: np.ndarray) -> np.ndarray:
    """(user, seed, symbol, scene, dose) to (user * symbol, seed, scene, dose)."""
    by_symbol = np.moveaxis(drops, 2, 1)
    return by_symbol.reshape(-1, *by_symbol.shape[2:])


def _keep_clear(envelopes: dict, flips: bool = False) -> dict[str, Margins]:
    """What each user's paths are to keep from each symbol [m], the upper end of the interval.

    flips: only from symbols which, when touched, turn more than half of the valid paths invalid.
    """
    return {
        user: {s: cell["ci_high"] if cell["flips"] or not flips else None for s, cell in by_symbol.items()}
        for user, by_symbol in envelopes.items()
    }


def _plan(cfg: DictConfig, tables: Tables, keep_clear: Mapping[str, Margins]) -> dict[str, dict]:
    """By user, over all candidates in the scenes as they are: what paths that keep these distances are worth."""
    found = {}
    for user, margins in cfg.users.items():
        keeps, truly = (slack(tables.layouts, tables.clearances, m) > 0 for m in (keep_clear[user], margins))
        found[user] = planning(keeps, truly)
    return found


def _plan_nearest(cfg: DictConfig, tables: Tables, keep_clear: Mapping[str, Margins]) -> dict[str, dict]:
    """By user who keeps away from something: paths moved just far enough to keep these distances, none further."""
    starts, found = tables.z_theta[:, : cfg.envelope.starts], {}
    for user, margins in cfg.users.items():
        if any(distance is not None for distance in keep_clear[user].values()):
            moved = ~valid(tables.layouts, starts, keep_clear[user])
            z = nearest_valid(tables.layouts, starts, keep_clear[user], cfg.repair.lattice_side, cfg.repair.refinements)
            moved &= valid(tables.layouts, z, keep_clear[user])  # not so where no path keeps them
            found[user] = nearest_plans(slack(tables.layouts, _clearance(tables.layouts, z), margins)[moved])
    return found


def _write_specification(path: Path, variant: str, envelopes: dict, nearest: dict) -> None:
    content = {
        user: {
            symbol: {
                "keep_clear_m": cell["ci_high"],
                "radius_m": cell["radius_m"],
                "ci_low_m": cell["ci_low"],
                "ci_high_m": cell["ci_high"],
                "drop_at_contact": cell["drop_at_contact"],
                "verdict": cell["verdict"],
            }
            for symbol, cell in by_symbol.items()
        }
        for user, by_symbol in envelopes.items()
    }
    plans = "\n".join(
        f"#   - {user}: {100 * of['valid']:.1f} % of {of['plans']} such plans are valid, 99 % of all within "
        f"{of['short_m']:.4f} m of it"
        for user, of in nearest.items()
    )
    text = HEADER.format(variant=variant, plans=plans) + yaml.safe_dump(content, sort_keys=True)
    atomic_write(path, lambda p: p.write_text(text))


if __name__ == "__main__":
    launch(main, "envelope")
