"""Stage efficiency: how much data each model needs, in training scenes and in demonstrations a scene.

Models are fitted to the first of a seed's training scenes, and to all of them with further ones; those fitted to
scenes.per_seed scenes, at every n, are the ones that stage evaluate has scored.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import Queries, read_demos, read_queries
from pipeline.artifacts.files import read_table, write_json, write_table
from pipeline.artifacts.scenes import SceneSet, read_scenes
from pipeline.causal.interventions import DIGITS
from pipeline.causal.statistics import quartiles
from pipeline.errors import InputError
from pipeline.fitting.further import taught
from pipeline.fitting.trainers import Lesson, fit_and_ask
from pipeline.launch import launch
from pipeline.spec.efficiency import reaches
from pipeline.spec.metrics import accuracy
from pipeline.spec.nulls import POSITION

KEY = ["variant", "scenes", "n", "user", "seed"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """curve.csv and metrics.json."""
    known, scenes = _evaluated(cfg), read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[cfg.efficiency.split]
    queries = _queries(cfg, pool, scenes)
    fitted = _fitted(cfg, _lessons(cfg, scenes), scenes.images[pool], queries)
    scores = pd.concat([known, fitted], ignore_index=True)
    write_table(out_dir / "curve.csv", _curve(scores))
    write_json(out_dir / "metrics.json", _metrics(cfg, scores))


def _evaluated(cfg: DictConfig) -> pd.DataFrame:
    """The scores of stage evaluate where models are judged here; InputError if one is missing."""
    path, columns = Path(cfg.paths.evaluate) / "accuracy.parquet", ["variant", "n", "user", "seed"]
    rows = read_table(path, [*columns, "split", "accuracy"]).query("split == @cfg.efficiency.split")
    asked = [list(cfg.n), list(cfg.evaluate.users), list(cfg.protocol.seeds)]
    wanted = pd.MultiIndex.from_product([[*cfg.variants, POSITION], *asked], names=columns)
    lacking = wanted.difference(pd.MultiIndex.from_frame(rows[columns]))
    if len(lacking):
        name = "variant {}, n {}, user {}, seed {}".format(*lacking[0])
        raise InputError(f"{path} lacks the accuracy of {name}: run the evaluate stage again")
    found = rows.set_index(columns)["accuracy"].reindex(wanted).reset_index()
    return found.assign(scenes=cfg.scenes.per_seed)[[*KEY, "accuracy"]]


def _queries(cfg: DictConfig, pool: str, scenes: SceneSet) -> Queries:
    """The paths that stage evaluate asks about in this pool."""
    queries = read_queries(Path(cfg.paths.demos)).get(pool)
    if pool not in scenes.images or queries is None or not set(cfg.evaluate.users) <= set(queries.valid):
        users = ", ".join(cfg.evaluate.users)
        raise InputError(f"no scenes or queries of {users} in {pool}: run stages scenes and demos again")
    return queries


def _lessons(cfg: DictConfig, scenes: SceneSet) -> list[Lesson]:
    """What models are fitted to, the most scenes first, seed by seed."""
    sizes, demos = sorted(cfg.efficiency.scenes, reverse=True), read_demos(Path(cfg.paths.demos))
    most = [taught(cfg, scenes, demos, s, sizes[0]) for s in tqdm(cfg.protocol.seeds, desc="further scenes")]
    others = [size for size in sizes if size != cfg.scenes.per_seed]
    return [_first(lesson, size) for size in others for of_seed in most for lesson in of_seed]


def _fitted(cfg: DictConfig, lessons: list[Lesson], images: np.ndarray, queries: Queries) -> pd.DataFrame:
    """The scores of models fitted here."""
    lessons_of = dict.fromkeys(cfg.efficiency.variants, lessons)
    rows = [
        (variant, len(x.images), cfg.study_n, x.user, x.seed, accuracy(p.ravel(), queries.valid[x.user].ravel()))
        for variant, answers in fit_and_ask(cfg, lessons_of, images, queries.z, "efficiency").items()
        for x, p in zip(lessons, answers, strict=True)
    ]
    return pd.DataFrame(rows, columns=[*KEY, "accuracy"])


def _first(lesson: Lesson, scenes: int) -> Lesson:
    """The same in the first scenes alone."""
    return Lesson(lesson.user, lesson.seed, lesson.images[:scenes], lesson.z_theta[:scenes], lesson.valid[:scenes])


def _curve(scores: pd.DataFrame) -> pd.DataFrame:
    """Accuracy, the mean over users, by variant, scenes and n: mean and quartiles over seeds."""
    rows = [
        {"variant": variant, "scenes": scenes, "n": n, "demonstrations": scenes * n} | _summary(part)
        for (variant, scenes, n), part in scores.groupby(["variant", "scenes", "n"], sort=False)
    ]
    return pd.DataFrame(rows).sort_values(["variant", "scenes", "n"], ignore_index=True)


def _summary(part: pd.DataFrame) -> dict[str, float]:
    """Mean and quartiles over seeds, each seed the mean over its users."""
    return quartiles(part.groupby("seed")["accuracy"].mean().to_numpy())


def _metrics(cfg: DictConfig, scores: pd.DataFrame) -> dict:
    """Cells by variant and scenes at study_n, the null, and where each variant reaches the threshold."""
    studied, c = scores[scores["n"] == cfg.study_n], cfg.efficiency
    cells = {
        variant: {f"s{scenes}": _cell(part) for scenes, part in of.groupby("scenes")}
        for variant, of in studied.groupby("variant", sort=False)
    }
    own = scores[scores["scenes"] == cfg.scenes.per_seed]
    return {
        "accuracy": {variant: cells[variant] for variant in cfg.variants},
        "null": cells[POSITION][f"s{cfg.scenes.per_seed}"],
        "reaches": {
            variant: {
                "scenes": _reached(studied, variant, "scenes", c.threshold),
                "n": _reached(own, variant, "n", c.threshold),
            }
            for variant in cfg.variants
        },
        "threshold": c.threshold,
        "split": c.split,
        "users": list(cfg.evaluate.users),
        "seeds": len(cfg.protocol.seeds),
    }


def _cell(part: pd.DataFrame) -> dict:
    """Accuracy over users, and of each: mean and quartiles over seeds."""
    by_user = {user: _rounded(_summary(of)) for user, of in part.groupby("user")}
    return _rounded(_summary(part)) | {"users": by_user}


def _rounded(numbers: dict[str, float]) -> dict[str, float]:
    return {name: round(value, DIGITS) for name, value in numbers.items()}


def _reached(scores: pd.DataFrame, variant: str, amount: str, threshold: float) -> int | None:
    """The smallest scenes or n at which the variant's mean accuracy is at least the threshold."""
    means = scores[scores["variant"] == variant].groupby(amount)["accuracy"].mean()
    return reaches({int(size): float(mean) for size, mean in means.items()}, threshold)


if __name__ == "__main__":
    launch(main, "efficiency")
