"""The library's front door: the documented example, what it promises, and what it refuses."""

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student
from scipy.stats import ttest_1samp

import pipeline
from pipeline import library
from pipeline.models.curves import resample
from pipeline.perception.objects import FEATURES, Object, Objects
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import bezier, random_z_theta
from pipeline.world.layout import Layouts
from pipeline.world.rules import clearance
from tests.factories import RED, WHITE, as_controls, composed, draw_table

SCENES, PATHS, MARGIN = 12, 9, 0.04


def scenes(rng: np.random.Generator, count: int, *, item: bool) -> tuple[np.ndarray, Layouts]:
    """Draw tables with a white disc each and, with an `item`, a red one."""
    centre = np.stack([rng.uniform((0.55, 0.12), (0.88, 0.45), (count, 2)), np.full((count, 2), (0.3, 0.7))], 1)
    shape = (count, 2)
    layouts = Layouts(
        item=np.zeros(shape, int), symbol=np.zeros(shape, int), centre=centre, angle=np.zeros(shape),
        scale=np.ones(shape), half_length=np.zeros(shape), radius=np.tile([0.045, 0.075], (count, 1)),
    )  # fmt: skip
    discs = [[(*a, 0.045, WHITE), (*b, 0.075, RED)][: 1 + item] for a, b in centre]
    return np.stack([draw_table(*d, seed=i) for i, d in enumerate(discs)]), layouts


@pytest.fixture(scope="module")
def example():
    """Images with and without the red disc, paths, and labels of a user who keeps away from everything."""
    images, layouts = scenes(np.random.default_rng(0), SCENES, item=True)
    images_without, _ = scenes(np.random.default_rng(0), SCENES, item=False)
    z_theta = random_z_theta(np.random.default_rng(1), SCENES, PATHS)
    return images, images_without, z_theta, clearance(layouts, z_theta).min(-1) > MARGIN


@pytest.mark.slow
def test_the_example_of_docs_library(example, tmp_path, monkeypatch):
    monkeypatch.setitem(library.TRAINING["clearance"], "steps", 250)
    images, images_without, z_theta, valid = example
    model = pipeline.fit(images, z_theta, valid, variant="clearance", seed=0)
    p = model.probability(images, z_theta)
    assert p.shape == valid.shape and ((p > 0.5) == valid).mean() > 0.9
    ends = pipeline.repair(model, images, z_theta)
    accepted = np.isfinite(ends).all(-1)
    assert accepted.mean() > 0.8
    p_ends = model.probability(images, np.nan_to_num(ends))
    assert (p_ends[accepted] > 0.799).all()
    assert np.array_equal(ends[p > 0.801], z_theta[p > 0.801])  # accepted paths stay
    effect = pipeline.effect(model, images_without, images, z_theta)
    assert effect.interval[0] < effect.estimate < effect.interval[1] < 0 and effect.verdict == "effect"
    assert effect.p < 0.05
    pipeline.save(model, tmp_path / "model.safetensors")
    again = pipeline.load(tmp_path / "model.safetensors")
    assert np.array_equal(again.probability(images, z_theta), p)


@pytest.mark.slow
def test_repaired_curves_are_accepted_as_they_come_back_and_keep_their_ends(example, monkeypatch):
    monkeypatch.setitem(library.TRAINING["clearance"], "steps", 250)
    images, _, z_theta, valid = (array[:6] for array in example)
    points = bezier(as_controls(z_theta), 80)
    model = pipeline.fit(images, points, valid)
    through = np.broadcast_to([[0.08, 0.7], [0.92, 0.7]], (6, 1, 2, 2)).copy()  # the red disc
    found = []
    for starts in (points, resample(torch.from_numpy(through), 80).numpy(), through):
        ends = pipeline.repair(model, images, starts)
        accepted = np.isfinite(ends).all((-1, -2))
        assert ends.shape == starts.shape
        assert (model.probability(images, np.nan_to_num(ends))[accepted] > library.ACCEPTED_ABOVE - 1e-3).all()
        np.testing.assert_allclose(ends[accepted][:, [0, -1]], starts[accepted][:, [0, -1]], atol=1e-6)
        found.append(accepted.mean())
    assert found[0] > 0.8 and found[1] > 0.5 and found[2] == 0, "two points cannot go round anything"


@contextmanager
def set_by(setter, value, before):
    setter(value)
    try:
        yield
    finally:
        setter(before)


SURROUNDINGS = {  # of a caller
    "no_grad": torch.no_grad,
    "inference": torch.inference_mode,
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "float64": lambda: set_by(torch.set_default_dtype, torch.float64, torch.float32),
    "bfloat16": lambda: set_by(torch.set_default_dtype, torch.bfloat16, torch.float32),
    "device": lambda: torch.device("meta"),
    "default device": lambda: set_by(torch.set_default_device, "meta", None),
    "threads": lambda: set_by(torch.set_num_threads, 3, torch.get_num_threads()),
    "precision": lambda: set_by(torch.set_float32_matmul_precision, "medium", "highest"),
    "new precision": lambda: set_by(partial(setattr, library.mkldnn.matmul, "fp32_precision"), "bf16", "ieee"),
    "errors": lambda: np.errstate(all="raise"),
}


def state() -> tuple:
    """What a caller can see of torch and NumPy."""
    modes = torch.is_grad_enabled(), torch.is_inference_mode_enabled(), torch.is_autocast_enabled("cpu")
    numbers = torch.get_default_dtype(), str(torch.get_default_device()), library.mkldnn.matmul.fp32_precision
    random = torch.default_generator.get_state().numpy().tobytes(), pickle.dumps(np.random.get_state())  # noqa: NPY002
    return *modes, *numbers, *random, torch.get_num_threads(), str(np.geterr())


@pytest.fixture
def few(example, monkeypatch):
    """Two scenes, and fits of three steps."""
    for stage, steps in (("clearance", 3), ("train", 3), ("irl", {"maxent": 3, "ranked": 3})):
        monkeypatch.setitem(library.TRAINING[stage], "steps", steps)
    monkeypatch.setitem(library.TRAINING["irl"], "n_augmentations", 2)
    return [array[:2] for array in example]


def all_results(data, variant: str, folder: Path) -> list:
    """What every public function makes of images with and without the item, paths and labels."""
    images, images_without, z_theta, valid = data
    model = pipeline.fit(images, z_theta, valid, variant=variant)
    pipeline.save(model, folder / "model.safetensors")
    again = pipeline.load(folder / "model.safetensors")
    repaired = pipeline.repair(again, images, z_theta)
    effect = pipeline.effect(model, images_without, images, z_theta)
    return [(folder / "model.safetensors").read_bytes(), repaired.tobytes(), effect]


def assert_undisturbed(names, seed: int, expected: list, *arguments) -> None:
    """All results under these surroundings are the expected ones, and the surroundings stay."""
    torch.manual_seed(seed)
    with ExitStack() as around:
        for name in names:
            around.enter_context(SURROUNDINGS[name]())
        before = state()
        assert all_results(*arguments) == expected
        assert state() == before


@pytest.mark.slow
def test_the_callers_torch_changes_no_result_and_stays_as_it_was(few, tmp_path):
    expected = all_results(few, "clearance", tmp_path)

    @settings(max_examples=8, deadline=None, database=None)
    @given(st.lists(st.sampled_from(list(SURROUNDINGS)), unique=True, min_size=1), st.integers(0, 99))
    def draw(names: list[str], seed: int):
        assert_undisturbed(names, seed, expected, few, "clearance", tmp_path)

    draw()


@pytest.mark.parametrize("variant", ["irl_ranked", "full"])
def test_nor_do_all_surroundings_at_once_whatever_the_variant(few, variant: str, tmp_path):
    expected = all_results(few, variant, tmp_path)
    assert_undisturbed(SURROUNDINGS, 1, expected, few, variant, tmp_path)


@pytest.mark.parametrize("variant", library.SETTINGS)
def test_a_models_probability_does_not_depend_on_the_callers_torch(few, variant: str):
    images, _, z_theta, valid = few
    model = pipeline.fit(images, z_theta, valid, variant=variant)
    expected = model.probability(images, z_theta)
    for name in SURROUNDINGS:
        with SURROUNDINGS[name]():
            p = model.probability(images, z_theta)
        np.testing.assert_allclose(p, expected, atol=1e-6, err_msg=name)  # threads change the order of sums


def weights(data, variant: str = "irl_ranked") -> list[bytes]:
    images, _, z_theta, valid = data
    return [w.numpy().tobytes() for w in pipeline.fit(images, z_theta, valid, variant=variant).state_dict().values()]


def test_fits_in_threads_do_not_mix_and_a_process_forked_meanwhile_does_not_wait_for_ever(few):
    expected, before = weights(few), state()
    with ThreadPoolExecutor(4) as pool:
        fits = [pool.submit(weights, few) for _ in range(4)]
        with get_context("fork").Pool(1) as child:
            assert child.apply_async(weights, [few]).get(timeout=60) == expected
        assert [fit.result() for fit in fits] == [expected] * 4
    assert state() == before


def test_a_fit_has_one_thread_and_shows_its_progress_on_request(few, monkeypatch, capfd):
    counts, keep = [], library._Bar.keep
    monkeypatch.setattr(library._Bar, "keep", lambda *a: (counts.append(torch.get_num_threads()), keep(*a)))
    images, _, z_theta, valid = few
    pipeline.fit(images, z_theta, valid)
    assert set(counts) == {1} and not capfd.readouterr().err
    pipeline.fit(images, z_theta, valid, progress=True)
    assert "3/3" in capfd.readouterr().err


@pytest.mark.parametrize("variant", ["clearance", "full", "irl_ranked"])
@pytest.mark.filterwarnings("error")
def test_reversed_and_read_only_arrays_are_read_as_any_others(few, variant: str, tmp_path):
    turned = [array[::-1] for array in few]
    expected = all_results([array.copy() for array in turned], variant, tmp_path)
    for array in turned:
        array.flags.writeable = False
    assert all_results(turned, variant, tmp_path) == expected


def test_one_model_is_a_t_test_over_scenes_corrected_for_skewness(example, monkeypatch):
    images, images_without, z_theta, _ = example
    model = library.build({"kind": "vae", "model": library.VAE}, 0)
    monkeypatch.setattr(library, "INFORMATIVE_CHANGE", 0.0)  # an untrained model hardly changes its answer
    effect = pipeline.effect(model, images_without, images, z_theta)
    change = (model.probability(images, z_theta) - model.probability(images_without, z_theta)).astype(float).mean(-1)
    skewness = ((change - change.mean()) ** 3).mean() / change.std(ddof=1) ** 3 / SCENES**0.5
    for bound, low in ((0.0, 0.5 * effect.p), (effect.interval[0], 0.025), (effect.interval[1], 0.025)):
        t = ttest_1samp(change, bound).statistic
        transformed = ((1 + skewness * t / 3) ** 3 - 1) / skewness + skewness / 6  # Hall (1992)
        assert student.sf(abs(transformed), SCENES - 1) == pytest.approx(low, rel=1e-3)


@pytest.mark.parametrize("count", [2, 5])
def test_five_scenes_prove_no_effect_however_alike_their_changes_are(example, monkeypatch, count: int):
    images, images_without, z_theta, _ = (array[:count] for array in example)
    model = library.build({"kind": "vae", "model": library.VAE}, 0)
    changes = iter([np.full((count, PATHS), p) + 0.001 * np.arange(count)[:, None] ** p for p in (0.2, 0.7)])
    monkeypatch.setattr(type(model), "probability", lambda *_: next(changes))
    effect = pipeline.effect(model, images_without, images, z_theta)
    assert effect.p == 1 and effect.verdict == "undecided" and effect.interval == pytest.approx((-1, 1))


def test_settings_are_those_of_conf():
    cfg = composed()
    unread = {"n_demos", "compared"}  # by fits
    conf = {name: {k: v for k, v in of.items() if k not in unread} for name, of in cfg.variants.items()}
    assert conf == library.SETTINGS
    assert cfg.irl == library.TRAINING["irl"] and cfg.clearance == library.TRAINING["clearance"]
    assert {name: value for name, value in cfg.train.items() if name != "model"} == library.TRAINING["train"]
    assert {name: cfg.repair[name] for name in library.REPAIR} == library.REPAIR


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a | {"images": a["images"] / 255}, r"images are float64 .* expected uint8 .* scale intensities"),
        (lambda a: a | {"paths": a["paths"] * 100}, r"paths reaches 1\d\d: expected metres"),
        (lambda a: a | {"paths": a["paths"][:3]}, r"paths has shape \(3, 9, 2\): expected \(12, path, 2\)"),
        (lambda a: {name: array[:1] for name, array in a.items()}, "number of scenes is 1: expected at least 2"),
        (lambda a: a | {"images": 0 * a["images"]}, r"images\[0\] is mostly black: expected the image of a table"),
        (lambda a: a | {"valid": a["valid"].astype(float)}, r"valid is float64 of shape \(12, 9\): expected bool"),
        *(
            (lambda a, name=name: a | {name: np.ma.masked_array(a[name])}, rf"{name} is MaskedArray.*: expected")
            for name in ("images", "paths", "valid")
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_what_was_expected(example, change, message):
    images, _, z_theta, valid = example
    with pytest.raises(InputError, match=message):
        pipeline.fit(**change({"images": images, "paths": z_theta, "valid": valid}))


ONE = Object(np.full((2, 2), 0.5), 0.05, np.zeros(len(FEATURES)), np.zeros(0, np.float32))
TOLD = Objects.of([[ONE, ONE]] * SCENES, [0.0] * SCENES, 0)


@pytest.mark.parametrize(
    ("objects", "variant", "message"),
    [
        (TOLD, "full", "variant full sees pictures alone"),
        (TOLD, "irl_ranked", "variant irl_ranked sees pictures alone"),
        (replace(TOLD, present=np.roll(TOLD.present, 1, axis=1)), "clearance", "gaps before present objects"),
        (replace(TOLD, features=TOLD.features * np.nan), "clearance", "not finite"),
    ],
)
def test_told_objects_that_no_model_could_read_are_refused(example, objects: Objects, variant: str, message: str):
    with pytest.raises(InputError, match=message):
        pipeline.fit(objects, *example[2:], variant=variant)


def test_maximum_entropy_takes_the_papers_paths_alone(example):
    with pytest.raises(InputError, match="irl_maxent takes z_theta"):
        pipeline.fit(example[0], np.repeat(example[2][:, :, None], 2, axis=2), example[3], variant="irl_maxent")


def test_a_caller_who_set_torch_before_the_first_use_gets_the_same(few, tmp_path):
    np.savez(tmp_path / "few.npz", *few)
    code = """
import sys, numpy as np, torch
if sys.argv[1] == "set":
    torch.set_default_dtype(torch.float64)
    torch.inference_mode().__enter__()
import pipeline
pipeline.Effect
from pipeline import library
library.TRAINING["clearance"]["steps"] = 3
images, _, paths, valid = np.load("few.npz").values()
pipeline.save(pipeline.fit(images, paths, valid), "model")
print(pipeline.load("model").probability(images, paths).tobytes().hex())
"""
    runs = [
        subprocess.run([sys.executable, "-c", code, how], cwd=tmp_path, capture_output=True, text=True, timeout=300)
        for how in ("as it is", "set")
    ]
    assert runs[0].stdout and runs[0].stdout == runs[1].stdout, runs[1].stderr[-2000:]
    model = "import torch, numpy as np, pipeline; torch.set_default_dtype(torch.float64); m = pipeline.load('model');"
    model += "print(m.probability(np.load('few.npz')['arr_0'], np.load('few.npz')['arr_2']).tobytes().hex())"
    fresh = subprocess.run([sys.executable, "-c", model], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert fresh.stdout == runs[0].stdout, fresh.stderr[-2000:]


def test_parameters_are_read_without_torch():
    code = "import sys, pipeline; assert 'torch' not in sys.modules and not hasattr(pipeline, 'nothing')"
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[1], check=True, timeout=60)
