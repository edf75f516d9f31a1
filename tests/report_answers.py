"""Made-up answers to the questions beyond the paper's, under the names of the stages that ask them."""

from dataclasses import asdict
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.causal.interventions import judge
from pipeline.causal.refuters import PATCHES, REFUTERS
from pipeline.table.layout import SYMBOLS

SCENES = 4


def write_answers(cfg: DictConfig, rng: np.random.Generator) -> None:
    """Write what the stages from ablate to identify would."""
    _ablate(cfg)
    _efficiency(cfg)
    _accept(cfg)
    _refute(cfg, rng)
    _confound(cfg, rng)
    _robustness(cfg, rng)
    _misspecify(cfg, rng)
    _counterfactual(cfg, rng)
    _envelope(cfg)
    _identify(cfg)


def _ablate(cfg: DictConfig) -> None:
    """Without shape the model loses ten points; without its squares it gains one at n = 1."""
    changes = {"whole": (0.0, 0.0), "no_shape": (-0.1, -0.1), "no_squares": (0.01, 0.001), "no_sharpening": (0.0, 0.0)}
    cells = {
        name: {
            f"n{n}": {"accuracy": base + x, "change": x, "change_low": x - 0.02, "change_high": x + 0.02, "ece": 0.02}
            for n, base, x in zip(cfg.ablate.n, (0.9, 0.96), of, strict=True)
        }
        for name, of in changes.items()
    }
    cells["no_sharpening"][f"n{cfg.ablate.n[-1]}"]["ece"] = 0.035
    metrics = {"order": list(changes), "ablations": cells, "users": list(cfg.evaluate.users)}
    metrics |= {"seeds": len(cfg.validation_seeds), "pools": list(cfg.ablate.pools)}
    write_json(Path(cfg.paths.ablate) / "metrics.json", metrics)


def _efficiency(cfg: DictConfig) -> None:
    """The path model reaches the threshold with all scenes and at the largest n, no other does."""
    folder, own, n = Path(cfg.paths.efficiency), cfg.scenes.per_seed, cfg.study_n
    sets = {v: [(s, n) for s in cfg.efficiency.scenes if v in cfg.efficiency.variants] for v in cfg.variants}
    rows = [
        (v, s, k, s * k, 0.8 + 0.001 * s + 0.015 * k * (v == "path"))
        for v in (*cfg.variants, "null_position")
        for s, k in sorted({*sets.get(v, []), *((own, k) for k in cfg.n)})
    ]
    curve = pd.DataFrame(rows, columns=["variant", "scenes", "n", "demonstrations", "mean"])
    write_table(folder / "curve.csv", curve.assign(q1=curve["mean"] - 0.01, q3=curve["mean"] + 0.01))
    cells = {
        v: {f"s{s}": {"mean": mean, "q1": mean, "q3": mean} for of, s, k, _, mean in rows if of == v and k == n}
        for v in cfg.variants
    }
    reaches = {v: {"scenes": own if v == "path" else None, "n": n if v == "path" else None} for v in cfg.variants}
    metrics = {"accuracy": cells, "null": cells["ae"][f"s{own}"], "reaches": reaches, "threshold": 0.95}
    metrics |= {"split": cfg.efficiency.split, "users": list(cfg.evaluate.users), "seeds": len(cfg.seeds)}
    write_json(folder / "metrics.json", metrics)


def _accept(cfg: DictConfig) -> None:
    """In new scenes every promise is kept; with unseen items it is broken."""
    folder, users, splits = Path(cfg.paths.accept), list(cfg.evaluate.users), ("new_scenes", "new_items")
    rules = ("split", "crossed", "training", "decision", "truth")
    shares = {"new_scenes": {"mean": 0.01, "ci_low": 0.005, "ci_high": 0.015, "q1": 0.0, "q3": 0.02, "above": 1}}
    shares["new_items"] = {"mean": 0.05, "ci_low": 0.03, "ci_high": 0.07, "q1": 0.04, "q3": 0.06, "above": 4}
    worth = {"power": 0.8, "where_any": 0.02, "accepted": 50.0, "abstained": 0, "models": 4}
    cells = {split: cell | worth for split, cell in shares.items()}
    found = {split: dict.fromkeys(rules, cell | {"users": dict.fromkeys(users, cell)}) for split, cell in cells.items()}
    metrics = {"acceptance": dict.fromkeys(cfg.accept.variants, found), "rules": rules, "seeds": len(cfg.seeds)}
    metrics |= {"level": 0.02, "error": 0.1, "labels": 180, "held_out": {"split": 90, "crossed": 180}}
    needs = {"valid": dict.fromkeys(users, 0.5), "fewest": dict.fromkeys(users, 99), "without_error": 114}
    write_json(folder / "metrics.json", metrics | needs | {"scenes": SCENES, "paths": 8})
    rows = product(cfg.accept.variants, splits, rules, cfg.accept.levels)
    curve = pd.DataFrame(rows, columns=["variant", "split", "rule", "level"])
    numbers = {f"{name}{end}": 0.05 for name in ("false", "power") for end in ("", "_low", "_high")}
    write_table(folder / "curve.csv", curve.assign(**numbers, abstained=0.0))


def _refute(cfg: DictConfig, rng: np.random.Generator) -> None:
    """Noise alone, but for patches, which move every model."""
    folder, users = Path(cfg.paths.refute), list(cfg.evaluate.users)
    refuters: dict = {}
    names = [*(name for name in REFUTERS if name != "other_table"), "other_table/marble", "other_table/denim"]
    for name, variant in product(names, cfg.variants):
        if name == "permuted" and variant not in cfg.refute.permuted:
            continue
        effects = 0.01 * rng.standard_normal((len(users) * len(SYMBOLS), len(cfg.seeds), SCENES))
        cells = iter(judge(effects - 0.2 * (name in PATCHES)))
        refuters.setdefault(name, {})[variant] = {user: {s: next(cells) for s in SYMBOLS} for user in users}
    tally = {"effect": 0, "no effect": 8, "inconclusive": 0, "cells": 8, "scenes": SCENES}
    tallies = {name: dict.fromkeys(cfg.variants, tally) for name in names}
    tallies["permuted"] = dict.fromkeys(cfg.refute.permuted, tally)
    tallies |= {kind: dict.fromkeys(cfg.variants, tally | {"effect": 8, "no effect": 0}) for kind in PATCHES}
    fooled = {user: refuters["placebo"]["full"][user]["bowl"] | {"verdict": "effect"} for user in users}
    half = {"same": 0.9, "least": 0.6, "spread": 0.01, "scenes": SCENES}
    said = {name: asdict(refuter) for name, refuter in REFUTERS.items()}
    metrics = {"order": names, "said": said, "refuters": refuters, "tallies": tallies, "seeds": len(cfg.seeds)}
    metrics |= {kind: dict.fromkeys(cfg.variants, fooled) for kind in PATCHES}
    metrics |= {"halves": dict.fromkeys(cfg.variants, half)}
    stays = {"same": 8, "cells": 8, "items": 2}
    metrics["items"] = dict.fromkeys(cfg.variants, stays)
    metrics["items_alone"] = dict.fromkeys(cfg.variants, dict.fromkeys(users, -0.1))
    write_json(folder / "metrics.json", metrics)
    patches = {name: _pictures(rng, len(SYMBOLS), 1) for name in PATCHES}
    write_arrays(folder / "placebos.npz", patches)


def _confound(cfg: DictConfig, rng: np.random.Generator) -> None:
    """Plates go with invalid paths where they stand beside glasses; no model blames them."""
    folder, users = Path(cfg.paths.confound), list(cfg.confound.users)
    apart = {"difference": 0.0, "ci_low": -0.1, "ci_high": 0.1, "p_invalid_near": 0.4, "p_invalid_far": 0.4}
    beside = {"difference": 0.5, "ci_low": 0.4, "ci_high": 0.6, "p_invalid_near": 0.8, "p_invalid_far": 0.3}
    ordinary = {user: dict.fromkeys(SYMBOLS, apart) for user in users}
    association = {"ordinary": ordinary, "confounded": {u: ordinary[u] | {"plate": beside} for u in users}}
    cells = judge(0.01 * rng.standard_normal((len(SYMBOLS), len(cfg.seeds), SCENES)))
    nothing = {"verdict": "no effect", "truth_verdict": "no effect", "truth": 0.0}
    told = {symbol: cell | nothing for symbol, cell in zip(SYMBOLS, cells, strict=True)}
    tally = {"cells": 8, "right": 8, "false_causes": 0, "missed_causes": 0, "inconclusive": 0}
    fitted = list(cfg.confound.variants)
    score = {user: {pool: {"mean": 0.9} for pool in ("confounded", "control", "ordinary")} for user in users}
    common = {"verdicts": dict.fromkeys(fitted, tally)}
    seen = common | {"accuracy": dict.fromkeys(fitted, score), "things_per_item": 1.0}
    worlds = {name: seen | {"together": w.together, "gap_m": list(w.gap_m)} for name, w in cfg.confound.worlds.items()}
    added = {"difference": -0.1, "ci_low": -0.2, "ci_high": -0.05, "p_holm": 0.01}
    controlled = [v for v, worlds in cfg.confound.variants.items() if "control" in worlds]
    effects = {
        "interventions": {variant: dict.fromkeys(users, told) for variant in fitted},
        "confounding": {v: dict.fromkeys(users, dict.fromkeys(SYMBOLS, added)) for v in controlled},
    }
    write_json(
        folder / "metrics.json",
        common | effects | {"association": association, "worlds": worlds, "seeds": 2, "near_m": 0.045},
    )
    write_arrays(folder / "examples.npz", {name: _pictures(rng, 2) for name in cfg.confound.worlds})


def _robustness(cfg: DictConfig, rng: np.random.Generator) -> None:
    """The path model alone is better than the null, and loses a tenth to blur and nothing to anything else."""
    folder, users, models = Path(cfg.paths.robustness), list(cfg.evaluate.users), [*cfg.variants, "null_position"]
    r = cfg.robustness

    def cell(variant: str, fall: float) -> dict:
        mean = {"path": 0.95, "null_position": 0.6}.get(variant, 0.5) + fall
        found = {"accuracy": dict.fromkeys(("mean", "q1", "q3"), mean), "by_user": dict.fromkeys(users, mean)}
        found |= {"false_rejects": 0.1, "false_accepts": 0.2, "false_accepts_ci": [0.15, 0.25], "ece": 0.05}
        found["more_accepted"] = {"difference": 0.0, "ci_low": -0.01, "ci_high": 0.01}
        return found | {"difference": fall, "ci_low": fall - 0.01, "ci_high": fall + 0.01}

    def levels(strengths, fitted, fall: float = 0.0) -> list[dict]:
        cells = [{v: cell(v, fall * (v == "path")) for v in fitted(s)} for s in strengths]
        return [{"strength": s, "valid": 0.4, "models": of} for s, of in zip(strengths, cells, strict=True)]

    disturbed = {name: levels(of, lambda s: models, -0.1 * (name == "blur")) for name, of in r.pictures.items()}
    disturbed |= {"tables": levels(r.tables, lambda s: models), "clutter": levels(r.clutter, lambda s: models)}
    shares = sorted({share for own in r.mislabelled.values() for share in own})
    disturbed["labels"] = levels(shares, lambda s: [v for v, own in r.mislabelled.items() if s in own])
    as_is = {"valid": 0.4, "models": {v: cell(v, 0.0) for v in models}}
    kept = {v: {"false_accepts": 0.15, "accepted": 0.8} for v in cfg.variants}
    for disturbance, of in {"none": [as_is], **disturbed}.items():
        called = 0.95 if disturbance == "noise" else 0.05
        strange = {"mean": called, "ci_low": called - 0.03, "ci_high": called + 0.03}
        for level in of if disturbance != "labels" else []:
            level |= {"strange": strange, "kept": kept}
    size = {"order": list(disturbed), "users": users, "seeds": len(cfg.seeds), "scenes": SCENES, "paths": 8}
    size |= {"per_seed": cfg.scenes.per_seed}
    write_json(folder / "metrics.json", size | {"undisturbed": as_is, "disturbed": disturbed})
    pictured = ("as_is", *(name for name in disturbed if name != "labels"))
    write_arrays(folder / "examples.npz", {name: _pictures(rng) for name in pictured})


def _misspecify(cfg: DictConfig, rng: np.random.Generator) -> None:
    """Every model loses a tenth where rules are of another form, and misses one cause."""
    users, variants = list(cfg.evaluate.users), [*cfg.misspecify.variants, "path_averaged"]
    cells = judge(0.01 * rng.standard_normal((len(SYMBOLS), len(cfg.seeds), SCENES)))
    told = {
        s: c | {"truth_verdict": c["verdict"], "truth": 0.0, "right": True} for s, c in zip(SYMBOLS, cells, strict=True)
    }
    missed = told["glass"] | {"truth_verdict": "effect", "truth": -0.2, "right": False}

    def form(fall: float) -> dict:
        cell = {"accuracy": dict.fromkeys(("mean", "q1", "q3"), 0.9 - fall), "false_rejects": 0.1, "false_accepts": 0.2}
        cell["demonstrations"] = dict.fromkeys(("mean", "q1", "q3"), 1 - fall)
        cell |= {"difference": -fall, "ci_low": -fall - 0.01, "ci_high": 0.01 - fall}
        cell["over_position"] = {"difference": 0.1 - fall, "ci_low": 0.09 - fall, "ci_high": 0.11 - fall}
        wrong = len(users) * (fall > 0)
        tally = {"cells": 8, "right": 8 - wrong, "false_causes": 0, "missed_causes": wrong, "inconclusive": 0}
        effects = told | {"glass": missed if fall else told["glass"]}
        return {
            "valid": dict.fromkeys(users, 0.5), "forgiven": fall,
            "models": dict.fromkeys([*variants, "null_position"], cell),
            "interventions": dict.fromkeys(variants, dict.fromkeys(users, effects)),
            "verdicts": dict.fromkeys(variants, tally),
            "credence": {"mean": {"nearest": 0.75, "side": 0.25}, "most": {"nearest": 3, "side": 1}, "meant": "side"},
        }  # fmt: skip

    forms = {name: form(0.0 if name == "margin" else 0.1) for name in cfg.misspecify.forms}
    size = {"users": users, "seeds": len(cfg.seeds), "scenes": SCENES, "paths": 8}
    found = {"order": list(forms), "forms": forms, "amounts": dict(cfg.misspecify.forms)} | size
    write_json(Path(cfg.paths.misspecify) / "metrics.json", found)


def _counterfactual(cfg: DictConfig, rng: np.random.Generator) -> None:
    """Every model blames the right item as often; one worked example."""
    folder = Path(cfg.paths.counterfactual)
    cell: dict = {"recall": 0.9, "blame_right": 0.8, "ci_low": 0.7, "ci_high": 0.9, "several_right": 0.5}
    cell |= {"null_random": 0.4, "null_nearest": 0.85, "null_base_rate": 0.5, "empty_rejected": 0.6}
    cell |= {"pn_error": 0.1, "ps_error": None, "pn_null": 0.3, "ps_null": None}
    cell["least_move"] = {"error_m": 0.004, "null_error_m": 0.02, "true_m": 0.05, "cases": 2, "found": 1.0}
    by_user = {user: cell if user in cfg.evaluate.users else None for user in cfg.users}
    answer = {"p": 0.1, "p_without": [0.9, 0.2]}
    items = [{"symbol": "glass", "slot": k, "clearance_m": 0.02 + 0.1 * k} for k in range(2)]
    told = {user: dict.fromkeys([*cfg.variants, "truth"], answer) for user in cfg.evaluate.users}
    example = {"kind": "disagree", "scene": 1, "path": 2, "z_theta": [0.4, 0.6], "items": items, "users": told}
    metrics = {"counterfactual": dict.fromkeys(cfg.variants, by_user), "examples": [example]}
    write_json(folder / "metrics.json", metrics | {"scenes": SCENES, "paths": 8, "seeds": len(cfg.seeds)})
    write_arrays(folder / "examples.npz", {"whole": _pictures(rng, 1), "without": _pictures(rng, 1, 2)})


def _envelope(cfg: DictConfig) -> None:
    """Every true envelope found a millimetre too narrow, and none besides, but by the first variant nothing."""
    folder, doses = Path(cfg.paths.envelope), [0.0, 0.02, 0.04, 0.06]
    none = {"radius_m": None, "ci_low": None, "ci_high": None, "error_m": None, "covered": None, "truth_m": None}
    none |= {"drop_at_contact": 0.0, "verdict": "no effect"}
    envelopes: dict = {}
    curves: dict = {}
    for i, (variant, user, symbol) in enumerate(product(cfg.variants, cfg.users, SYMBOLS)):
        margin, blind = cfg.users[user][symbol], i < len(cfg.users) * len(SYMBOLS)
        cell = none | {"truth_m": margin}
        if margin is not None and not blind:
            cell |= {"radius_m": margin - 0.001, "ci_low": margin - 0.003, "ci_high": margin + 0.001}
            cell |= {"error_m": -0.001, "covered": True, "drop_at_contact": 0.9, "verdict": "effect"}
        envelopes.setdefault(variant, {}).setdefault(user, {})[symbol] = cell
        drop = [0.9 * float(margin is not None and dose < margin) for dose in doses]
        curve = {"clearance_m": doses, "drop": drop, "ci_low": drop, "ci_high": drop, "truth": drop}
        curves.setdefault(variant, {}).setdefault(user, {})[symbol] = curve
    plan = {user: {"kept": 0.5, "valid": 0.99, "wasted": 0.1} for user in cfg.users}
    nulls = {
        name: {user: {"kept": 1.0, "valid": valid, "wasted": 0.0} for user in cfg.users}
        for name, valid in (("no_envelope", 0.5), ("true_margins", 1.0))
    }
    plans = dict.fromkeys(cfg.variants, plan)
    metrics = {"envelope": envelopes, "curves": curves, "planning": plans, "planning_flips": plans}
    metrics |= {"oracle": envelopes["path"], "nearest": {"careful": {"plans": 40, "valid": 0.6, "short_m": 0.0012}}}
    metrics |= {"planning_nulls": nulls, "scenes": SCENES, "candidates": 64, "seeds": len(cfg.seeds)}
    write_json(folder / "metrics.json", metrics)
    (folder / "specification.yaml").write_text(yaml.safe_dump({u: dict.fromkeys(SYMBOLS) for u in cfg.users}))


def _identify(cfg: DictConfig) -> None:
    """Models a little worse than whoever knows the rules."""
    folder, variants = Path(cfg.paths.identify), [*cfg.variants, "null_position"]
    cell: dict = {"mean": 0.7, "ci_low": 0.65, "ci_high": 0.75, "ideal": 0.75}
    cell |= {"users": {"careful": 0.8, "normal": 0.6}, "ideal_users": {"careful": 0.82, "normal": 0.7}}
    strangers = {"recognised": 0.1, "false_alarms": 0.02, "ideal_recognised": 0.2, "ideal_false_alarms": 0.0}
    strangers |= {"recognised_unlike": 0.6, "ideal_recognised_unlike": 0.9}
    strangers |= {"false_alarms_low": 0.0, "false_alarms_high": 0.04}
    keys, opened = ("k1", "k5", "k20"), strangers | {"users": {"careful": 0.01, "normal": 0.05}}
    metrics = {
        "identification": dict.fromkeys(variants, dict.fromkeys(keys, cell)),
        "open_set": dict.fromkeys(variants, dict.fromkeys(keys, opened)),
        "largest_gap": {v: {"all": 0.05, "telling": 0.01} for v in variants},
        "passes_99": {v: {"all": None, "telling": 12} for v in (*variants, "ideal")},
        "chance": 1 / 3, "level": 0.05, "scenes": SCENES, "telling_scenes": 2, "strange_scenes": 3,
        "seeds": len(cfg.seeds),
    }  # fmt: skip
    write_json(folder / "metrics.json", metrics)
    curve = pd.DataFrame(list(product(variants, range(1, 21))), columns=["variant", "k"])
    for name in ("accuracy", "telling"):
        numbers = {name: 0.7, f"{name}_low": 0.6, f"{name}_high": 0.8, f"ideal_{name}": 0.75}
        curve = curve.assign(**numbers)
    write_table(folder / "curve.csv", curve.assign(**strangers))


def _pictures(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.integers(0, 255, (*shape, 100, 100, 3), dtype=np.uint8)
