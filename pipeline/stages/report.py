"""Stage report: write the pages with their figures and tables, and the metrics of all stages in one metrics.json."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_json
from pipeline.artifacts.headlines import headlines
from pipeline.artifacts.models import PREDICTION_COLUMNS, compared, model_dir
from pipeline.artifacts.scenes import SceneSet, read_interventions, read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.baselines import NEAREST, POSITION, nearest_demonstration, position_only
from pipeline.models.trained import load_model
from pipeline.report.derived import by_slice, describe
from pipeline.report.page import FOLDER, Site, provenance, write_files, write_provenance
from pipeline.report.render import render
from pipeline.report.results import DrawnScenes, Results
from pipeline.report.study import Source, of_parameters
from pipeline.runtime.settings import Count, Group
from pipeline.runtime.writing import atomic_write
from pipeline.world.bezier import lattice
from pipeline.world.layout import Layouts
from pipeline.world.render import ImageSource, read_palette, render_scenes
from pipeline.world.rules import valid

HEADLINES = ("scenes", "evaluate", "readings", "repair", "intervene")  # stages whose metrics.json are merged
DECISIONS = Path(__file__).parents[2] / "docs" / "decisions" / "data"
HISTORY = {
    "draws": "test_draws.csv", "changes": "changes_after_tests.csv", "effort": "search_effort.csv",
    "sealed": "sealed_run.csv",
}  # fmt: skip
EVALUATED = "accuracy", "calibration", "scores", "comparisons", "convergence"
TABLES = {name: ("evaluate", f"{name}.csv") for name in EVALUATED} | {  # name -> stage and file
    "curve": ("readings", "curve.csv"),
    "repair": ("repair", "summary.csv"),
    "repairs": ("repair", "repairs.parquet"),
    "interventions": ("intervene", "summary.csv"),
    "bold": ("intervene", "bold.csv"),
    "p_valid": ("scenes", "p_valid.csv"),
    "recordings": ("record", "recordings.csv"),
    "demos": ("demos", "demos.parquet"),
}


class Settings(Group):
    scenes: Count
    map_side: Count
    patterned_top: str


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write index.html and its pages, page.css, figures/*.svg, tables/*.csv, provenance.json and metrics.json."""
    scenes = read_scenes(Path(cfg.paths.scenes))
    tables = {name: read_table(Path(cfg.paths[stage]) / file) for name, (stage, file) in TABLES.items()}
    if "full" in cfg.variants:
        tables["loss"] = read_table(model_dir(cfg, "full") / "curves.csv")
    tables["seeds"] = headlines(cfg, Path(), ("evaluate", "repair"))
    tables["judged"] = _judged(cfg, scenes)
    tables["slices"] = by_slice(tables["judged"])
    tables |= {name: read_table(DECISIONS / file) for name, file in HISTORY.items()}
    results = Results(
        **of_parameters(cfg),
        n_demos=list(cfg.n_demos),
        shown=compared(cfg),
        tables=tables,
        paths=read_arrays(Path(cfg.paths.repair) / "paths.npz"),
        drawn=_drawn(cfg, scenes),
        facts=_facts(cfg, scenes),
        sources=_sources(cfg),
    )
    site = render(results)
    write_site(site, out_dir, provenance(cfg))
    metrics: dict = {"claims": site.claims}
    for stage in HEADLINES:
        metrics |= read_json(Path(cfg.paths[stage]) / "metrics.json")
    write_json(out_dir / "metrics.json", metrics)


def write_site(site: Site, out_dir: Path, facts: Mapping[str, Any]) -> None:
    """Write pages, page.css, figures, tables and provenance.json; remove figures and tables of an earlier run."""
    write_files(site, out_dir)
    write_provenance(site, out_dir, facts)
    atomic_write(out_dir / "page.css", lambda part: part.write_bytes((FOLDER / "page.css").read_bytes()))


def _sources(cfg: DictConfig) -> dict[str, Source]:
    """Return the files behind each table, as DVC names their stages."""
    files: dict[str, Source] = {n: [(stage, Path(cfg.paths[stage]) / file)] for n, (stage, file) in TABLES.items()}
    files |= {name: [("docs/decisions", DECISIONS / file)] for name, file in HISTORY.items()}
    files["seeds"] = [("evaluate", Path(cfg.paths.evaluate) / "accuracy.parquet"), *files["repairs"]]
    files["loss"] = [("train@full", model_dir(cfg, "full") / "curves.csv")] if "full" in cfg.variants else []
    shown = compared(cfg)
    judged = [(f"{cfg.variants[v].stage}@{v}", model_dir(cfg, v) / "predictions.parquet") for v in shown]
    files["judged"] = files["slices"] = [("demos", Path(cfg.paths.demos) / "queries.npz"), *judged]
    return files


def _drawn(cfg: DictConfig, scenes: SceneSet) -> DrawnScenes:
    """Return the first scenes of the repairs' pool, with maps by the first seed's models."""
    pool, seed = cfg.protocol.splits[cfg.repair.split], cfg.protocol.seeds[0]
    scenes.check_has(pool, train_pool(seed))
    images, layouts = scenes.images[pool], scenes.layouts[pool]
    mapped = list(range(min(cfg.report.scenes, len(images))))
    shown, side, users = compared(cfg), cfg.report.map_side, list(cfg.users)
    maps = {v: {u: _predicted_map(cfg, v, u, images[mapped], side) for u in users} for v in shown}
    palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))[1]
    render_seeds = scenes.appearances[pool]["render_seed"].iloc[mapped].tolist()
    patterned = render_scenes(layouts[mapped], [cfg.report.patterned_top] * len(mapped), render_seeds, palette)
    added, user = read_interventions(Path(cfg.paths.intervene), layouts), cfg.evaluate.users[0]
    added_images = np.concatenate([images[:1], added.images[:, 0]])
    added_maps = {v: _predicted_map(cfg, v, user, added_images, side) for v in shown if v in ("full", "clearance")}
    true_added = [_true_map(cfg, user, one[:1], side) for one in (layouts, *added.layouts)]
    return DrawnScenes(
        images=images,
        layouts=layouts,
        mapped=mapped,
        maps=maps,
        truth={u: _true_map(cfg, u, layouts[mapped], side) for u in users},
        patterned=patterned,
        patterned_maps={v: {u: _predicted_map(cfg, v, u, patterned, side) for u in users} for v in shown},
        added_user=user,
        added_images=added_images,
        added_maps={"truth": np.concatenate(true_added)} | added_maps,
        training=scenes.images[train_pool(seed)][: cfg.report.scenes],
    )


def _judged(cfg: DictConfig, scenes: SceneSet) -> pd.DataFrame:
    """Return the judged paths of the shown variants and of the image-blind baselines.

    Columns of `describe`, and variant, user, split, seed, p, valid; at main_n_demos, for `evaluate.users`.
    """
    queries, demos = read_queries(Path(cfg.paths.demos)), read_demos(Path(cfg.paths.demos))
    key, parts, blind = ["user", "split", "seed", "scene", "query"], [], []
    prior = read_position_prior(Path(cfg.paths.scenes))
    for user, (split, shared), seed in product(cfg.evaluate.users, cfg.protocol.splits.items(), cfg.protocol.seeds):
        pool = shared or train_pool(seed)
        tops, asked = list(scenes.appearances[pool]["texture"]), queries[pool]
        rows = describe(scenes.layouts[pool], asked.z, cfg.users[user], tops)
        rows = rows.assign(user=user, split=split, seed=seed, valid=asked.valid[user].ravel())
        parts.append(rows)
        blind.append(rows.assign(variant=POSITION, p=position_only(prior[user], asked.z).ravel()))
        if shared is None:
            p = nearest_demonstration(*demo_arrays(demos, seed, user, cfg.main_n_demos), asked.z)
            blind.append(rows.assign(variant=NEAREST, p=p.ravel()))
    paths = pd.concat(parts, ignore_index=True)
    for variant in compared(cfg):
        p = read_table(model_dir(cfg, variant) / "predictions.parquet", PREDICTION_COLUMNS)
        p = p.loc[p["n_demos"] == cfg.main_n_demos, [*key, "p"]]
        blind.append(paths.merge(p, on=key, validate="one_to_one").assign(variant=variant))
    return pd.concat(blind, ignore_index=True)


def _predicted_map(cfg: DictConfig, variant: str, user: str, images: np.ndarray, side: int) -> np.ndarray:
    """Return P(valid) (scene, side, side) by the first seed's model at main_n_demos."""
    model = load_model(cfg, variant, user, cfg.protocol.seeds[0], cfg.main_n_demos)
    cells = np.broadcast_to(lattice(side), (len(images), side**2, 2))
    return model.probability(images, cells).reshape(-1, side, side)


def _true_map(cfg: DictConfig, user: str, layouts: Layouts, side: int) -> np.ndarray:
    """Return the true validity on the same cells, bool (scene, side, side)."""
    cells = np.broadcast_to(lattice(side), (len(layouts), side**2, 2))
    return valid(layouts, cells, cfg.users[user]).reshape(-1, side, side)


def _facts(cfg: DictConfig, scenes: SceneSet) -> dict:
    """Return the settings that pages print."""
    paper, repair, splits = cfg.variants.get("full"), cfg.repair, cfg.protocol.splits
    facts = {"patterned_top": cfg.report.patterned_top, "train": cfg.train, "scenes_per_seed": cfg.scenes.per_seed}
    facts["items_per_scene"] = list(cfg.scenes.layout.items_per_scene)
    facts |= {"repair_steps": repair.steps, "repair_rate": repair.rate, "optimiser": repair.optimiser}
    facts |= {"distance_penalty": repair.distance_penalty, "test_scenes": len(scenes.images[splits[repair.split]])}
    facts["effect_scenes"] = len(scenes.images[splits[cfg.intervene.split]]) + cfg.intervene.more_scenes
    facts["studies"] = {name: study.question for name, study in cfg.studies.items()}
    facts["weights"] = None if paper is None else {name: paper[name] for name in ("alpha", "beta", "gamma")}
    return provenance(cfg) | facts


if __name__ == "__main__":
    launch(main, "report")
