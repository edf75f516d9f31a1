"""Write bench/results.json, bench/README.md and its two figures from benchmark results.

python -m bench.page BENCHMARKS.json REPRO.json
"""

import json
import math
import re
import sys
from pathlib import Path

import torch
from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

HERE = Path(__file__).resolve().parent
COMMANDS = {  # of bench.repro -> (command, aim)
    "environment": ("`make venv`", ""),
    "demo": ("`make demo`", "at most 5, with the environment"),
    "repro": ("`make repro`, from an empty cache", "at most 33"),
    "sealed_repro": ("`make repro`, the sealed run", "at most 33"),
    "studies": ("`make studies`, after it", "at most 60"),
    "sealed_studies": ("`make studies`, the sealed run", "at most 60"),
    "test": ("`make test`", "at most 6"),
    "quick_tests": ('`pytest -n 2 -m "not slow"`', "at most 1"),
}
AIMS = {  # name of the figure -> (description, aim)
    "train_speedup_rows": ("a pass of full, n_demos = 9: times one row per (image, path)", "at least 30"),
    "train_speedup_best_eager": ("the same: times the best eager form", "at least 3"),
    "fma_peak_share_stacked": ("the same: share of what one core can multiply and add", "at least .60"),
    "fit_speedup_scipy": ("fitting demonstrations: times one scipy call per trajectory", "at least 100"),
    "train_seconds_clearance": (
        "fitting one clearance model to 20 scenes, n_demos = 9, objects detected anew [s]",
        "at most 15",
    ),
    "repair_ms": ("one repair of 1,000 searched at once, objects known [ms]", "at most 2"),
    "repair_ms_perceived": ("the same with detecting the objects in 100 images [ms]", ""),
    "curve_over_parabola": (
        "1,000 polylines of 200 points judged: times 1,000 parabolas",
        "at most 1.5",
    ),
    "repair_speedup_one_by_one": ("1,000 at once: times one start at a time", ""),
    "detect_ms": ("detecting the objects in one image [ms]", ""),
    "scenes_per_second": ("scenes rendered a second", ""),
    "render_speedup_composite": ("rendering: times compositing without light at four times the size", ""),
    "import_processor_s_sqlite3_1_gb": ("importing a ROS bag of 1.1 GB, sqlite3: processor time [s]", "at most 30"),
    "import_gib_sqlite3_1_gb": ("the same: memory at its peak, the libraries among it [GiB]", ""),
    "import_gib_sqlite3_100_mb": ("the same with a bag of .1 GB", ""),
    "import_processor_s_mcap_1_gb": ("importing a ROS bag of 1.1 GB, mcap: processor time [s]", "at most 30"),
    "import_gib_mcap_1_gb": ("the same: memory at its peak, the libraries among it [GiB]", ""),
    "import_gib_mcap_100_mb": ("the same with a bag of .1 GB", ""),
    "sweep_job_s_bare_loop": ("a job whose stages are all cached, in a bare loop over `dvc repro` [s]", ""),
    "sweep_job_s_basic": ("the same in a sweep, one job after the other, start and summary included [s]", ""),
    "sweep_job_s_joblib": ("the same by joblib, as many jobs at once as there are cores [s]", ""),
    "sweep_job_s_ray": ("the same by Ray on this machine, its start included [s]", ""),
    "sweep_job_s_submitit_local": ("the same by submitit, a process for each job [s]", ""),
}
WAYS = {
    "rows": "one row per (image, path), eager",
    "eager": "each scene encoded once, eager",
    "stacked": "several models in vector registers",
}
SWEPT = ("scenes", "demos", "train@", "irl@", "clearance@", "evaluate", "repair", "intervene")  # stages of a setting
SETTINGS, CORES = 100, (1, 2, 16, 100, 256)
UNITS = {"n_demos": "demonstrations a scene", "scenes": "training scenes", "models": "models (seeds x users)"}


def main(benchmarks: Path, repro: Path) -> None:
    """Write all files from the benchmarks' json and, if it exists, bench.repro's."""
    measured = json.loads(benchmarks.read_text(encoding="utf-8"))
    growth: dict = {}
    before = json.loads((HERE / "results.json").read_text(encoding="utf-8"))["commands"]
    commands = {name: row for name, row in before.items() if name.startswith("sealed")}  # measured once, by hand
    commands |= json.loads(repro.read_text(encoding="utf-8")) if repro.is_file() else {}
    results = {"machine": machine(measured), "growth": growth, "commands": commands}
    for run in measured["benchmarks"]:
        results |= run["extra_info"].get("results", {})
        growth |= run["extra_info"].get("growth", {})
    rounded = json.loads(json.dumps(results), parse_float=lambda text: float(f"{float(text):.4g}"))
    (HERE / "results.json").write_text(json.dumps(rounded, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    _growth(growth).savefig(HERE / "growth.svg")
    graphs = (commands.get(name, {}) for name in ("repro", "studies"))
    if stages := {name: minutes for graph in graphs for name, minutes in graph.get("stages", {}).items()}:
        _stages(stages).savefig(HERE / "repro.svg")
    (HERE / "README.md").write_text(page(results), encoding="utf-8")


def scaling(results: dict) -> list[dict[str, float]]:
    """Return, for each of CORES, how long SETTINGS settings of the paper's grid take on paper, and the speed-up.

    A job is a setting with all of its training sets, on one core. Its work is that of `make repro`, both of whose
    processes count as busy throughout; a launcher adds its overhead. No stage is shared.
    """
    stages = results["commands"]["repro"]["stages"]
    minutes = 2 * sum(minutes for name, minutes in stages.items() if name.startswith(SWEPT))
    job = minutes / 60 + results["sweep_job_s_ray"] / 3600
    return [
        {"cores": cores, "jobs": min(cores, SETTINGS), "hours": hours, "speedup": SETTINGS * job / hours}
        for cores in CORES
        for hours in [math.ceil(SETTINGS / cores) * job]
    ]


def machine(measured: dict) -> dict[str, str | int]:
    """Return the commit of which the figures are, and their machine, from what pytest-benchmark says."""
    info = measured["machine_info"]
    cpu, flags = info["cpu"], info["cpu"].get("flags", [])
    return {
        "commit": measured["commit_info"]["id"][:8],
        "processor": cpu.get("brand_raw", info["processor"]),
        "cores": cpu["count"],
        "vectors": "AVX-512" if "avx512f" in flags else "AVX2" if "avx2" in flags else "unknown",
        "python": info["python_version"],
        "torch": torch.__version__,
    }


def page(results: dict) -> str:
    """Return the text of bench/README.md."""
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters |= {"number": _number, "reached": _reached}
    template = environment.from_string((HERE / "page.md.j2").read_text(encoding="utf-8"))
    known = "repro" in results["commands"] and "sweep_job_s_ray" in results
    grid = scaling(results) if known else []
    return template.render(results=results, aims=AIMS, ways=WAYS, commands=COMMANDS, grid=grid, settings=SETTINGS)


def _growth(growth: dict) -> Figure:
    figure = Figure((9, 2.8), layout="constrained")
    for ax, (axis, points) in zip(figure.subplots(1, len(growth), squeeze=False)[0], growth.items(), strict=True):
        x, y = [float(value) for value in points], list(points.values())
        ax.plot(x, y, "o-", color="#0072B2")
        ax.plot(x, [y[0] * value / x[0] for value in x], "--", color="0.5", lw=1)
        ax.set(xlabel=UNITS[axis], xlim=(0, None), ylim=(0, 1.15 * max(y)), xticks=x)
        ax.set_title(f"growth with {axis}", loc="left", fontsize=10)
    figure.axes[0].set_ylabel("ms a step, all models")
    return figure


def _stages(minutes: dict[str, float]) -> Figure:
    figure = Figure((7, 0.32 * len(minutes) + 0.8), layout="constrained")
    ax = figure.subplots()
    bars = ax.barh(list(minutes), list(minutes.values()), color="#0072B2")
    ax.bar_label(bars, fmt="%.1f", padding=3)
    ax.invert_yaxis()
    ax.set_xlabel("minutes, two processes of one thread")
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _reached(value: float, aim: str) -> str:
    """Return yes or no for an aim that begins with "at least" or "at most", and nothing without an aim."""
    if not (stated := re.match(r"at (least|most) ([\d.]+)", aim)):
        return ""
    bound = float(stated[2])
    return "yes" if (value >= bound if stated[1] == "least" else value <= bound) else "**no**"


def _number(value: float) -> str:
    """Return a number with three significant digits."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


if __name__ == "__main__":
    if len(sys.argv) != 3 or not Path(sys.argv[1]).is_file():
        sys.exit(f"{__doc__}\nBENCHMARKS.json is what `python -m pytest bench --benchmark-json=BENCHMARKS.json` wrote.")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
