"""Stage identify: which known user labelled these paths in a new scene, and was it a known one at all?"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes
from pipeline.artifacts.trained import check_weights, predict_all
from pipeline.causal.identify import identify, none_of_these, sure_from, telling, unlike
from pipeline.causal.interventions import DIGITS
from pipeline.launch import launch
from pipeline.models import baselines as nulls
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import estimate
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import valid

TOLD = 1e-6  # floor of probabilities that were told, not learned: the truth and its mean by position


@dataclass(frozen=True)
class Demonstrations:
    """Paths shown in every scene and what each demonstrator, the users and then the stranger, says of them.

    images (scene, 100, 100, 3); z_theta [m] (scene, draw * path, 2); valid (who, scene, draw, path).
    """

    images: np.ndarray
    z_theta: np.ndarray
    valid: np.ndarray


@dataclass(frozen=True)
class Found:
    """What an observer makes of them, draws averaged; every field (true user, path, seed, scene)."""

    right: np.ndarray  # how often the true user is the most probable one
    sure: np.ndarray  # the most probable one's probability
    none: np.ndarray  # how often every user is rejected; here the stranger comes last


def main(cfg: DictConfig, out_dir: Path) -> None:
    """curve.csv and metrics.json."""
    check_weights(cfg)
    shown = _demonstrations(cfg)
    known = shown.valid[: len(cfg.users)]
    labels = cfg.scenes.per_seed * cfg.main_n_demos  # a model learned from
    learned, told = 1 / (labels + 2), TOLD  # Laplace: no n labels make surer than (n + 1) / (n + 2)
    answers = predict_all(cfg, list(cfg.users), shown.images, shown.z_theta, "identify")
    found = {v: _judge(cfg, _by_draw(cfg, p), shown, learned) for v, p in answers.items()}
    found[nulls.POSITION] = _judge(cfg, _by_draw(cfg, _position(cfg, shown.z_theta)), shown, told)
    ideal = _judge(cfg, known[:, None].astype(float), shown, told)
    tells, strange = telling(known), unlike(shown.valid[-1], known)
    curve = pd.concat([_curve(v, f, ideal, tells, strange) for v, f in found.items()], ignore_index=True)
    write_table(out_dir / "curve.csv", curve)
    said = {"strange_scenes": int(strange.sum()), "floor": round(learned, DIGITS)}
    write_json(out_dir / "metrics.json", _metrics(cfg, found, ideal, tells, curve) | said)


def _demonstrations(cfg: DictConfig) -> Demonstrations:
    """Draw the paths of every scene and label them by each demonstrator's rules."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.identify.split]
    scenes.check_has(pool)
    layouts, rng = scenes.layouts[pool], stream(cfg.identify.root_seed, "identify")
    z_theta = random_z_theta(rng, len(layouts), cfg.identify.draws * cfg.identify.paths)
    labels = np.stack([valid(layouts, z_theta, m) for m in (*cfg.users.values(), cfg.identify.stranger)])
    return Demonstrations(scenes.images[pool], z_theta, _by_draw(cfg, labels))


def _by_draw(cfg: DictConfig, values: np.ndarray) -> np.ndarray:
    """(..., draw * path) into (..., draw, path)."""
    return values.reshape(*values.shape[:-1], cfg.identify.draws, cfg.identify.paths)


def _position(cfg: DictConfig, z_theta: np.ndarray) -> np.ndarray:
    """What who never looks at the image knows: each user's mean validity by position, (user, 1, scene, path)."""
    prior = read_position_prior(Path(cfg.paths.scenes))
    if unknown := set(cfg.users) - set(prior):
        raise InputError(f"position_prior.npz knows no user {', '.join(sorted(unknown))}: run the scenes stage again")
    return np.stack([nulls.position_only(prior[user], z_theta) for user in cfg.users])[:, None]


def _judge(cfg: DictConfig, p: np.ndarray, shown: Demonstrations, floor: float) -> Found:
    right, sure = identify(p, shown.valid[: len(cfg.users)], floor)
    return Found(right, sure, none_of_these(p, shown.valid, floor, cfg.identify.level))


def _curve(variant: str, found: Found, ideal: Found, tells: np.ndarray, strange: np.ndarray) -> pd.DataFrame:
    """A row for every k: accuracy in all scenes and in telling ones, open-set rates, and the ideal observer's.

    The stranger is recognised in all scenes, or where he is unlike every user. Of each rate, mean and 95 % interval
    over seeds and scenes.
    """
    columns: dict[str, object] = {"variant": variant, "k": 1 + np.arange(found.right.shape[1])}
    for name, values, best in (
        ("accuracy", found.right.mean(0), ideal.right.mean(0)),
        ("telling", found.right.mean(0)[..., tells], ideal.right.mean(0)[..., tells]),
        ("recognised", found.none[-1], ideal.none[-1]),
        ("recognised_unlike", found.none[-1][..., strange], ideal.none[-1][..., strange]),
        ("false_alarms", found.none[:-1].mean(0), ideal.none[:-1].mean(0)),
    ):
        if values.shape[-1] < 2:  # fewer than two such scenes: nothing to estimate
            continue
        e = estimate(values)
        low, high = (np.clip(end, 0, 1) for end in (e.ci_low, e.ci_high))  # a rate has no other values
        columns |= {name: e.effect, f"{name}_low": low, f"{name}_high": high}
        columns |= {f"ideal_{name}": best.mean((1, 2))}
    return pd.DataFrame(columns | {"confidence": found.sure.mean((0, 2, 3))}).round(DIGITS)


def _metrics(cfg: DictConfig, found: dict[str, Found], ideal: Found, tells: np.ndarray, curve: pd.DataFrame) -> dict:
    """What curve.csv says at `identify.reported`, by true user besides; when each observer is sure; largest gaps."""
    rows = {(row["variant"], row["k"]): row for row in curve.to_dict("records")}
    users, reported = list(cfg.users), {f"k{k}": k for k in cfg.identify.reported}

    def by_user(values: np.ndarray, k: int) -> dict[str, float]:
        return {u: round(float(x), DIGITS) for u, x in zip(users, values[:, k - 1].mean((1, 2)), strict=False)}

    def identified(v: str, k: int) -> dict:
        return _rate(rows[v, k], "accuracy") | {
            "confidence": rows[v, k]["confidence"],
            "users": by_user(found[v].right, k),
            "ideal_users": by_user(ideal.right, k),
            "telling": _rate(rows[v, k], "telling") if "telling" in curve else None,
        }

    def open_set(v: str, k: int) -> dict:
        rates = {name: rate for name, rate in rows[v, k].items() if "recognised" in name or "false_alarms" in name}
        return rates | {"users": by_user(found[v].none, k)}

    right = {v: f.right.mean((0, 2)) for v, f in (found | {"ideal": ideal}).items()}  # (path, scene)
    where = {"all": np.ones_like(tells), "telling": tells}

    def gap(v: str, scenes: np.ndarray) -> float | None:
        lost = (right["ideal"] - right[v])[:, scenes]
        return round(float(lost.mean(1).max()), DIGITS) if lost.size else None

    return {
        "identification": {v: {name: identified(v, k) for name, k in reported.items()} for v in found},
        "open_set": {v: {name: open_set(v, k) for name, k in reported.items()} for v in found},
        "passes_99": {v: {name: sure_from(a[:, at]) for name, at in where.items()} for v, a in right.items()},
        "largest_gap": {v: {name: gap(v, at) for name, at in where.items()} for v in found},
        "chance": round(1 / len(users), DIGITS),
        "level": cfg.identify.level,
        "seeds": len(cfg.protocol.seeds),
        "scenes": len(tells),
        "telling_scenes": int(tells.sum()),
        "draws": cfg.identify.draws,
    }


def _rate(row: dict, name: str) -> dict[str, float]:
    return {
        "mean": row[name],
        "ci_low": row[f"{name}_low"],
        "ci_high": row[f"{name}_high"],
        "ideal": row[f"ideal_{name}"],
    }


if __name__ == "__main__":
    launch(main, "identify")
