"""Stage report: reads what every stage wrote, draws, tabulates and says it; reports/ is what a reader opens."""

from functools import partial
from pathlib import Path

import yaml
from omegaconf import DictConfig

from pipeline.artifacts.added import read_added
from pipeline.artifacts.demos import read_demos
from pipeline.artifacts.files import read_json, read_table, write_json
from pipeline.artifacts.models import model_dir
from pipeline.artifacts.scenes import read_scenes
from pipeline.causal.refuters import PATCHES
from pipeline.causal.statistics import SMALLEST_EFFECT
from pipeline.errors import InputError
from pipeline.exhibits.panel import panel_data
from pipeline.exhibits.pictures import gather, overview_of
from pipeline.exhibits.screenshots import current
from pipeline.launch import launch
from pipeline.report.claims import claims
from pipeline.report.page import render
from pipeline.report.pictures import all_pictures
from pipeline.report.pictures.recordings import screenshots
from pipeline.report.results import Results, check
from pipeline.report.style import pdf, png
from pipeline.report.table import to_csv, to_markdown, to_tex
from pipeline.report.tables import all_tables
from pipeline.report.wording import listed
from pipeline.spec.clearance import SEEN, SHARPENING
from pipeline.spec.things import FEATURES
from pipeline.table.layout import SYMBOLS
from pipeline.writing import write_whole

FEW = 5  # seeds below which the page says that its numbers mean nothing
FORMS = {"csv": to_csv, "md": to_markdown, "tex": to_tex}
OVERVIEW_DPI = 160


def main(cfg: DictConfig, out_dir: Path) -> None:
    """index.html, tables/ (csv, md, tex), figures/ (svg, pdf, the overview as png) and metrics.json."""
    results = read_results(cfg)
    check(results)
    shots = screenshots(results, current(Path(cfg.paths.pictures), results.recorded["sha256"].to_dict()))
    summary = read_table(Path(cfg.paths.evaluate) / "accuracy.csv")
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool)
    added = read_added(Path(cfg.paths.intervene), scenes.layouts[pool])
    drawn = gather(cfg, results, scenes, added)
    tables = {t.name: t for t in [claims(results), *all_tables(results)]}
    pictures = all_pictures(results, summary, drawn)
    panel = panel_data(cfg, results, scenes, added, drawn.seen)
    page = render(results, tables, pictures, shots, _facts(cfg, results), panel)
    hero = partial(overview_of, cfg, results, drawn)

    files = {f"tables/{t.name}.{form}": write(t) for t in tables.values() for form, write in FORMS.items()}
    files |= {f"figures/{p.name}.svg": p.wide for p in pictures.values()}
    files |= {"index.html": page}
    contents = {name: text.encode() for name, text in files.items()}
    contents |= {f"figures/{p.name}.pdf": p.pdf for p in pictures.values()}
    contents["specification.yaml"] = _specification(cfg).encode()
    contents |= {"figures/overview.png": png(hero, OVERVIEW_DPI), "figures/overview.pdf": pdf(hero)}
    for name, content in contents.items():
        write_whole(out_dir / name, lambda path, content=content: path.write_bytes(content))
    write_json(out_dir / "metrics.json", _metrics(results))


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
        ablation=read_json(Path(cfg.paths.ablate) / "metrics.json"),
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
        misspecification=read_json(Path(cfg.paths.misspecify) / "metrics.json"),
        counterfactual=read_json(Path(cfg.paths.counterfactual) / "metrics.json"),
        envelope=read_json(Path(cfg.paths.envelope) / "metrics.json"),
        planner=cfg.envelope.planner,
        identification=read_json(Path(cfg.paths.identify) / "metrics.json"),
        identified=read_table(Path(cfg.paths.identify) / "curve.csv"),
        selftest=read_json(Path(cfg.paths.selftest) / "metrics.json"),
        curves={v: frame[frame["n"] == cfg.study_n] for v, frame in curves.items()},
        recorded=read_table(Path(cfg.paths.record) / "recordings.csv").set_index("run"),
    )


def _specification(cfg: DictConfig) -> str:
    """What stage envelope wrote for planners; InputError if it is not whole."""
    path = Path(cfg.paths.envelope) / "specification.yaml"
    try:
        text = path.read_text()
        users = yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path} cannot be read ({error}): run the envelope stage again") from error
    if not isinstance(users, dict) or any(set(users.get(user) or ()) != set(SYMBOLS) for user in cfg.users):
        raise InputError(f"{path} has not every user's {', '.join(SYMBOLS)}: run the envelope stage again")
    return text


def _metrics(results: Results) -> dict:
    """reports/metrics.json: the stages' own numbers under the names that the design fixes."""
    return {
        "world": results.world,
        **{
            name: results.evaluation[name]
            for name in ("accuracy", "accuracy_all_users", "calibration", "in_new_scenes")
        },
        "efficiency": {name: results.efficiency[name] for name in ("accuracy", "reaches", "threshold")},
        "ablations": results.ablation["ablations"],
        "acceptance": results.acceptance["acceptance"],
        "repair": results.repair,
        "search": results.search,
        **{name: results.intervention[name] for name in ("interventions", "specifications", "verdicts")},
        **{name: results.refutation[name] for name in ("refuters", *PATCHES, "halves", "tallies", "items")},
        "confounded": {name: results.confounding[name] for name in ("association", "interventions", "verdicts")},
        "robustness": {name: results.robustness[name] for name in ("undisturbed", "disturbed")},
        "misspecification": results.misspecification,
        "counterfactual": results.counterfactual["counterfactual"],
        **{name: results.envelope[name] for name in ("envelope", "planning", "planning_flips", "planning_nulls")},
        "planning_nearest": results.envelope["nearest"],
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
        "fitted": cfg.accept.fitted,
        "sharpening": SHARPENING,
        "seen": SEEN,
        "features": len(FEATURES),
    }


if __name__ == "__main__":
    launch(main, "report")
