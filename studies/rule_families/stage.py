"""Stage misspecify: models fitted to users whose rules are no margins, judged and asked for causes by those rules.

Beside the variants a path model is fitted that is not told the form of the rule (pipeline.models.clearance.rule_averaging).
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_json
from pipeline.artifacts.interventions import read_interventions
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.causal.interventions import DIGITS, by_user, study, tally
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import SCENES_PER_BATCH, ValidityModel, to_tensor, untrained
from pipeline.models.clearance.rule_averaging import AveragedModel, Relations
from pipeline.runtime.parallel import map_jobs, one_thread
from pipeline.runtime.streams import job_seed
from pipeline.stats.crossed import quartiles
from pipeline.stats.scores import DECISION
from pipeline.training.clearance import fit_averaged
from pipeline.training.loop import Schedule
from pipeline.training.refit import TrainingSet, refit
from pipeline.training.runner import need_finite
from pipeline.world.bezier import lattice
from pipeline.world.layout import SYMBOLS, Layouts
from studies.confounding.association import before_and_after
from studies.robustness.losses import change, score
from studies.rule_families.families import FORMS, OWN

Answers = dict[str, dict[str, np.ndarray]]  # form -> variant -> (user, seed, ...)
AVERAGED = "path_averaged"
MEANT = {"margin": "nearest", "brief": "lasting", "right": "side", "beside": "company", "late": "progress"}


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json: accuracy, effects and verdicts of every form and variant, beside the truth and the null."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    directory, users = Path(cfg.paths.intervene), list(cfg.evaluate.users)
    added, z = read_interventions(directory, scenes.layouts[pool]), read_arrays(directory / "images.npz")["z_theta"]
    tables = [scenes.layouts[pool], *added.layouts]  # as it is, and with each symbol added
    truth = {f: np.stack([[_valid(cfg, f, t, z, u) for t in tables] for u in users]) for f in cfg.misspecify.forms}
    answers, learnt, posterior_model_probabilities = _answers(
        cfg, scenes, np.concatenate([scenes.images[pool][None], added.images]), z
    )
    found = {form: _form(cfg, scenes, form, z, truth, answers, learnt[form]) for form in cfg.misspecify.forms}
    for form, believed in posterior_model_probabilities.items():
        found[form]["posterior_model_probabilities"] = _credence(form, believed)
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


def _answers(
    cfg: DictConfig, scenes: SceneSet, images: np.ndarray, z: np.ndarray
) -> tuple[Answers, Answers, dict[str, np.ndarray]]:
    """By models fitted to demonstrations so labelled: P(valid) (..., table, scene, path), and how much they learnt.

    Learnt: the share of its own demonstrations that a model is right about. Last, of the averaged models, how far each
    believes in each of its forms, (user, seed, form).
    """
    demos, users, seeds = read_demos(Path(cfg.paths.demos)), list(cfg.evaluate.users), list(cfg.protocol.seeds)

    def training_set(form: str, user: str, seed: int) -> TrainingSet:
        paths, _ = demo_arrays(demos, seed, user, cfg.main_n_demos)
        pool = train_pool(seed)
        return TrainingSet(user, seed, scenes.images[pool], paths, _valid(cfg, form, scenes.layouts[pool], paths, user))

    forms = list(cfg.misspecify.forms)
    training_sets = [training_set(form, user, seed) for form in forms for user in users for seed in seeds]
    pictures, everywhere = images.reshape(-1, *images.shape[2:]), np.tile(z, (len(images), 1, 1))
    found = refit(
        cfg, dict.fromkeys(cfg.misspecify.variants, training_sets), partial(_ask, pictures, everywhere), "forms"
    )
    averaged = _averaged(cfg, training_sets, pictures, everywhere)
    found[AVERAGED] = [of[:2] for of in averaged]
    by_lesson = len(forms), len(users), len(seeds)
    answers: Answers = {form: {} for form in forms}
    learnt: Answers = {form: {} for form in forms}
    for variant, of in found.items():
        p, right = (np.array(x) for x in zip(*of, strict=True))
        p, right = p.reshape(*by_lesson, *images.shape[:2], z.shape[1]), right.reshape(by_lesson)
        for i, form in enumerate(forms):
            answers[form][variant], learnt[form][variant] = p[i], right[i]
    posterior_model_probabilities = np.array([of[2] for of in averaged]).reshape(*by_lesson, -1)
    return answers, learnt, dict(zip(forms, posterior_model_probabilities, strict=True))


def _ask(images: np.ndarray, z: np.ndarray, model: ValidityModel, own: TrainingSet) -> tuple[np.ndarray, float]:
    """P(valid) of every path [m] in its picture, and the share of its own demonstrations the model is right about."""
    right = (model.probability(own.images, own.z_theta) > DECISION) == own.valid
    return model.probability(images, z), float(right.mean())


def _averaged(
    cfg: DictConfig, training_sets: Sequence[TrainingSet], images: np.ndarray, z: np.ndarray
) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """What `_ask` says of a model that is not told the form, for each training_set, and how far each form is believed."""
    one_thread()
    percept = torch.cat([AveragedModel(1).perceive(to_tensor(some)) for some in _batches(images)])
    related = fit_averaged.relations(percept, torch.from_numpy(z).float())  # once: they are the same for every model
    seen = [x.numpy() for x in (percept, *related)]
    return map_jobs(partial(_fit, cfg, seen), training_sets, cfg.workers, "forms averaged")


def _fit(cfg: DictConfig, seen: list[np.ndarray], training_set: TrainingSet) -> tuple[np.ndarray, float, np.ndarray]:
    """Of one training_set; `seen`: the percept of every picture, and how its paths are related to what is in it."""
    settings = cfg.misspecify.averaged
    seed = job_seed(training_set.seed, training_set.user, cfg.main_n_demos, AVERAGED)
    model = untrained(AveragedModel, {"members": settings.members}, seed)
    assert isinstance(model, AveragedModel)
    taught = training_set.images, training_set.z_theta, training_set.valid
    curve = fit_averaged.fit(model, *taught, schedule=Schedule.of(settings), seed=seed)
    need_finite(curve, f"{AVERAGED} of {training_set.user}, seed {training_set.seed}")
    with torch.no_grad():
        parts = zip(*(_batches(torch.tensor(x)) for x in seen), strict=True)  # aligned: else bits differ
        p = torch.cat([model.judge(percept, Relations(*related)).sigmoid() for percept, *related in parts])
        right = (model.probability(training_set.images, training_set.z_theta) > DECISION) == training_set.valid
        return p.numpy(), float(right.mean()), model.posterior_model_probabilities().numpy()


def _batches(scenes):
    """Slices along the first axis that a processor's cache holds."""
    return [scenes[i : i + SCENES_PER_BATCH] for i in range(0, len(scenes), SCENES_PER_BATCH)]


def _credence(form: str, believed: np.ndarray) -> dict:
    """How far each form is believed on average, which one most by how many models, and which one is the rule's."""
    names = [*fit_averaged.FORMS, "nothing"]
    most = np.bincount(believed.reshape(-1, len(names)).argmax(1), minlength=len(names))
    return {
        "mean": {name: round(float(x), DIGITS) for name, x in zip(names, believed.mean((0, 1)), strict=True)},
        "most": dict(zip(names, map(int, most), strict=True)),
        "meant": MEANT.get(form),
    }


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
    guesses = np.stack([baselines.position_only(_prior(cfg, scenes, form, user), z) for user in users])[:, None] > DECISION
    models = {}
    for variant, p in answers[form].items():
        accepted = p[:, :, 0] > DECISION
        models[variant] = score(accepted, as_is) | change(accepted, as_is, before[variant], truth[OWN][:, 0])
        models[variant]["over_position"] = change(accepted, as_is, np.broadcast_to(guesses, accepted.shape), as_is)
        own = quartiles(learnt[variant].mean(0))
        models[variant]["demonstrations"] = {name: round(value, DIGITS) for name, value in own.items()}
    return {
        "valid": {user: round(float(of.mean()), DIGITS) for user, of in zip(users, as_is, strict=True)},
        "forgiven": round(float((as_is & ~truth[OWN][:, 0]).sum() / max((~truth[OWN][:, 0]).sum(), 1)), DIGITS),
        "models": models | {baselines.POSITION: score(guesses, as_is)},
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
