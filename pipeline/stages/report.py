"""Stage report: reads what every stage wrote, draws, tabulates and says it; reports/ is what a reader opens."""

import shutil
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.added import Added, read_added
from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, read_json, read_table, write_json, write_whole
from pipeline.artifacts.models import model_dir
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import load_model
from pipeline.causal.statistics import SMALLEST_EFFECT
from pipeline.launch import launch
from pipeline.params import InputError
from pipeline.report.claims import claims
from pipeline.report.figures import overview
from pipeline.report.figures.latent import liveliest
from pipeline.report.figures.maps import Maps
from pipeline.report.figures.overview import UserRow
from pipeline.report.figures.repairs import Repair
from pipeline.report.figures.things import Seen, Things
from pipeline.report.page import render
from pipeline.report.panel import Ascents, Scene, panel
from pipeline.report.pictures import all_pictures
from pipeline.report.pictures.picture import Drawn
from pipeline.report.results import Results, check
from pipeline.report.style import pdf, png
from pipeline.report.table import to_csv, to_markdown, to_tex
from pipeline.report.tables import all_tables
from pipeline.report.wording import listed, split_phrase, variant_label
from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.metrics import DECISION
from pipeline.spec.specification import Specification, to_tensor
from pipeline.spec.things import find
from pipeline.spec.vae import VaeSpecification
from pipeline.table.bezier import lattice
from pipeline.table.layout import SYMBOLS, Layouts
from pipeline.table.rules import valid

FEW = 5  # seeds below which the page says that its numbers mean nothing
FORMS = {"csv": to_csv, "md": to_markdown, "tex": to_tex}
OVERVIEW_DPI = 160
JUDGED_SIDE = 24  # lattice over z_theta by which the worst scene is found, per side


def main(cfg: DictConfig, out_dir: Path) -> None:
    """index.html, tables/ (csv, md, tex), figures/ (svg, pdf, the overview as png) and metrics.json."""
    _check_settings(cfg)
    results = read_results(cfg)
    check(results)
    summary = read_table(Path(cfg.paths.evaluate) / "accuracy.csv")
    scenes = read_scenes(Path(cfg.paths.scenes))
    added = read_added(Path(cfg.paths.intervene), scenes.layouts[_pool(cfg, cfg.intervene.split)].symbol.shape[1])
    drawn = _drawn(cfg, results, scenes, added)
    tables = {t.name: t for t in [claims(results), *all_tables(results)]}
    pictures = all_pictures(results, summary, drawn)
    page = render(results, tables, pictures, _facts(cfg, results), _panel(cfg, results, scenes, added, drawn.seen))
    hero = partial(_overview, cfg, results, drawn)

    files = {f"tables/{t.name}.{form}": write(t) for t in tables.values() for form, write in FORMS.items()}
    files |= {f"figures/{p.name}.svg": p.wide for p in pictures.values()}
    files |= {"index.html": page}
    contents = {name: text.encode() for name, text in files.items()}
    contents |= {f"figures/{p.name}.pdf": p.pdf for p in pictures.values()}
    contents |= {"figures/overview.png": png(hero, OVERVIEW_DPI), "figures/overview.pdf": pdf(hero)}
    for name, content in contents.items():
        write_whole(out_dir / name, lambda path, content=content: path.write_bytes(content))
    write_json(out_dir / "metrics.json", _metrics(results))
    shutil.copyfile(Path(cfg.paths.envelope) / "specification.yaml", out_dir / "specification.yaml")


def _check_settings(cfg: DictConfig) -> None:
    """Raise InputError if conf/report.yaml asks for what cannot be drawn."""
    r = cfg.report
    unknown = [v for v in r.shown if v not in cfg.variants]
    if unknown or not r.shown:
        raise InputError(f"report.shown is {list(r.shown)}: expected some of {', '.join(cfg.variants)}")
    for name in ("scenes", "map_side", "reconstructed", "dimensions", "panel_scenes", "panel_side"):
        if not (isinstance(r[name], int) and r[name] >= 1):
            raise InputError(f"report.{name} is {r[name]!r}: expected a whole number from 1")
    if not r["values"]:
        raise InputError("report.values is empty: give at least one value for a dimension of z_image")


def read_results(cfg: DictConfig) -> Results:
    """Everything that is tabulated or said, from each stage's own files."""
    evaluate, repair, intervene = (Path(cfg.paths[s]) for s in ("evaluate", "repair", "intervene"))
    curves = {v: read_table(model_dir(cfg, v) / "curves.parquet") for v in cfg.variants}
    return Results(
        users=list(cfg.users),
        variants=list(cfg.variants),
        seeds=list(cfg.protocol.seeds),
        ns=list(cfg.n),
        study_n=cfg.study_n,
        splits=dict(cfg.protocol.splits),
        judged_users=list(cfg.evaluate.users),
        world=read_json(Path(cfg.paths.scenes) / "metrics.json"),
        demos=read_demos(Path(cfg.paths.demos)),
        accuracy=read_table(evaluate / "accuracy.parquet"),
        comparisons=read_table(evaluate / "comparisons.csv"),
        calibration=read_table(evaluate / "calibration.parquet"),
        evaluation=read_json(evaluate / "metrics.json"),
        per_seed=cfg.scenes.per_seed,
        efficiency=read_json(Path(cfg.paths.efficiency) / "metrics.json"),
        efficiency_curve=read_table(Path(cfg.paths.efficiency) / "curve.csv"),
        acceptance=read_json(Path(cfg.paths.accept) / "metrics.json"),
        accepted=read_table(Path(cfg.paths.accept) / "curve.csv"),
        repairs=read_table(repair / "repairs.parquet"),
        repair=read_json(repair / "metrics.json"),
        search=read_json(Path(cfg.paths.search) / "metrics.json"),
        effects=read_table(intervene / "effects.parquet"),
        intervention=read_json(intervene / "metrics.json"),
        refutation=read_json(Path(cfg.paths.refute) / "metrics.json"),
        confounding=read_json(Path(cfg.paths.confound) / "metrics.json"),
        robustness=read_json(Path(cfg.paths.robustness) / "metrics.json"),
        counterfactual=read_json(Path(cfg.paths.counterfactual) / "metrics.json"),
        envelope=read_json(Path(cfg.paths.envelope) / "metrics.json"),
        identification=read_json(Path(cfg.paths.identify) / "metrics.json"),
        identified=read_table(Path(cfg.paths.identify) / "curve.csv"),
        selftest=read_json(Path(cfg.paths.selftest) / "metrics.json"),
        curves={v: frame[frame["n"] == cfg.study_n] for v, frame in curves.items()},
    )


def _metrics(results: Results) -> dict:
    """reports/metrics.json: the stages' own numbers under the names that the design fixes."""
    return {
        "world": results.world,
        **{name: results.evaluation[name] for name in ("accuracy", "accuracy_all_users", "calibration")},
        "efficiency": {name: results.efficiency[name] for name in ("accuracy", "reaches", "threshold")},
        "acceptance": results.acceptance["acceptance"],
        "repair": results.repair,
        "search": results.search,
        **{name: results.intervention[name] for name in ("interventions", "specifications", "verdicts")},
        **{name: results.refutation[name] for name in ("refuters", "placebo", "halves")},
        "confounded": {name: results.confounding[name] for name in ("association", "interventions", "verdicts")},
        "robustness": {name: results.robustness[name] for name in ("undisturbed", "disturbed")},
        "counterfactual": results.counterfactual["counterfactual"],
        **{name: results.envelope[name] for name in ("envelope", "planning", "planning_flips", "planning_nulls")},
        **{name: results.identification[name] for name in ("identification", "open_set", "passes_99", "largest_gap")},
        "selftest": results.selftest,
    }


def _facts(cfg: DictConfig, results: Results) -> dict[str, object]:
    """What the page says of the setting."""
    margins = []
    for user, by_symbol in cfg.users.items():
        kept = {f"{100 * m:.1f} cm from {s}": m for s, m in by_symbol.items() if m is not None}
        same = len(kept) == len(SYMBOLS) and len(set(kept.values())) == 1
        said = (
            f"{100 * next(iter(kept.values())):.1f} cm from everything"
            if same
            else listed(list(kept))
            if kept
            else "none"
        )
        margins.append(f"{user}, {said}")
    return {
        "profile": cfg.profile,
        "few": len(results.seeds) < FEW,
        "per_seed": cfg.scenes.per_seed,
        "per_scene": max(cfg.n),
        "shared": cfg.scenes.shared,
        "margins": "; ".join(margins),
        "panel_scenes": cfg.report.panel_scenes,
        "smallest": SMALLEST_EFFECT,
        "evaluations": cfg.search.evaluations,
    }


def _drawn(cfg: DictConfig, results: Results, scenes: SceneSet, added: Added) -> Drawn:
    """The arrays behind the pictures: the first seed's."""
    seed, n = results.seeds[0], cfg.study_n
    training, pool = train_pool(seed), _pool(cfg, cfg.repair.split)
    user = next(iter(_particular(results)), results.users[0])
    model = load_model(cfg, results.main, user, seed, n)
    if not isinstance(model, VaeSpecification):
        raise InputError(f"variant {results.main} rebuilds no image: the first variant must be of kind vae")
    most_varied = _most_varied(scenes, training, cfg.report.scenes)
    count = cfg.report.reconstructed
    originals = np.concatenate([scenes.images[training][:count], scenes.images[_pool(cfg, "new_items")][:count]])
    traversal = model.traverse(scenes.images[training][0], np.array(cfg.report["values"], dtype=float))
    to = scenes.images[_pool(cfg, cfg.intervene.split)]
    unseen = _pool(cfg, "new_items")
    examples = read_arrays(Path(cfg.paths.counterfactual) / "examples.npz")
    found = find(to_tensor(scenes.images[unseen]))
    return Drawn(
        seed=seed,
        scenes=scenes.images[training][most_varied],
        demos={u: _chosen(demo_arrays(results.demos, seed, u, n), most_varied) for u in results.users},
        maps={u: _maps(cfg, scenes, u, seed, int(most_varied[0])) for u in results.users},
        pool=scenes.images[pool],
        layouts=scenes.layouts[pool],
        repairs=_repairs(cfg, results, seed),
        rebuilt=model.reconstruct(originals),
        originals=originals,
        trained_on=min(count, len(scenes.images[training])),
        traversal=traversal,
        dimensions=liveliest(traversal, cfg.report.dimensions),
        values=[float(value) for value in cfg.report["values"]],
        added_to=to[0],
        added=added.images[:, 0],
        worlds=read_arrays(Path(cfg.paths.confound) / "examples.npz"),
        disturbed=read_arrays(Path(cfg.paths.robustness) / "examples.npz"),
        whole=examples["whole"],
        without=examples["without"],
        placebos=read_arrays(Path(cfg.paths.refute) / "placebos.npz")["images"][:, 0],
        added_texts=_added_texts(results, seed, user),
        added_user=user,
        smallest=SMALLEST_EFFECT,
        things=Things(found.ends, found.radius, found.present),
        unseen=scenes.images[unseen],
        unseen_layouts=scenes.layouts[unseen],
        seen=_seen(cfg, results, scenes, unseen, seed),
    )


def _seen(cfg: DictConfig, results: Results, scenes: SceneSet, pool: str, seed: int) -> dict[str, Seen]:
    """What the first variant that finds things makes of them, by user with something invalid."""
    finders = [v for v in results.variants if cfg.variants[v].kind == "clearance"]
    users = _particular(results)
    images, layouts = scenes.images[pool], scenes.layouts[pool]
    z = lattice(JUDGED_SIDE)
    everywhere = np.broadcast_to(z, (len(images), *z.shape))
    out = {}
    for user in users if finders else []:
        model = load_model(cfg, finders[0], user, seed, cfg.study_n)
        if not isinstance(model, ClearanceModel):
            raise InputError(f"variant {finders[0]} finds nothing: expected a model of kind clearance")
        right = (model.probability(images, everywhere) > DECISION) == valid(layouts, everywhere, cfg.users[user])
        agreement = right.mean(1)
        shown = [*range(min(cfg.report.scenes, len(images))), int(agreement.argmin())]
        relevance = model.relevance(model.perceive(to_tensor(images))).mean(0).detach().numpy()
        out[user] = Seen(shown, relevance, agreement)
    return out


def _particular(results: Results) -> list[str]:
    """The users to whom some path is invalid."""
    return [u for u in results.users if results.repair[results.main][u]["success"] is not None]


def _pool(cfg: DictConfig, split: str) -> str:
    """The pool of a split that all seeds share."""
    pool = cfg.protocol.splits.get(split)
    if pool is None:
        raise InputError(f"split {split} has no pool of its own: expected new_scenes or new_items")
    return pool


def _chosen(arrays: tuple[np.ndarray, np.ndarray], scenes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return arrays[0][scenes], arrays[1][scenes]


def _most_varied(scenes: SceneSet, pool: str, count: int) -> np.ndarray:
    """The `count` scenes of a pool with the most symbols, then the most items; the first ones if tied."""
    layouts = scenes.layouts[pool]
    there = (layouts.symbol[..., None] == np.arange(len(SYMBOLS))) & layouts.present[..., None]  # (scene, slot, symbol)
    return np.lexsort((-layouts.present.sum(1), -there.any(1).sum(1)))[:count]


def _maps(cfg: DictConfig, scenes: SceneSet, user: str, seed: int, trained_on: int) -> Maps:
    """Truth and models over the lattice: in a training scene, then in the first scenes of unseen items."""
    side, new = cfg.report.map_side, _pool(cfg, "new_items")
    count = max(1, cfg.report.scenes - 1)
    parts = [(train_pool(seed), slice(trained_on, trained_on + 1)), (new, slice(0, count))]
    images = np.concatenate([scenes.images[pool][at] for pool, at in parts])
    z = lattice(side)
    truth = [
        valid(scenes.layouts[pool][at], np.broadcast_to(z, (len(scenes.images[pool][at]), *z.shape)), cfg.users[user])
        for pool, at in parts
    ]
    everywhere = np.broadcast_to(z, (len(images), *z.shape))
    models = {
        _short(v): load_model(cfg, v, user, seed, cfg.study_n).probability(images, everywhere) for v in cfg.report.shown
    }
    names = ["trained on", *["unseen items"] * (len(images) - 1)]
    shape = (len(images), side, side)
    return Maps(
        names,
        images,
        np.concatenate(truth).reshape(shape).astype(float),
        {k: p.reshape(shape) for k, p in models.items()},
    )


def _short(variant: str) -> str:
    """A variant's name above a small picture."""
    return {
        "full": "Full (paper)",
        "irl_ranked": "IRL, ranking",
        "irl_maxent": "IRL, MaxEnt",
        "path": "Path model",
    }.get(variant, variant_label(variant))


def _repairs(cfg: DictConfig, results: Results, seed: int) -> dict[str, dict[str, list[Repair]]]:
    """The first scenes with a start that is invalid to every user who has invalid paths, and its repairs."""
    paths = read_arrays(Path(cfg.paths.repair) / "paths.npz")
    needy = _particular(results)
    frame = results.repairs[results.repairs["seed"] == seed]
    keys = {
        u: set(
            frame.loc[(frame["user"] == u) & (frame["method"] == results.main), ["scene", "start"]].itertuples(
                index=False, name=None
            )
        )
        for u in needy
    }
    common = sorted(set.intersection(*keys.values())) if keys else []
    first = {scene: (scene, start) for scene, start in reversed(common)}
    chosen = [first[scene] for scene in sorted(first)[: cfg.report.scenes]]
    if not chosen:
        raise InputError(
            f"no start is invalid to all of {listed(needy)} on {split_phrase(cfg.repair.split)}: raise repair.starts"
        )
    return {
        variant: {user: _user_repairs(frame, paths, variant, user, seed, chosen) for user in needy}
        for variant in cfg.report.shown
    }


def _user_repairs(frame: pd.DataFrame, paths: dict, variant: str, user: str, seed: int, chosen: list) -> list:
    rows, z = _repaired(frame, paths, variant, user, seed)
    at = {(r.scene, r.start): r.Index for r in rows.itertuples()}
    found = [at[where] for where in chosen]
    return [Repair(int(rows["scene"][i]), z[i], bool(rows["valid_end"][i]), bool(rows["accepted"][i])) for i in found]


def _repaired(frame: pd.DataFrame, paths: dict, variant: str, user: str, seed: int) -> tuple[pd.DataFrame, np.ndarray]:
    """A model's rows of repairs.parquet and of paths.npz, (start, point, 2) [m], which have the same order."""
    rows = frame[(frame["user"] == user) & (frame["method"] == variant)].reset_index(drop=True)
    key = f"{variant}-{user}-s{seed}"
    if key not in paths or len(paths[key]) != len(rows):
        raise InputError(f"paths.npz does not hold the {len(rows)} repairs of {key}: run the repair stage again")
    return rows, paths[key]


def _panel(cfg: DictConfig, results: Results, scenes: SceneSet, added: Added, seen: Mapping[str, Seen]) -> dict:
    """What a reader can try: every model of the first seed, of users to whom some path is invalid."""
    seed = results.seeds[0]
    users = {user: cfg.users[user] for user in _particular(results)}
    models = {u: {v: load_model(cfg, v, u, seed, cfg.study_n) for v in results.variants} for u in users}
    frame = results.repairs[results.repairs["seed"] == seed]
    paths = read_arrays(Path(cfg.paths.repair) / "paths.npz")
    repaired = {u: {v: _repaired(frame, paths, v, u, seed) for v in results.variants} for u in users}
    splits = {}
    for split, shared in results.splits.items():
        pool = shared or train_pool(seed)
        images, layouts = scenes.images[pool], scenes.layouts[pool]
        further = added if split == cfg.intervene.split else None
        here = repaired if split == cfg.repair.split else {}
        splits[split] = [
            _panel_scene(cfg, name, scene, *_tables(images[scene], layouts[[scene]], scene, further), models, here)
            for scene, name in _chosen_scenes(cfg, split, len(images), seen).items()
        ]
    return panel(splits, users, results.variants, cfg.report.panel_side)


def _chosen_scenes(cfg: DictConfig, split: str, count: int, seen: Mapping[str, Seen]) -> dict[int, str]:
    """Names of a split's first scenes and, among unseen items, of each user's worst, which is the last in `seen`."""
    worst = {user: s.scenes[-1] for user, s in seen.items()} if split == "new_items" else {}
    names = {}
    for scene in sorted({*range(min(cfg.report.panel_scenes, count)), *worst.values()}):
        users = [user for user in worst if worst[user] == scene]
        names[scene] = f"Scene {scene + 1}" + (f", worst for {listed(users)}" if users else "")
    return names


def _panel_scene(
    cfg: DictConfig, name: str, scene: int, images: np.ndarray, layouts: Layouts, models: dict, repaired: dict
) -> Scene:
    """What every model (by user and variant) believes of a scene's tables, and its repairs there, if there are any."""
    cells = lattice(cfg.report.panel_side)
    everywhere = np.broadcast_to(cells, (len(images), *cells.shape))
    maps = {u: {v: model.probability(images, everywhere) for v, model in own.items()} for u, own in models.items()}
    repairs = {
        u: {v: _ascents(models[u][v], rows, z, scene, images[:1]) for v, (rows, z) in own.items()}
        for u, own in repaired.items()
    }
    return Scene(name, list(SYMBOLS[: len(images) - 1]), images, layouts, maps, repairs)


def _tables(image: np.ndarray, layout: Layouts, scene: int, added: Added | None) -> tuple[np.ndarray, Layouts]:
    """Pictures and layouts of a scene as it is, then with each added item."""
    if added is None:
        return image[None], layout
    parts = [layout, *(with_item[[scene]] for with_item in added.layouts)]
    layouts = Layouts(*(np.concatenate([getattr(x, f.name) for x in parts]) for f in fields(Layouts)))
    return np.concatenate([image[None], added.images[:, scene]]), layouts


def _ascents(model: Specification, rows: pd.DataFrame, z: np.ndarray, scene: int, image: np.ndarray) -> Ascents:
    """One scene's repairs by a model, and what it makes of every step."""
    at = np.flatnonzero(rows["scene"] == scene)
    p = model.probability(image, z[at].reshape(1, -1, 2)).reshape(z[at].shape[:2])
    return Ascents(rows["start"].to_numpy()[at], z[at], p)


def _added_texts(results: Results, seed: int, user: str) -> list[str]:
    """True and learned mean validity of the first scene, as it is and with each symbol's first placement."""
    e = results.effects
    e = e[(e["variant"] == results.main) & (e["seed"] == seed) & (e["user"] == user) & (e["scene"] == 0)]
    e = e[e["placement"] == 0].set_index("symbol")
    pairs = [(e["true_baseline"].iloc[0], e["baseline"].iloc[0])]
    pairs += [(e["true_intervened"][s], e["intervened"][s]) for s in SYMBOLS]
    return [f"truth {true:.2f}\nmodel {model:.2f}" for true, model in pairs]


def _overview(cfg: DictConfig, results: Results, drawn: Drawn):
    """The README's picture: the paper's model, users with something to avoid."""
    cells = results.intervention["interventions"]
    rows = []
    for user, (repair, *_) in drawn.repairs[cfg.report.shown[0]].items():
        maps, (z, labels) = drawn.maps[user], drawn.demos[user]
        learned, by_variant = maps.models[_short(cfg.report.shown[0])], {v: cells[v][user] for v in cfg.report.shown}
        rows.append(UserRow(user, drawn.scenes[0], z[0], labels[0], maps.truth[0], learned[0], repair, by_variant))
    label = variant_label(cfg.report.shown[0]).removesuffix(" (paper)").lower()
    return overview.draw(rows, drawn.pool, drawn.layouts, label, SMALLEST_EFFECT)


if __name__ == "__main__":
    launch(main, "reports")
