"""Stage misspecify: models fitted to users whose rules are no margins, judged and asked for causes by those rules."""

from functools import partial
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from pipeline.artifacts.added import read_added
from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_json
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.causal.confound import before_and_after
from pipeline.causal.interventions import DIGITS, by_user, study, tally
from pipeline.causal.robustness import change, score
from pipeline.causal.statistics import quartiles
from pipeline.fitting.trainers import Lesson, fit_each
from pipeline.launch import launch
from pipeline.spec import nulls
from pipeline.spec.metrics import DECISION
from pipeline.spec.specification import Specification
from pipeline.table.bezier import lattice
from pipeline.table.forms import FORMS, OWN
from pipeline.table.layout import SYMBOLS, Layouts

Answers = dict[str, dict[str, np.ndarray]]  # form -> variant -> (user, seed, ...)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json: accuracy, effects and verdicts of every form and variant, beside the truth and the null."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    directory, users = Path(cfg.paths.intervene), list(cfg.evaluate.users)
    added, z = read_added(directory, scenes.layouts[pool]), read_arrays(directory / "images.npz")["z_theta"]
    tables = [scenes.layouts[pool], *added.layouts]  # as it is, and with each symbol added
    truth = {f: np.stack([[_valid(cfg, f, t, z, u) for t in tables] for u in users]) for f in cfg.misspecify.forms}
    answers, learnt = _answers(cfg, scenes, np.concatenate([scenes.images[pool][None], added.images]), z)
    found = {form: _form(cfg, scenes, form, z, truth, answers, learnt[form]) for form in cfg.misspecify.forms}
    metrics = {
        "order": list(found),
        "forms": found,
        "amounts": dict(cfg.misspecify.forms),
        "users": users,
        "seeds": len(cfg.protocol.seeds),
        "scenes": z.shape[0],
        "paths": z.shape[1],
    }
    write_json(out_dir / "metrics.json", metrics)


def _valid(cfg: DictConfig, form: str, layouts: Layouts, z: np.ndarray, user: str) -> np.ndarray:
    """Whether each path [m] is valid to a user whose rule has that form, (scene, path)."""
    return FORMS[form](layouts, z, cfg.users[user], float(cfg.misspecify.forms[form]))


def _answers(cfg: DictConfig, scenes: SceneSet, images: np.ndarray, z: np.ndarray) -> tuple[Answers, Answers]:
    """By models fitted to demonstrations so labelled: P(valid) (..., table, scene, path), and how much they learnt.

    Learnt: the share of its own demonstrations that a model is right about.
    """
    demos, users, seeds = read_demos(Path(cfg.paths.demos)), list(cfg.evaluate.users), list(cfg.protocol.seeds)

    def lesson(form: str, user: str, seed: int) -> Lesson:
        paths, _ = demo_arrays(demos, seed, user, cfg.study_n)
        pool = train_pool(seed)
        return Lesson(user, seed, scenes.images[pool], paths, _valid(cfg, form, scenes.layouts[pool], paths, user))

    forms = list(cfg.misspecify.forms)
    lessons = [lesson(form, user, seed) for form in forms for user in users for seed in seeds]
    pictures, everywhere = images.reshape(-1, *images.shape[2:]), np.tile(z, (len(images), 1, 1))
    ask = partial(_ask, pictures, everywhere)
    found = fit_each(cfg, dict.fromkeys(cfg.misspecify.variants, lessons), ask, "other forms")
    answers: Answers = {form: {} for form in forms}
    learnt: Answers = {form: {} for form in forms}
    for variant, of in found.items():
        p, right = (np.array(x) for x in zip(*of, strict=True))
        p = p.reshape(len(forms), len(users), len(seeds), *images.shape[:2], z.shape[1])
        right = right.reshape(p.shape[:3])
        for i, form in enumerate(forms):
            answers[form][variant], learnt[form][variant] = p[i], right[i]
    return answers, learnt


def _ask(images: np.ndarray, z: np.ndarray, model: Specification, own: Lesson) -> tuple[np.ndarray, float]:
    """P(valid) of every path [m] in its picture, and the share of its own demonstrations the model is right about."""
    right = (model.probability(own.images, own.z_theta) > DECISION) == own.valid
    return model.probability(images, z), float(right.mean())


def _form(
    cfg: DictConfig,
    scenes: SceneSet,
    form: str,
    z: np.ndarray,
    truth: dict[str, np.ndarray],
    answers: Answers,
    learnt: dict[str, np.ndarray],
) -> dict:
    """What became of one form: of each variant its score, what the form adds to its accuracy, and its verdicts."""
    users, as_is = list(cfg.evaluate.users), truth[form][:, 0]
    cells = {v: study(*_effects(p), *_effects(truth[form].astype(float))) for v, p in answers[form].items()}
    before = {v: p[:, :, 0] > DECISION for v, p in answers[OWN].items()}
    models = {}
    for variant, p in answers[form].items():
        accepted = p[:, :, 0] > DECISION
        models[variant] = score(accepted, as_is) | change(accepted, as_is, before[variant], truth[OWN][:, 0])
        own = quartiles(learnt[variant].mean(0))
        models[variant]["demonstrations"] = {name: round(value, DIGITS) for name, value in own.items()}
    guesses = np.stack([nulls.position(_prior(cfg, scenes, form, user), z) for user in users])
    return {
        "valid": {user: round(float(of.mean()), DIGITS) for user, of in zip(users, as_is, strict=True)},
        "forgiven": round(float((as_is & ~truth[OWN][:, 0]).sum() / max((~truth[OWN][:, 0]).sum(), 1)), DIGITS),
        "models": models | {nulls.POSITION: score(guesses[:, None] > DECISION, as_is)},
        "interventions": {v: by_user(users, of) for v, of in cells.items()},
        "verdicts": {v: tally(of) for v, of in cells.items()},
    }


def _prior(cfg: DictConfig, scenes: SceneSet, form: str, user: str) -> np.ndarray:
    """Mean validity of every z_theta over all training scenes, (side, side) as [y, x]: what position alone tells."""
    side, z = cfg.scenes.prior_side, lattice(cfg.scenes.prior_side)
    shares = [
        _valid(cfg, form, scenes.layouts[pool], np.tile(z, (len(scenes.layouts[pool]), 1, 1)), user).mean(0)
        for pool in map(train_pool, cfg.protocol.seeds)
    ]
    return np.mean(shares, axis=0).reshape(side, side)


def _effects(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E[V] before and after each symbol is added, (user * symbol, ..., scene), of (user, ..., table, scene, path)."""
    return before_and_after(p, 0, range(1, 1 + len(SYMBOLS)))


if __name__ == "__main__":
    launch(main, "misspecify")
