"""The library interface: fit a model of one user's valid paths, repair paths, and estimate the effect of an item.

All functions take and return arrays. SETTINGS are those of the paper's experiment (conf/); tests check that they agree.
Results do not depend on the caller's torch, and leave it as it was (`undisturbed`).
"""

import json
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import fields
from functools import partial
from pathlib import Path
from threading import RLock
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy import ndarray as Array
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from scipy.stats import beta
from threadpoolctl import ThreadpoolController
from torch.backends import mkldnn as _mkldnn
from tqdm import tqdm

from pipeline.models.base import ValidityModel, check_images, check_paths, is_array
from pipeline.models.curves import resample
from pipeline.models.trained import build, read_weights
from pipeline.perception.objects import Objects
from pipeline.perception.segmenter import read_segmenter
from pipeline.planning.bumps import POINTS, basis, nearest
from pipeline.planning.nearest import by_model
from pipeline.planning.repair import Ascent
from pipeline.planning.repair import repair as climb
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write
from pipeline.stats.crossed import estimate
from pipeline.stats.tests import MIN_PAIRS, verdict
from pipeline.training.loop import Checkpoints, need_finite
from pipeline.training.trainers import trainer
from pipeline.world.bezier import Z_HIGH, Z_LOW

VAE = {"latent": 15, "channels": [16, 8, 4], "hidden": 64}  # train.model in conf/train.yaml
REWARD_MAP = {"channels": 16, "dilated": 3, "gain": 10.0, "lattice_side": 12}
IRL = {"stage": "irl", "kind": "reward"}
SETTINGS: dict[str, dict[str, Any]] = {  # conf/variants
    "full": {"stage": "train", "kind": "vae", "alpha": 100.0, "beta": 0.002, "gamma": 6.0, "model": VAE},
    "ae": {"stage": "train", "kind": "vae", "alpha": 100.0, "beta": 0.0, "gamma": 6.0, "model": VAE},
    "classifier": {"stage": "train", "kind": "vae", "alpha": 0.0, "beta": 0.0, "gamma": 1.0, "model": VAE},
    "irl_maxent": IRL | {"objective": "maxent", "model": {**REWARD_MAP, "dropout": 0.5}},
    "irl_ranked": IRL | {"objective": "ranked", "model": {**REWARD_MAP, "dropout": 0.3}},
    "clearance": {"stage": "clearance", "kind": "clearance", "model": {"members": 8, "kinds": 6}},
}
TRAINING: dict[str, dict[str, Any]] = {  # conf/train, conf/irl and conf/clearance
    "train": {
        "steps": 500, "rate": 0.01, "weight_decay": 0.01, "adam_beta2": 0.99, "curve_every": 10, "engine": "simd",
    },
    "irl": {
        "steps": {"maxent": 150, "ranked": 200},
        "rate": 0.018, "weight_decay": 0.0001, "scenes_per_step": 20, "n_augmentations": 12, "curve_every": 10,
        "color_jitter": {"hue": 0.3, "gain": 0.15, "shift": 0.01, "scene_gain": 0.1, "other_table": 0.67},
    },
    "clearance": {"steps": 1000, "rate": 0.03, "weight_decay": 0.0, "curve_every": 10},
}  # fmt: skip
REPAIR: dict[str, Any] = {"steps": 30, "optimiser": "adam", "rate": 0.5}  # conf/repair.yaml
INFORMATIVE_SCENES, INFORMATIVE_CHANGE = 20, 0.01  # see `effect`
CURVE_POINTS = 5  # points along a curve that the paper's model reads
CURVE_PENALTY = 0.9  # gain in log P(valid) that a repair requires per metre along a curve (conf/studies/curves.yaml)
ACCEPTED_ABOVE = 0.8  # P(valid) above which `repair` accepts a path: odds of 4 to 1


_lock = RLock()  # the state below belongs to the whole process: fits in several threads would mix theirs
os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
mkldnn: Any = _mkldnn  # whose attributes pyright does not know
_pools = ThreadpoolController()  # of BLAS, looked up once: it takes 20 ms
STATE: tuple[tuple[Callable[[], Any], Callable[[Any], object], Any], ...] = (  # how to get it, to set it, and to what
    (torch.get_default_dtype, torch.set_default_dtype, torch.float32),
    (torch.get_num_threads, torch.set_num_threads, 1),  # more are slower here, and change the order of sums
    (cv2.getNumThreads, cv2.setNumThreads, 1),
    *(  # other kernels round otherwise
        (partial(getattr, of, name), partial(setattr, of, name), value)
        for of, name, value in ((mkldnn, "enabled", True), (mkldnn.matmul, "fp32_precision", "ieee"))
    ),
)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Give torch and NumPy the state of a fresh process with one thread; then restore the caller's.

    Covers gradient and inference mode, autocast, default dtype and device, random state, and errors that NumPy raises.
    """
    elsewhere = torch.get_default_device().type != "cpu"  # a device's context makes a fit a third slower
    with (
        _lock,
        torch.device("cpu") if elsewhere else nullcontext(),
        torch.inference_mode(False),  # turns gradients on, too
        torch.autocast("cpu", enabled=False),
        torch.random.fork_rng(devices=[]),  # nothing here draws from a GPU's generator
        np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"),
        _pools.limit(limits=1),
        ExitStack() as caller,
    ):
        for get, put, value in STATE:
            caller.callback(put, get())
            put(value)
        yield


class _Bar(Checkpoints):
    """A progress bar that the training loop moves, as it calls `keep` before each step."""

    def __init__(self, steps: int, shown: bool):
        super().__init__()
        self.bar = tqdm(total=steps, desc="fit", disable=not shown)

    def keep(self, models: Sequence[Any], update: Callable[[], object], step: int) -> None:
        self.bar.update()


class Effect(NamedTuple):
    """The average causal effect of an item on the validity of paths (paper, second inequality)."""

    estimate: float  # change in E[V], the mean P(valid) over paths, averaged over scenes and models
    interval: tuple[float, float]  # 95 % confidence interval
    p: float  # two-sided p-value of no effect
    verdict: str  # "effect", "negligible", "present" or "undecided" (pipeline.stats.tests.verdict)


@undisturbed()
def fit(
    images: Array | Objects,
    paths: Array,
    valid: Array,
    variant: str = "clearance",
    seed: int = 0,
    progress: bool = False,
) -> ValidityModel:
    """Fit a model of one user to labelled paths and return it.

    images: uint8 (scene, 100, 100, 3), seen from above, row 0 at the far edge of the 1 m table. A clearance model also
    takes `Objects`: what stands on each table, as somebody told; its model then takes them everywhere.
    paths: (scene, n, 2) [m], z_theta, the control point of each demonstrated path of the paper's kind; or
    (scene, n, point, 2) [m], points along paths of any shape and ends. A model takes the kind that it was fitted to;
    irl_maxent, which weighs a path against all of the paper's, takes z_theta alone.
    valid: bool (scene, n), the user's labels.
    variant: one of SETTINGS (full, ae, classifier, irl_maxent, irl_ranked, clearance).
    seed: decides the initial weights and the order of training; IRL's changes of pictures hang on the pictures.
    progress: show a bar of the training's steps.

    Raises InputError if an argument has a wrong type, shape or unit, or if there are fewer than 2 scenes. Labels that
    are all equal give a warning: the model then predicts one probability everywhere.
    """
    if not isinstance(variant, str) or variant not in SETTINGS:
        raise InputError(f"variant {variant!r}: expected one of {', '.join(SETTINGS)}")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed {seed!r}: expected a whole number from 0")
    _check_scenes(images, paths)
    shape = np.shape(paths)[:2]
    if not is_array(valid) or valid.dtype.kind != "b" or valid.shape != shape:
        kind = valid.dtype if is_array(valid) else type(valid).__name__
        raise InputError(f"valid is {kind} of shape {np.shape(valid)}: expected bool of shape {shape}, one a path")
    if valid.all() or not valid.any():
        kind = "valid" if valid.all() else "invalid"
        warnings.warn(f"all paths are {kind}: the model answers one probability everywhere", stacklevel=3)
    settings, seed = SETTINGS[variant], int(seed)
    if isinstance(images, Objects):
        if settings["kind"] != "clearance":
            raise InputError(f"images are Objects: variant {variant} sees pictures alone; only clearance takes these")
        settings = settings | {"model": settings["model"] | {"kinds": images.kinds.shape[-1]}}
    if paths.ndim == 4 and variant == "irl_maxent":
        raise InputError("paths are points: irl_maxent takes z_theta (scene, n, 2) alone; irl_ranked takes points, too")
    if paths.ndim == 4 and settings["kind"] == "vae":
        settings = settings | {"model": settings["model"] | {"path_numbers": 2 * CURVE_POINTS}}
    model = build(settings, seed)
    z, valid = np.array(paths, dtype=np.float64, order="C"), np.array(valid, order="C")  # whatever their strides
    steps = TRAINING[settings["stage"]]["steps"]
    bar = _Bar(steps[settings["objective"]] if settings["stage"] == "irl" else steps, progress)
    with bar.bar:
        curves = trainer(settings, TRAINING).fit([model], [images], [z], [valid], seeds=[seed], checkpoints=bar)
    need_finite(curves[0], variant)
    model.settings = {"variant": variant, "kind": settings["kind"], "model": settings["model"], "seed": seed}
    return model.eval()


@undisturbed()
def repair(model: ValidityModel, images: Array | Objects, starts: Array, free_ends: bool = False) -> Array:
    """Return, for each start, the path that the model accepts, z_theta or points as the starts [m]; NaN if none.

    images, starts: as the images and paths of `fit`. Curves come back with as many points, moved ones evenly along
    them, and keep their ends unless free_ends. The model is asked about these points: too few can give NaN.

    An accepted path has P(valid) > .8: the start itself, if it is accepted. For z_theta, takes the paper's gradient
    steps on the model's log-odds and returns the nearest accepted point on the way, which can be far from the start;
    starts and steps are clipped to [-.2, 1.2] m. For curves, searches among smooth displacements. A clearance model
    lowers its confidence in a picture unlike its training ones, and may return NaN there. Raises InputError as `fit`.
    """
    _check_model(model)
    _check_scenes(images, starts, name="starts", at_least=1)
    if starts.ndim == 4:
        return _nearest_curves(model, images, starts.astype(np.float64), free_ends)
    if free_ends:
        raise InputError("free_ends=True: z_theta has fixed ends; give starts as points (scene, path, point, 2) [m]")
    steps = climb(model, images, np.asarray(starts, dtype=np.float64), Ascent(**REPAIR))
    distances = np.linalg.norm(steps.z - steps.z[:, :, :1], axis=-1)  # (scene, path, step)
    nearest = np.where(steps.p > ACCEPTED_ABOVE, distances, np.inf).argmin(-1)[..., None]
    ends = np.take_along_axis(steps.z, nearest[..., None], axis=2)[:, :, 0].astype(np.float64)
    ends = np.where(nearest == 0, np.clip(starts, Z_LOW, Z_HIGH), ends)  # steps are float32
    ends[(steps.p <= ACCEPTED_ABOVE).all(-1)] = np.nan
    return ends


def _nearest_curves(model: ValidityModel, images: Array | Objects, starts: Array, free_ends: bool) -> Array:
    """Return accepted curves near the starts, by search (`planning.bumps`), with as many points as before."""
    log_valid, ends = by_model(model, images), starts.copy()
    even = resample(torch.from_numpy(starts), POINTS).numpy()
    for scene, path in np.ndindex(*starts.shape[:2]):
        if log_valid(scene, even[[scene], path])[0] <= np.log(ACCEPTED_ABOVE):
            offsets, log_p = nearest(log_valid, scene, even[scene, path], CURVE_PENALTY, free_ends)
            moved = torch.from_numpy(even[scene, path] + basis(free_ends) @ offsets)[None, None]
            end = resample(moved, starts.shape[2])[0].numpy()
            accepted = min(log_p, log_valid(scene, end)[0]) > np.log(ACCEPTED_ABOVE)
            ends[scene, path] = end[0] if accepted else np.nan
    return ends


@undisturbed()
def effect(
    model: ValidityModel | Sequence[ValidityModel],
    images: Array | Objects,
    images_with_item: Array | Objects,
    paths: Array,
) -> Effect:
    """Return the estimated effect of an added item on the validity of paths: E[V | do(add item)] - E[V].

    images, images_with_item: as the images of `fit`, the same scenes without and with the item.
    paths: as in `fit`, the same paths in both.

    Scenes are the unit of replication. For one model, interval and p are those of a one-sample t-test over scenes,
    corrected for skewness (Hall, 1992), and do not cover other training sets. For a sequence of models with separate
    training sets, models and scenes are crossed random factors (pipeline.stats.crossed). Either test needs scenes in
    which the mean P(valid) of some model changes by more than INFORMATIVE_CHANGE: half of the scenes, or at least
    INFORMATIVE_SCENES. With fewer, or with fewer than 6 scenes, p is 1, and the interval is as wide as the share of
    such scenes allows (Clopper and Pearson, 1934): an item that changes nothing in 60 scenes is negligible, in 30
    undecided. Raises InputError as `fit`.
    """
    _check_scenes(images, paths)
    _check_images(images_with_item, "images_with_item")
    if (count := len(images_with_item)) != len(images):
        raise InputError(f"{count} images_with_item: expected {len(images)}, one for each of the images")
    models = list(model) if isinstance(model, Sequence) else [model]
    if not models:
        raise InputError("no model: expected a model or a sequence of models")
    for one in models:
        _check_model(one)
    z = np.asarray(paths, dtype=np.float64)
    changes = [m.probability(images_with_item, z).astype(float) - m.probability(images, z) for m in models]
    effects = np.stack(changes).mean(-1)  # (model, scene)
    estimates = estimate(effects[None], skewed=True)
    mean, p, low, high, low90, high90 = (
        float(getattr(estimates, name)[0]) for name in ("effect", "p", "ci_low", "ci_high", "ci90_low", "ci90_high")
    )
    informative, scenes = int((np.abs(effects) > INFORMATIVE_CHANGE).any(0).sum()), len(images)
    if scenes < MIN_PAIRS or informative < min(INFORMATIVE_SCENES, scenes / 2):
        still = max(scenes - informative, 1e-9)  # all scenes may change where all did
        share, share90 = beta.ppf((0.975, 0.95), informative + 1, still).tolist()  # of changes up to 1
        p, low, high = 1.0, min(low, -share), max(high, share)
        low90, high90 = min(low90, -share90), max(high90, share90)
    return Effect(mean, (low, high), p, verdict(low, high, low90, high90))


@undisturbed()
def save(model: ValidityModel, path: str | Path) -> None:
    """Write a fitted model as safetensors with its settings as metadata; `load` restores it bit for bit.

    Makes missing folders. Raises InputError for a folder, and for a model that `fit` or `load` did not return.
    """
    _check_model(model)
    if not model.settings:
        raise InputError("the model does not carry its settings: save a model that `fit` or `load` returned")
    if Path(path).is_dir():
        raise InputError(f"{path} is a folder: expected the name of a file")
    state = {name: value.contiguous() for name, value in model.state_dict().items()}
    content = to_bytes(state, metadata={"settings": json.dumps(model.settings, sort_keys=True)})
    atomic_write(Path(path), lambda temporary: temporary.write_bytes(content))


@undisturbed()
def load(path: str | Path) -> ValidityModel:
    """Return the model written by `save`, in eval mode; raise InputError if it is missing, damaged or not finite."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} is missing: expected a file that `save` wrote")
    try:
        with safe_open(path, "pt") as file:
            settings = json.loads((file.metadata() or {})["settings"])
        model = build(settings)
        read_weights(model, path, settings["variant"])
    except InputError:
        raise
    except (SafetensorError, KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:  # wrong settings
        raise InputError(f"{path} is not a model that `save` wrote ({error!r}): fit and save it again") from error
    model.settings = settings
    read_segmenter()  # kept for good: `probability`, which meets the caller's default dtype, finds it
    return model.eval()


def _check_model(model: Any) -> None:
    """Raise InputError unless it is a model."""
    if not isinstance(model, ValidityModel):
        raise InputError(f"model is {type(model).__name__}: expected what `fit` or `load` returned")


def _check_images(images: Any, name: str) -> None:
    """Raise InputError, which calls the argument `name`, unless images are uint8 (scene, 100, 100, 3) and not black.

    Objects must be finite, and without a gap before the last of a scene.
    """
    check_images(images, name)
    if isinstance(images, Objects):
        arrays = [getattr(images, field.name) for field in fields(images)]
        if not all(np.isfinite(array).all() for array in arrays):
            raise InputError(f"{name} hold numbers that are not finite: expected finite ones, also of absent objects")
        if (images.present[:, 1:] & ~images.present[:, :-1]).any():
            raise InputError(f"{name} have gaps before present objects: make them by `Objects.of`")
        return
    black = ~np.median(images.reshape(len(images), -1, 3), axis=1).any(1)
    if black.any():
        raise InputError(f"{name}[{black.argmax()}] is mostly black: expected the image of a table in each scene")


def _check_scenes(images: Any, paths: Any, name: str = "paths", at_least: int = 2) -> None:
    """Raise InputError unless images and paths have the library's shapes and units."""
    _check_images(images, "images")
    if len(images) < at_least:
        raise InputError(f"number of scenes is {len(images)}: expected at least {at_least}")
    check_paths(paths, len(images), name)
    if not np.shape(paths)[1]:
        raise InputError(f"{name} has no paths: expected at least one a scene")
