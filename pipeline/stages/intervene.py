"""Stage intervene: ask every model the causal questions of conf/questions, and the simulated world beside them.

Models and world are structural causal models that differ in their mechanisms only (pipeline.causal.mechanisms).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf
from pydantic import Field

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import layout_table, read_scenes
from pipeline.causal import interventions
from pipeline.causal.interventions import TRUTH
from pipeline.causal.mechanisms import expected_validities, model_scm, recorded_noise, renderer, true_scm
from pipeline.causal.questions import Question as QuestionSettings
from pipeline.causal.questions import Scenes, change, draw_additions
from pipeline.causal.scm import Values
from pipeline.launch import launch
from pipeline.models.base import SCENES_PER_BATCH
from pipeline.models.trained import check_weights, load_model
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Group, Name, SharedSplit, Whole, checked, need, need_one
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import Items
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import Catalogue, random_scenes
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, concatenated
from pipeline.world.render import ImageSource, read_palette

SCENES_PER_JOB = 4 * SCENES_PER_BATCH  # whole batches, so that results do not depend on it
EFFECTS = ["question", "variant", "user", "seed", "scene", "baseline", "intervened", "effect", "true_effect"]
SUMMARY = [
    "question", "kind", "symbol", "variant", "user", "baseline", "intervened", "effect", "q1", "q3", "ci_low",
    "ci_high", "ci90_low", "ci90_high", "p_holm", "verdict", "truth", "truth_verdict", "right",
]  # fmt: skip

Expected = Float[Array, "seed change every_user every_scene"]  # E[V]; the truth has one seed
Pair = tuple[Float[Array, "_ _ _"], Float[Array, "_ _ _"]]  # (user, seed, scene): E[V] without and with the change


@dataclass(frozen=True)
class Question:
    """One question of some users: the changes it averages over (its placements), or the user who takes over.

    changes: indices into all changes of the stage, the first of which is no change.
    """

    name: str
    kind: str
    symbol: str
    family: str
    users: list[str]
    scenes: Bool[Array, " scene"]
    items: Items  # unseen ones that it is about: added, or else on the table; None: all known
    changes: list[int]
    other: str | None = None

    def expectations(self, users: list[str], expected: Expected) -> Pair:
        """Return E[V | S = s] and E[V | do(...), S = s] of the question's users, in its scenes, placements averaged."""
        rows, expected = [users.index(user) for user in self.users], expected[..., self.scenes]
        baseline = expected[:, 0, rows]
        intervened = expected[:, self.changes].mean(1)[:, rows]
        if self.other is not None:
            intervened = np.broadcast_to(expected[:, 0, [users.index(self.other)]], baseline.shape)
        return baseline.swapaxes(0, 1), intervened.swapaxes(0, 1)


class Settings(Group):
    split: SharedSplit
    more_scenes: Whole
    paths: Count
    placements: Count
    root_seed: Whole


class Asked(Group):
    questions: Annotated[dict[Name, QuestionSettings], Field(min_length=1)]


def agree(intervene: Settings, parameters: Any) -> None:
    """Reject wrong questions, and questions about another user if that user is unknown, or if there is only one."""
    asked = checked(Asked, {"questions": OmegaConf.to_container(parameters.questions)})
    for name, question in asked.questions.items():
        if question.kind == "user":
            need(len(parameters.users) > 1, "users", list(parameters.users), f"at least 2 users for question {name}")
            if question.to is not None:
                need_one(f"questions.{name}.to", question.to, parameters.users)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write effects.parquet, summary.csv, bold.csv and metrics.json of all scenes, and images.npz and layouts.parquet.

    The last two hold the added items in the scenes of the split alone, which stages and studies look at.
    """
    check_weights(cfg)
    users, seeds, variants = list(cfg.users), list(cfg.protocol.seeds), list(cfg.variants)
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    scenes, noise, split = _read_scenes(cfg, catalogue)
    parts = [  # so that more scenes change no placement of the split
        draw_additions(_stream(cfg, name), replace(scenes, layouts=scenes.layouts[rows]), cfg.intervene.placements)
        for name, rows in (("placements", split), ("more placements", slice(split.stop, None)))
    ]
    additions = {s: [concatenated(pair) for pair in zip(*(part[s] for part in parts), strict=True)] for s in SYMBOLS}
    known = catalogue.items["split"].iloc[scenes.pool[0]] == "train"
    questions, changes = _read_questions(cfg, scenes, additions, known)

    chunks = [slice(i, i + SCENES_PER_JOB) for i in range(0, len(scenes.layouts), SCENES_PER_JOB)]
    jobs = [(_rows(noise, chunk), [_rows(change, chunk) for change in changes]) for chunk in chunks]
    truth = expected_validities(true_scm(cfg.users), noise, users, changes)  # (change, user, scene)
    answers = np.concatenate(map_jobs(partial(_answer, cfg), jobs, cfg.workers, "intervene"), axis=-1)
    answers = answers.reshape(len(changes), len(variants), len(seeds), *truth.shape[1:])
    expected = {TRUTH: truth[None]} | dict(zip(variants, np.moveaxis(answers, 0, 2), strict=True))
    pairs = {source: [question.expectations(users, e) for question in questions] for source, e in expected.items()}

    effects = pd.concat([_effects(variant, questions, seeds, pairs) for variant in variants], ignore_index=True)
    summary = pd.concat([_summary(variant, questions, pairs) for variant in variants], ignore_index=True)
    bold = _bold(questions, users, pairs)
    write_table(out_dir / "effects.parquet", effects[EFFECTS])
    write_table(out_dir / "summary.csv", summary[SUMMARY])
    write_table(out_dir / "bold.csv", bold)
    write_json(out_dir / "metrics.json", _metrics(cfg, summary, bold))
    first, render = _rows(noise, split), renderer(palette)
    added = {symbol: additions[symbol][0][split] for symbol in SYMBOLS}
    images = np.stack([render(first["I"], layouts, first["T"])[None] for layouts in added.values()])
    write_arrays(out_dir / "images.npz", {"images": images, "z_theta": first["Z_theta"]})
    rows = [layout_table(f"{symbol}-0", layouts) for symbol, layouts in added.items()]
    write_table(out_dir / "layouts.parquet", pd.concat(rows, ignore_index=True))


def _rows(values: Values, rows: slice) -> Values:
    """Return the nodes' values in some of the scenes."""
    return {name: value[rows] for name, value in values.items()}


def _read_scenes(cfg: DictConfig, catalogue: Catalogue) -> tuple[Scenes, Values, slice]:
    """Return the scenes of the split and after them `intervene.more_scenes`, their noises on record, and the split's.

    The noises are items, table top, render seed and random paths. More scenes are drawn like those of the split.
    """
    stored, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    stored.check_has(pool)
    layouts = stored.layouts[pool]
    splits = set(catalogue.items["split"].iloc[np.unique(layouts.item[layouts.present])])
    if len(splits) != 1:
        raise InputError(f"scenes of {pool} hold items of {sorted(splits)}: expected one split of items.csv")
    items, rules = splits.pop(), LayoutRules.of(cfg.scenes.layout)  # an added item comes from the same split
    more, tops = random_scenes(_stream(cfg, f"more {pool}"), cfg.intervene.more_scenes, catalogue, items, rules)
    split, layouts = slice(len(layouts)), concatenated([layouts, more])
    tops = pd.concat([stored.appearances[pool], tops], ignore_index=True)
    noise = recorded_noise(layouts, tops, random_z_theta(_stream(cfg, "paths"), len(layouts), cfg.intervene.paths))
    textures = list(catalogue.textures["name"])
    return Scenes(layouts, catalogue.footprints, catalogue.pool(items), rules, textures), noise, split


def _stream(cfg: DictConfig, name: str) -> np.random.Generator:
    return stream(cfg.intervene.root_seed, "intervene", name)


def _read_questions(
    cfg: DictConfig, scenes: Scenes, additions: Mapping, known: bool
) -> tuple[list[Question], list[Values]]:
    """Return every question, one for each user who may take over, and all changes; the first changes nothing.

    known: whether the items are those of the training scenes, and so no source of chance.
    InputError if a question makes no sense in these scenes, or if a family's questions are asked in different scenes.
    """
    questions, changes, users = [], [{}], list(cfg.users)
    symbols = scenes.items.symbol
    counts = _count_items(scenes.layouts, len(symbols))
    on_table = None if known else (1 + symbols) * (counts > 0)
    for name, question in Asked.of({"questions": cfg.questions}).questions.items():
        placements, where = change(name, question, scenes, additions, _stream(cfg, name))
        family = question.family or name
        if question.kind == "user":
            for other in users if question.to is None else [question.to]:
                label = name if question.to else f"{name}_{other}"
                others = [user for user in users if user != other]
                questions.append(Question(label, "user", "", family, others, where, on_table, [0], other))
            continue
        indices = list(range(len(changes), len(changes) + len(placements)))
        changes += placements
        symbol = getattr(question, "symbol", "")
        items = on_table
        if question.kind == "add" and not known:
            added = np.any([_count_items(x, len(symbols)) > counts for x in additions[symbol]], axis=0)
            items = (1 + symbols) * added
        questions.append(Question(name, question.kind, symbol, family, users, where, items, indices))
    for question in questions:
        first = next(q for q in questions if q.family == question.family)
        if (question.scenes != first.scenes).any():
            both = f"family {question.family}: {first.name} and {question.name}"
            raise InputError(f"{both} are asked in different scenes; give each a family of its own")
    return questions, changes


def _count_items(layouts: Layouts, items: int) -> Int[Array, "scene item"]:
    """Return how many of each row of items.csv a scene holds."""
    return (layouts.item[..., None] == np.arange(items)).sum(1)


def _answer(cfg: DictConfig, job: tuple[Values, list[Values]]) -> Float[Array, "change model scene"]:
    """Return the expected validities of every variant, seed and user, in this order, in some of the scenes.

    One causal model holds them all, so that each image is rendered, and its objects detected, once.
    """
    noise, changes = job  # on record, and what each change sets
    keys = [(variant, seed, user) for variant in cfg.variants for seed in cfg.protocol.seeds for user in cfg.users]
    models = {"/".join(map(str, key)): load_model(cfg, key[0], key[2], key[1], cfg.main_n_demos) for key in keys}
    scm = model_scm(models, renderer(read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))[1]))
    return expected_validities(scm, noise, list(models), changes)


def _together(pairs: Iterable[Pair]) -> list[Float[Array, "question seed scene"]]:
    """Return E[V] without and with the change of several questions, each user's one after another."""
    return [np.concatenate(side) for side in zip(*pairs, strict=True)]


def _items(questions: list[Question]) -> Items:
    """Return the unseen items of several questions, each user's one after another; None if all are known."""
    items = [q.items[q.scenes] for q in questions for _ in q.users if q.items is not None]
    return np.stack(items) if items else None


def _effects(variant: str, questions: list[Question], seeds: list[int], pairs: Mapping[str, list]) -> pd.DataFrame:
    """Return a row for each question, user, seed and scene."""
    tables = []
    for q, (baseline, intervened), (before, after) in zip(questions, pairs[variant], pairs[TRUTH], strict=True):
        keys = pd.MultiIndex.from_product([q.users, seeds, np.flatnonzero(q.scenes)], names=["user", "seed", "scene"])
        columns = {"baseline": baseline, "intervened": intervened, "effect": intervened - baseline}
        columns["true_effect"] = np.broadcast_to(after - before, baseline.shape)
        columns = {name: values.ravel() for name, values in columns.items()}
        tables.append(keys.to_frame(index=False).assign(question=q.name, variant=variant, **columns))
    return pd.concat(tables, ignore_index=True)


def _summary(variant: str, questions: list[Question], pairs: Mapping[str, list[Pair]]) -> pd.DataFrame:
    """Return a row for each question and user, p-values corrected by family."""
    tables = []
    for family in dict.fromkeys(question.family for question in questions):
        members = [i for i, question in enumerate(questions) if question.family == family]
        answers, truth = (_together(pairs[source][i] for i in members) for source in (variant, TRUTH))
        asked_of = [(questions[i], user) for i in members for user in questions[i].users]
        keys = [(q.name, q.kind, q.symbol, variant, user) for q, user in asked_of]
        items = _items([questions[i] for i in members])
        table = interventions.compare_with_truth(*answers, *(side[:, 0] for side in truth), items=items)
        tables.append(pd.DataFrame(keys, columns=SUMMARY[:5]).join(table))
    return pd.concat(tables, ignore_index=True)


def _bold(questions: list[Question], users: list[str], pairs: Mapping[str, list[Pair]]) -> pd.DataFrame:
    """Return Table 2: the paper's block, the truth's and each variant's (pipeline.causal.interventions.bold_rows)."""
    added = [i for i, question in enumerate(questions) if question.kind == "add"]
    changes = [(user, questions[i].symbol) for i in added for user in questions[i].users]
    blocks = [interventions.paper_rows(users, [questions[i].symbol for i in added])]
    for source in pairs if added else ():
        before, after = _together(pairs[source][i] for i in added)
        items = _items([questions[i] for i in added])
        blocks.append(interventions.bold_rows(source, changes, before, after, items))
    return pd.concat(blocks, ignore_index=True)


def _metrics(cfg: DictConfig, summary: pd.DataFrame, bold: pd.DataFrame) -> dict:
    """Return right verdicts, clearance's largest error on the same questions, and cells of Table 2 as in the paper."""
    rows = interventions.asked(summary, "add", cfg.evaluate.users)
    error = (rows["effect"] - rows["truth"]).abs().groupby(rows["variant"]).max()
    agree = interventions.cells_as_in_the_paper(bold)
    return {
        "verdicts_right": interventions.right_verdicts(summary, "add", cfg.evaluate.users),
        "effect_error": {v: float(error[v]) for v in ("clearance",) if v in error},
        "bold": {v: agree[v] for v in cfg.variants if v in agree},
    }


if __name__ == "__main__":
    launch(main, "intervene")
