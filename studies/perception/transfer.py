"""Transfer to path-traced tables: accuracy, effects of added items, and the search for the nearest valid path.

Stage clearance's models were fitted in the drawn world. They see what the segmenter finds, without and with a picture
of the empty table. The truth is that of the users' rules on the true footprints.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from torch import Tensor

from making.render.read import Rendered
from pipeline.causal.added_items import expected_by_version
from pipeline.causal.interventions import compare_with_truth
from pipeline.models.base import ValidityModel, to_tensor
from pipeline.perception.objects import detect_objects
from pipeline.planning.measures import measures
from pipeline.planning.nearest import LogValid, by_truth, nearest
from pipeline.planning.starts import Starts, rows
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import valid
from studies.perception.accuracy import VARIANT, Models, percept, probability, tables_and_paths, trained

EMPTY_KNOWN = {"segmenter": False, "segmenter_empty": True}  # detector -> whether it has the empty table's picture
SEARCH = [
    "user", "seeds", "starts", "success", "success_q1", "success_q3", "success_ci_low", "success_ci_high",
    "displacement_ratio", "unsafe",
]  # fmt: skip


class Transfer(NamedTuple):
    """Results on path-traced splits, each with columns `source` (the split) and `detector`."""

    accuracy: pd.DataFrame  # a row for each user, seed and scene: the share of paths judged right
    verdicts: pd.DataFrame  # a row for each user and added symbol: `compare_with_truth`
    search: pd.DataFrame  # a row for each user: SEARCH, as `pipeline.planning.measures` has it


@dataclass(frozen=True)
class Job:
    """A path-traced split."""

    cfg: DictConfig
    split: str


def transfer(cfg: DictConfig) -> Transfer:
    """Return the results on every split of `studies.perception.rendered`."""
    jobs = [Job(cfg, split) for split in cfg.studies.perception.rendered]
    parts = map_jobs(run, jobs, cfg.workers, "path-traced splits")
    return Transfer(*(pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True)))


def run(job: Job) -> Transfer:
    """Return the results on one split. Raise InputError if it has no pictures with an added item."""
    cfg = job.cfg
    tables, z = tables_and_paths(cfg, job.split)
    if not tables.with_item:
        raise InputError(
            f"{cfg.studies.perception.folder}/{job.split} has no pictures with an added item: leave this split out of "
            "studies.perception.rendered"
        )
    layouts = [tables.layouts, *tables.layouts_with_item.values()]
    true = np.stack([[valid(x, z, cfg.users[user]) for x in layouts] for user in cfg.evaluate.users])
    starts, models, parts = draw_starts(cfg, job.split, tables), trained(cfg), []
    for detector, empty_known in EMPTY_KNOWN.items():
        empty = to_tensor(tables.empty) if empty_known else None
        seen = [percept(detect_objects(to_tensor(x), empty)) for x in (tables.images, *tables.with_item.values())]
        p = np.stack([[probability(model, x, z) for x in seen] for model in models.values()])
        p = p.reshape(len(cfg.evaluate.users), -1, *p.shape[1:])  # (user, seed, version, scene, path)
        found = Transfer(
            _accuracy(models, p, true, tables.tops),
            _verdicts(list(cfg.evaluate.users), list(tables.with_item), p, true),
            _search(cfg, models, seen[0], starts),
        )
        parts.append([table.assign(source=job.split, detector=detector) for table in found])
    return Transfer(*(pd.concat(each, ignore_index=True) for each in zip(*parts, strict=True)))


def draw_starts(cfg: DictConfig, split: str, tables: Rendered) -> dict[str, Starts]:
    """Return each user's invalid paths among `repair.starts` random ones a scene, with the nearest valid ones."""
    rng = stream(cfg.studies.perception.root_seed, "starts", split)
    drawn, starts = random_z_theta(rng, len(tables.images), cfg.repair.starts), {}
    for user in cfg.evaluate.users:
        margins = cfg.users[user]
        scene, start = np.nonzero(~valid(tables.layouts, drawn, margins))
        z = drawn[scene, start]
        truth = by_truth(tables.layouts, margins)
        ends, _ = nearest(truth, scene, z, 1.0, cfg.repair.lattice_side, cfg.repair.refinements)
        starts[user] = Starts(user, margins, tables.layouts, scene, start, z, ends)
    return starts


def _accuracy(
    models: Models,
    p: Float[Array, "user seed version scene path"],
    true: Bool[Array, "user version scene path"],
    tops: list[str],
) -> pd.DataFrame:
    """Return the share of paths judged right in each scene without an added item, for each user and seed."""
    right = ((p[:, :, 0] > DECISION) == true[:, None, 0]).mean(-1).reshape(len(models), -1)
    parts = [
        pd.DataFrame({"user": user, "seed": seed, "scene": range(len(tops)), "top": tops, "accuracy": shares})
        for (user, seed), shares in zip(models, right, strict=True)
    ]
    return pd.concat(parts, ignore_index=True)


def _verdicts(
    users: list[str],
    symbols: list[str],
    p: Float[Array, "user seed version scene path"],
    true: Bool[Array, "user version scene path"],
) -> pd.DataFrame:
    """Return the effect of each added symbol for each user, with verdict and truth; all questions are one family."""
    questions = pd.DataFrame(product(users, symbols), columns=["user", "symbol"])
    truth = (expected[:, 0] for expected in expected_by_version(true[:, None].astype(float)))
    return questions.join(compare_with_truth(*expected_by_version(p), *truth))


def _search(
    cfg: DictConfig, models: Models, seen: Float[Tensor, "scene object column"], starts: Mapping[str, Starts]
) -> pd.DataFrame:
    """Return success, displacement and unsafe ends of the search from each user's invalid paths."""
    r, found = cfg.repair, []
    for (user, seed), model in models.items():
        s = starts[user]
        ends, log_p = nearest(by_percept(model, seen), s.scene, s.z, r.distance_penalty, r.lattice_side, r.refinements)
        found.append(rows(s, "nearest", VARIANT, seed, ends, None, np.exp(log_p)))
    return measures(pd.concat(found, ignore_index=True))[SEARCH]


def by_percept(model: ValidityModel, seen: Float[Tensor, "scene object column"]) -> LogValid:
    """Return a model's log P(valid) among the objects seen, for the search."""

    @torch.no_grad()
    def log_valid(scene: int, z: Array) -> Array:
        logit = model.logit(seen[scene : scene + 1], torch.as_tensor(z, dtype=torch.float32)[None])
        return F.logsigmoid(logit)[0].double().numpy()

    return log_valid


def headlines(headlines: Mapping[str, str], accuracy: pd.DataFrame, verdicts: pd.DataFrame) -> dict[str, float]:
    """Return accuracy on each headline's split, and the right verdicts on the split with fewer of them.

    Without the empty table's picture; accuracy: `accuracy.summarised`, means over users.
    """
    of_segmenter = accuracy.query("detector == 'segmenter' and user == 'all' and top == 'all'").set_index("source")
    right = verdicts.query("detector == 'segmenter'").groupby("source")["right"].sum()
    shown = {name: float(of_segmenter.loc[split, "accuracy"]) for name, split in headlines.items()}
    return shown | {"verdicts_right": int(right[list(headlines.values())].min())}
