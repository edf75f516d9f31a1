"""Read the command line of a sweep: its jobs, and whether they can run at all."""

import importlib.util
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.audit.setting import setting
from pipeline.launch import explained
from pipeline.params import GRAPH, validate
from pipeline.params import compose as compose_parameters
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF

SUBMITIT = "hydra_plugins.hydra_submitit_launcher", "submitit"
RAY = "hydra_plugins.hydra_ray_launcher", "ray"
# launcher or sweeper -> the package that it needs, and the extra of pyproject.toml that brings it
EXTRAS = {"submitit_local": SUBMITIT, "submitit_slurm": SUBMITIT, "slurm": SUBMITIT, "ray": RAY, "ray_cluster": RAY}
EXTRAS |= {"optuna": ("hydra_plugins.hydra_optuna_sweeper", "optuna")}
CONNECT_S = 5.0  # how long a cluster may take to answer


@dataclass
class Plan:
    """The jobs of a sweep.

    overrides: of Hydra's command line; fixed: overrides of every job; defaults: swept parameter -> its default; jobs:
    the overrides of each job, None if Optuna chooses them.
    """

    overrides: list[str]
    fixed: list[str]
    defaults: dict[str, Any]
    jobs: list[list[str]] | None = None


def make_plan(arguments: Sequence[str], targets: Sequence[str]) -> Plan:
    """Return the plan of Hydra's overrides; raise InputError for one that cannot be run, before any work is done."""
    for text in arguments:
        group, _, name = text.partition("=")
        package, extra = EXTRAS.get(name, ("", "")) if group in ("hydra/launcher", "hydra/sweeper") else ("", "")
        if package and importlib.util.find_spec(package) is None:
            how = f"run `make venv-cluster` and put .venv-cluster/bin on PATH, or `pip install '.[{extra}]'`"
            raise InputError(f"{name} is not installed: {how}; or choose hydra/launcher=basic")
    try:
        overrides = _seeds_together(arguments)
        parsed = OverridesParser.create().parse_overrides(overrides)
        with initialize_config_dir(str(CONF), version_base="1.3"):
            single = [_text(override) for override in parsed if not override.is_sweep_override()]
            whole = compose("config", overrides=single, return_hydra_config=True)
        hydra = whole.hydra
        params = OmegaConf.to_container(hydra.sweeper.get("params") or OmegaConf.create({}))
        preset = OverridesParser.create().parse_overrides([f"{k}={v}" for k, v in params.items()])  # pyright: ignore
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(explained(error)) from error
    _need_cluster(hydra.launcher)
    ours = [override for override in [*preset, *parsed] if not (override.key_or_group or "").startswith("hydra")]
    given = {override.get_key_element(): override for override in ours}  # the last of a name counts, as in Hydra
    swept = {key: override for key, override in given.items() if override.is_sweep_override()}
    fixed = [_text(override) for key, override in given.items() if key not in swept]
    values = {key: OmegaConf.select(whole, key.lstrip("+")) for key in swept}
    defaults = {key: OmegaConf.to_container(v) if OmegaConf.is_config(v) else v for key, v in values.items()}
    if "optuna" in str(hydra.sweeper._target_):
        if twice := [override.input_line for override in ours if given[override.get_key_element()] is not override]:
            raise InputError(f"{twice[0]}: the parameter is given twice; Optuna wants it once")
        validate(compose_parameters(fixed), [*GRAPH, *targets])
        return Plan(overrides, fixed, defaults)
    for override in swept.values():
        if not override.is_discrete_sweep():
            line = override.input_line
            raise InputError(f"{line}: only hydra/sweeper=optuna can choose from an interval; list values")
    axes = {key: [] if key in swept else [_text(override)] for key, override in given.items()}
    for key, override in swept.items():
        every = [f"{key}={value}" for value in override.sweep_string_iterator()]
        spelled = [setting([text]) for text in every]
        axes[key] = [text for i, text in enumerate(every) if spelled.index(spelled[i]) == i]
        if len(axes[key]) < len(every):
            once = f"{key}={','.join(text.removeprefix(f'{key}=') for text in axes[key])}"
            print(f"{override.input_line}: equal values are one setting; this runs {once}", flush=True)
            overrides = [*overrides, once]
    for key in swept or list(axes)[:1]:  # each value once, with the first value of every other parameter
        others = [axis[0] for name, axis in axes.items() if name != key]
        for value in axes[key]:
            validate(compose_parameters([*others, value]), [*GRAPH, *targets])
    return Plan(overrides, fixed, defaults, [list(job) for job in product(*axes.values())])


def _text(override: Override) -> str:
    """Return an override as Hydra hands it to a job."""
    return f"{override.get_key_element()}={override.get_value_element_as_str()}"


def _seeds_together(overrides: Sequence[str]) -> list[str]:
    """Return overrides with a sweep over `seed` as one list of seeds, since every job fits all of its seeds."""
    kept = list(overrides)
    for i, text in enumerate(overrides):
        if text.startswith("seed="):
            override = OverridesParser.create().parse_override(text)
            if not override.is_sweep_override():
                raise InputError(f"{text}: a job fits several training sets: name all of them, as seed=0,1,2")
            name = "validation_seeds" if "protocol=validation" in overrides else "seeds"
            kept[i] = f"{name}=[{','.join(override.sweep_string_iterator())}]"
            print(f"{text}: every job fits all of them ({kept[i]})", flush=True)
    return kept


def _need_cluster(launcher) -> None:
    """Raise InputError if the launcher's Ray cluster does not answer."""
    address = OmegaConf.select(launcher, "ray.init.address")
    if address in (None, "auto", "local"):
        return
    host, _, port = str(address).removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=CONNECT_S).close()
    except (OSError, ValueError) as error:
        raise InputError(
            f"the Ray cluster at {address} does not answer ({error}): start it with `ray start --head --port={port}`, "
            "or correct hydra.launcher.ray.init.address"
        ) from error
