"""The arrays behind the pictures: the first seed's."""

from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.added import Added
from pipeline.artifacts.demos import demo_arrays
from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.artifacts.trained import load_model
from pipeline.causal.statistics import SMALLEST_EFFECT
from pipeline.errors import InputError
from pipeline.exhibits.choice import most_varied, repairs_of, with_something_invalid
from pipeline.report.figures import overview
from pipeline.report.figures.latent import liveliest
from pipeline.report.figures.maps import Maps
from pipeline.report.figures.overview import UserRow
from pipeline.report.figures.repairs import Repair
from pipeline.report.figures.things import Seen, Things
from pipeline.report.pictures.picture import Drawn
from pipeline.report.results import Results
from pipeline.report.tables.repair import repairer
from pipeline.report.wording import listed, split_phrase, variant_label
from pipeline.spec.clearance import ClearanceModel
from pipeline.spec.metrics import DECISION
from pipeline.spec.specification import to_tensor
from pipeline.spec.things import find
from pipeline.spec.vae import VaeSpecification
from pipeline.table.bezier import lattice
from pipeline.table.layout import SYMBOLS
from pipeline.table.rules import valid

JUDGED_SIDE = 24  # lattice over z_theta by which the worst scene is found, per side


def gather(cfg: DictConfig, results: Results, scenes: SceneSet, added: Added) -> Drawn:
    """The arrays behind the pictures: the first seed's."""
    seed, n = results.seeds[0], cfg.study_n
    training, pool = train_pool(seed), cfg.protocol.splits[cfg.repair.split]
    user = next(iter(with_something_invalid(results)), results.users[0])
    model = load_model(cfg, results.main, user, seed, n)
    if not isinstance(model, VaeSpecification):
        raise InputError(f"variant {results.main} rebuilds no image: the first variant must be of kind vae")
    varied = most_varied(scenes, training, cfg.report.scenes)
    count = cfg.report.reconstructed
    originals = np.concatenate([scenes.images[training][:count], scenes.images[cfg.protocol.splits.new_items][:count]])
    traversal = model.traverse(scenes.images[training][0], np.array(cfg.report["values"], dtype=float))
    to = scenes.images[cfg.protocol.splits[cfg.intervene.split]]
    unseen = cfg.protocol.splits.new_items
    examples = read_arrays(Path(cfg.paths.counterfactual) / "examples.npz")
    found = find(to_tensor(scenes.images[unseen]))
    return Drawn(
        seed=seed,
        scenes=scenes.images[training][varied],
        demos={u: _chosen(demo_arrays(results.demos, seed, u, n), varied) for u in results.users},
        maps={u: _maps(cfg, scenes, u, seed, int(varied[0])) for u in results.users},
        pool=scenes.images[pool],
        layouts=scenes.layouts[pool],
        repairs=_repairs(cfg, results, seed),
        failures=_failures(cfg, results),
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
        placebos={kind: of[:, 0] for kind, of in read_arrays(Path(cfg.paths.refute) / "placebos.npz").items()},
        added_texts=_added_texts(results, seed, user),
        added_user=user,
        smallest=SMALLEST_EFFECT,
        things=Things(found.ends, found.radius, found.present),
        unseen=scenes.images[unseen],
        unseen_layouts=scenes.layouts[unseen],
        seen=_seen(cfg, results, scenes, unseen, seed),
    )


def _chosen(arrays: tuple[np.ndarray, np.ndarray], scenes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return arrays[0][scenes], arrays[1][scenes]


def _seen(cfg: DictConfig, results: Results, scenes: SceneSet, pool: str, seed: int) -> dict[str, Seen]:
    """What the first variant that finds things makes of them, by user with something invalid."""
    finders = [v for v in results.variants if cfg.variants[v].kind == "clearance"]
    users = with_something_invalid(results)
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


def _maps(cfg: DictConfig, scenes: SceneSet, user: str, seed: int, trained_on: int) -> Maps:
    """Truth and models over the lattice: in a training scene, then in the first scenes of unseen items."""
    side, new = cfg.report.map_side, cfg.protocol.splits.new_items
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
    needy = with_something_invalid(results)
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
    rows, z = repairs_of(frame, paths, variant, user, seed)
    at = {(r.scene, r.start): r.Index for r in rows.itertuples()}
    found = [at[where] for where in chosen]
    return [Repair(int(rows["scene"][i]), z[i], bool(rows["valid_end"][i]), bool(rows["accepted"][i])) for i in found]


def _failures(cfg: DictConfig, results: Results) -> dict[str, list[Repair]]:
    """The best variant's searches that fooled it, one a scene, those that end deepest within a margin first."""
    ends = read_table(Path(cfg.paths.search) / "searches.parquet")
    ends = ends[(ends["method"] == repairer(results)) & (ends["search"] == "bayesian")]
    fooled = ends[ends["accepted"].astype(bool) & ~ends["valid_end"]].sort_values("clearance_m", kind="stable")
    worst = fooled.drop_duplicates(["user", "scene"])
    by_user = {user: worst[worst["user"] == user] for user in with_something_invalid(results)}
    count = min([cfg.report.scenes, *map(len, by_user.values())])
    return {user: [_failure(row) for row in rows.head(count).itertuples()] for user, rows in by_user.items() if count}


def _failure(row) -> Repair:
    said = f"{-1000 * row.clearance_m:.0f} mm short, P = {row.p_end:.2f}, seed {row.seed}"
    return Repair(row.scene, np.array([[row.z0_x, row.z0_y], [row.z_x, row.z_y]]), False, True, said)


def _added_texts(results: Results, seed: int, user: str) -> list[str]:
    """True and learned mean validity of the first scene, as it is and with each symbol's first placement."""
    e = results.effects
    e = e[(e["variant"] == results.main) & (e["seed"] == seed) & (e["user"] == user) & (e["scene"] == 0)]
    e = e[e["placement"] == 0].set_index("symbol")
    pairs = [(e["true_baseline"].iloc[0], e["baseline"].iloc[0])]
    pairs += [(e["true_intervened"][s], e["intervened"][s]) for s in SYMBOLS]
    return [f"truth {true:.2f}\nmodel {model:.2f}" for true, model in pairs]


def overview_of(cfg: DictConfig, results: Results, drawn: Drawn):
    """The README's picture: the paper's model, users with something to avoid."""
    cells = results.intervention["interventions"]
    rows = []
    for user, (repair, *_) in drawn.repairs[cfg.report.shown[0]].items():
        maps, (z, labels) = drawn.maps[user], drawn.demos[user]
        learned, by_variant = maps.models[_short(cfg.report.shown[0])], {v: cells[v][user] for v in cfg.report.shown}
        rows.append(UserRow(user, drawn.scenes[0], z[0], labels[0], maps.truth[0], learned[0], repair, by_variant))
    label = variant_label(cfg.report.shown[0]).removesuffix(" (paper)").lower()
    return overview.draw(rows, drawn.pool, drawn.layouts, label, SMALLEST_EFFECT)
