"""Compare a training step at 9 demonstrations: models in lanes, eager torch, and one row per (image, path)."""

import pytest

from bench.passes import STEPS, VARIANTS, WAYS, fastest, memory, operations, peak
from pipeline.training.vae.engines.simd_kernels import LANES


@pytest.mark.benchmark(group="training pass, n = 9")
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_pass_in_three_ways(benchmark, variant):
    weights = VARIANTS[variant]
    way, passes = WAYS["stacked"]
    benchmark.pedantic(way(weights), rounds=5, warmup_rounds=1)
    seconds = {"stacked": benchmark.stats.stats.min / passes}
    seconds |= {name: fastest(WAYS[name][0](weights), 3) / WAYS[name][1] for name in ("eager", "rows")}
    needed, limit = operations(weights), peak()
    suffix = "" if variant == "full" else f"_{variant}"
    results = {f"train_ms_{name}": value * 1e3 for name, value in seconds.items()}
    results |= {f"train_gib_{name}": memory(name, variant) / (LANES if name == "stacked" else 1) for name in WAYS}
    results |= {
        "train_speedup_rows": seconds["rows"] / seconds["stacked"],
        "train_speedup_best_eager": seconds["eager"] / seconds["stacked"],
        "fma_peak_gflops": limit / 1e9,
    }
    results |= {f"fma_peak_share_{name}": needed / value / limit for name, value in seconds.items()}
    benchmark.extra_info["results"] = {name + suffix: value for name, value in results.items()}
    assert results["train_speedup_rows"] > 10 and results["train_speedup_best_eager"] > 1.5, results


@pytest.mark.benchmark(group="growth of a training pass")
@pytest.mark.parametrize(
    ("axis", "values"),
    [
        ("n_demos", [1, 3, 5, 7, 9]),
        ("scenes", [5, 10, 20, 40]),
        ("models", [LANES * stacks for stacks in (1, 2, 3, 4)]),
    ],
)
def test_how_the_cost_grows(benchmark, axis, values):
    """Measure milliseconds per step of all models together, alternating, since a machine's speed fluctuates."""
    fits = {value: WAYS["stacked"][0](VARIANTS["full"], **{axis: value}) for value in values}
    rounds = [{value: fastest(fit, 1) for value, fit in fits.items()} for _ in range(3)]
    points = {value: min(seconds[value] for seconds in rounds) / STEPS * 1e3 for value in values}
    benchmark.pedantic(fits[values[-1]], rounds=1)
    benchmark.extra_info["growth"] = {axis: points}
    first, last = points[values[0]], points[values[-1]]
    assert last / first < 1.2 * values[-1] / values[0], f"{axis}: worse than linear, {points}"
