"""Facts about training in lanes: the gradient of Eq. 1, and the same bits whatever else is in the stack."""

import copy
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import torch
from llvmlite.binding import get_host_cpu_features

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import equation_1
from pipeline.training.loop import Checkpoints, Schedule, pad_demonstrations
from pipeline.training.vae.engines import fit_batch
from pipeline.training.vae.engines import simd_kernels as lanes
from pipeline.training.vae.engines.simd import Stack, fit_stack
from pipeline.training.vae.engines.simd_kernels import LANES
from tests.factories import WEIGHTS, noise_demos, vae

SHORT = Schedule(steps=6, rate=2e-3, weight_decay=0.01, curve_every=4)
ROOT = Path(__file__).resolve().parents[4]
MIXED = [9, 1, 7, 3, 5, 2, 9, 1]
SHAPES = {"paper": {}, "other": {"latent": 5, "channels": [6, 7], "hidden": 9}}


def with_small_logits(seed: int, shape: str) -> BetaVae:
    """An untrained model with torch's own initial weights: all logits are near 0, so no gradient of a bias cancels."""
    model = vae(seed, **SHAPES[shape])
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for layer in model.modules():
            if isinstance(layer, torch.nn.Linear | torch.nn.Conv2d | torch.nn.ConvTranspose2d):
                layer.reset_parameters()
    return model


def stacked(seeds, variant: str = "full", n: Sequence[int] = (4,) * LANES):
    """A model for each of the seeds, on its n, trained together; and their learning curves."""
    models = [vae(seed) for seed in seeds]
    images, z_theta, valid = zip(*(noise_demos(seed, n=own) for seed, own in zip(seeds, n, strict=False)), strict=True)
    return models, fit_stack(models, images, z_theta, valid, WEIGHTS[variant], SHORT, seeds)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "shape", "n_demos"),
    [("full", "paper", [9]), ("full", "other", MIXED), ("ae", "paper", MIXED), ("classifier", "other", [9])],
)
def test_gradient_is_that_of_equation_1_in_double_precision(variant, shape, n_demos):
    models, n_demos = [with_small_logits(seed, shape) for seed in range(LANES)], (n_demos * LANES)[:LANES]
    images, z_theta, valid = zip(*(noise_demos(lane, 20, n_demos[lane]) for lane in range(LANES)), strict=True)
    images, z_theta, valid = (np.stack(a, -1) for a in (images, pad_demonstrations(z_theta), pad_demonstrations(valid)))
    for lane, model in enumerate(models):
        model.standardise(images[..., lane])
        model.decode[-2].get_parameter("bias").detach().zero_()  # at the mean colour its gradient cancels
    noise = np.random.default_rng(0).standard_normal((20, models[0].latent, LANES)).astype(np.float32)
    stack = Stack(models, WEIGHTS[variant], n_demos, scenes=20)
    terms = stack.gradient(images, ((z_theta - Z_CENTRE) / Z_SCALE).astype(np.float32), valid, noise)
    gradients = dict(stack.tensors("gradient"))
    for lane, model in list(enumerate(models))[::3]:
        exact = copy.deepcopy(model).double()
        x = torch.from_numpy(images[..., lane]).permute(0, 3, 1, 2).double() / 255
        own = (z_theta[:, : n_demos[lane], :, lane], valid[:, : n_demos[lane], lane], noise[..., lane])
        z, labels, own_noise = (torch.from_numpy(array).double() for array in own)
        loss = equation_1(exact, x, z, labels, WEIGHTS[variant], own_noise)
        loss.total.backward()
        np.testing.assert_allclose(terms[:, lane], [float(term.detach()) for term in loss], rtol=2e-6, atol=1e-9)
        for name, parameter in exact.named_parameters():
            if parameter.grad is None:
                assert name not in gradients
            else:
                wanted = parameter.grad.numpy().reshape(gradients[name].shape[:-1])
                error = np.linalg.norm(gradients[name][..., lane] - wanted) / np.linalg.norm(wanted)
                assert error < 1e-6, f"{name} of lane {lane}: {error:.1e}"


def test_a_step_is_that_of_the_autograd_engine_and_constants_stand_beside():
    once = Schedule(steps=4, rate=2e-3, weight_decay=0.01, curve_every=1)
    ours, theirs, checkpoints = [vae(1), vae(2)], [vae(1), vae(2)], [Checkpoints([0, 2]), Checkpoints([0, 2])]
    images, z_theta, valid = zip(noise_demos(1), noise_demos(2, n=2), strict=True)
    arguments = images, z_theta, (valid[0], np.ones_like(valid[1])), WEIGHTS["full"], once, [7, 8]
    curves = fit_stack(ours, *arguments, checkpoints[0]), fit_batch(theirs, *arguments, checkpoints[1])
    for i, (model, other) in enumerate(zip(ours, theirs, strict=True)):
        np.testing.assert_allclose(curves[0][i], curves[1][i], rtol=1e-4, atol=1e-7)
        kept, wanted = (of.of(one) for of, one in zip(checkpoints, (model, other), strict=True))
        assert list(kept) == list(wanted) == ([0, 2] if i == 0 else [])  # a constant is not trained
        states = [*kept.values(), model.state_dict()], [*wanted.values(), other.state_dict()]
        for state, its_state in zip(*states, strict=True):
            for name, value in its_state.items():
                np.testing.assert_allclose(state[name], value, rtol=0, atol=2e-4)  # rate x steps is 8e-3


@pytest.mark.parametrize("variant", WEIGHTS)
def test_a_model_is_the_same_bits_whatever_else_is_in_the_stack(variant):
    alone, (curve,) = stacked([3], variant, [3])
    some, curves = stacked([5, 3], variant, [1, 3])
    many, more_curves = stacked(list(range(LANES))[::-1], variant, [9] * (LANES - 4) + [3, 1, 7, 2])
    for other, its_curve in ((some[1], curves[1]), (many[-4], more_curves[-4])):
        assert digest(other) == digest(alone[0])
        assert its_curve.tobytes() == curve.tobytes()
    assert digest(many[0]) != digest(many[1])


@pytest.mark.slow  # compiles the kernels
@pytest.mark.skipif("avx512vl" not in lanes.FEATURES, reason="needs a processor with AVX-512")
def test_a_model_is_the_same_bits_in_8_lanes_and_in_16(tmp_path):
    features = get_host_cpu_features()
    wide = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": features.flatten()}
    narrow = [("-" if name.startswith("avx512") or not has else "+") + name for name, has in features.items()]
    other = {"NUMBA_CPU_FEATURES": ",".join(narrow)} if LANES == 16 else wide
    code = (
        "import torch; from tests.training.vae.engines.test_simd import LANES, digest, stacked; "
        "torch.set_num_threads(1); print(LANES, digest(stacked([3])[0][0]))"
    )
    there = {"cwd": ROOT, "env": os.environ | other | {"NUMBA_CACHE_DIR": str(tmp_path)}, "timeout": 600}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, **there)
    assert done.stdout.strip() == f"{24 - LANES} {digest(stacked([3])[0][0])}"


@pytest.mark.slow  # compiles the kernels
@pytest.mark.skipif(os.getuid() != 0 or not shutil.which("setpriv"), reason="needs root and setpriv")
def test_a_person_without_a_writable_home_trains_in_a_checkout_of_others(tmp_path):
    """As an installation that an administrator made."""
    other = ["setpriv", "--reuid=65534", "--clear-groups"]
    place = {"HOME": "/proc", "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    tmp_path.chmod(0o777)
    for parent in tmp_path.parents[:-2]:  # but / and /tmp
        parent.chmod(0o755)
    code = "from pipeline.training.vae.engines import simd_kernels as k; print(k._FOLDER.name)"
    env = {"PATH": os.environ["PATH"], **place}
    ended = subprocess.run([*other, sys.executable, "-c", code], cwd="/", env=env, capture_output=True, text=True)
    assert ended.stdout.startswith(str(tmp_path)), ended.stderr
    assert not list(tmp_path.iterdir())


def digest(model: BetaVae) -> str:
    """Of every weight's bits."""
    return sha256(b"".join(value.numpy().tobytes() for value in model.state_dict().values())).hexdigest()
