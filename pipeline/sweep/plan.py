"""The jobs that a sweep's command line asks for: whether they can run at all, and their start by Hydra's launcher."""

import json
import math
import os
import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Glob, Override, Quote, QuotedString
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.launch import explained
from pipeline.params import GRAPH, validate
from pipeline.params import compose as compose_parameters
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import CONF
from pipeline.sweep.job import Sweep, run_job

BARE = re.compile(r"(?!(?:null|true|false|nan|inf)$)[a-z_][a-z_0-9./-]*", re.IGNORECASE)  # read as nothing but text
# Hydra writes no files and no lines of its own: jobs do
QUIET = ["hydra.sweep.subdir=.", "hydra.output_subdir=null"]
QUIET += [f"hydra/{kind}_logging=disabled" for kind in ("job", "hydra")]
EXTRAS = "launchers other than basic and joblib, and Optuna, need `make venv-cluster` and .venv-cluster/bin on PATH"


@dataclass
class Plan:
    """The jobs of a sweep."""

    overrides: list[str]  # of Hydra's command line
    fixed: list[str]  # overrides of every job
    defaults: dict[str, str]  # swept parameter -> its default as text
    jobs: list[list[str]] | None = None  # the overrides of each; None if Optuna chooses them


def make_plan(arguments: Sequence[str], targets: Sequence[str]) -> Plan:
    """Return the plan of Hydra's overrides; raise InputError for one that cannot be run, before any work is done."""
    parse = OverridesParser.create().parse_overrides
    if not any(text.startswith("hydra/launcher=") for text in arguments):
        arguments = ["hydra/launcher=joblib", *arguments]
    try:
        last = {override.get_key_element(): override for override in parse(list(arguments))}  # of a name, as in Hydra
        single = [_text(override) for override in last.values() if not override.is_sweep_override()]
        with hydra.initialize_config_dir(str(CONF), version_base="1.3"):
            whole = hydra.compose("config", overrides=single, return_hydra_config=True)
        params = whole.hydra.sweeper.get("params") or {}  # of an experiment
        preset = parse([f"{name}={value}" for name, value in params.items()])
    except (HydraException, OmegaConfBaseException, ValueError) as error:
        hint = f"; {EXTRAS}" if "hydra/" in str(error) else ""
        raise InputError(explained(error) + hint) from error
    last = {override.get_key_element(): override for override in preset} | last
    ours = {key: override for key, override in last.items() if not key.startswith("hydra")}
    swept = {key: override for key, override in ours.items() if override.is_sweep_override()}
    fixed = [_text(override) for key, override in ours.items() if key not in swept]
    launched = [_text(override) for key, override in last.items() if key not in ours] + fixed
    defaults = {key.lstrip("+"): value_of(whole, key.lstrip("+")) for key in swept}
    if "optuna" in str(whole.hydra.sweeper._target_):
        validate(compose_parameters(fixed), [*GRAPH, *targets])
        return Plan([*launched, *(str(override.input_line) for override in swept.values())], fixed, defaults)
    axes = {text: [text] for text in fixed}
    for key, override in swept.items():
        if not override.is_discrete_sweep() or isinstance(override.value(), Glob):
            raise InputError(f"{override.input_line}: name the values; only hydra/sweeper=optuna takes an interval")
        axes[key] = list(dict.fromkeys(f"{key}={canonical(value)}" for value in override.sweep_iterator()))
        launched.append(f"{key}={','.join(text.partition('=')[2] for text in axes[key])}")
        for name in (text.partition("=")[2] for text in axes[key] if key.lstrip("+") == "experiment"):
            if sweeps(name):
                raise InputError(f"{override.input_line}: {name} sweeps, too: name one, then --resume with the next")
    for key in swept or list(axes)[:1]:  # each value once, with the first value of every other parameter
        others = [axis[0] for name, axis in axes.items() if name != key]
        for value in axes[key]:
            validate(compose_parameters([*others, value]), [*GRAPH, *targets])
    return Plan(launched, fixed, defaults, [list(job) for job in product(*axes.values())])


def sweeps(experiment: str) -> bool:
    """Return whether an experiment of conf/ names parameters to sweep, instead of values."""
    file = CONF / "experiment" / f"{experiment}.yaml"
    return file.is_file() and bool(OmegaConf.select(OmegaConf.load(file), "hydra.sweeper.params"))


def canonical(value: Any) -> str:
    """Return a parameter's value as Hydra reads it; 100, 100.0 and 1e2 have the same text, but not true, 1 and "1"."""
    value = getattr(value, "text", value)  # of Hydra's QuotedString
    if isinstance(value, dict):
        return f"{{{','.join(f'{key}:{canonical(part)}' for key, part in sorted(value.items()))}}}"
    if isinstance(value, list):
        return f"[{','.join(map(canonical, value))}]"
    if isinstance(value, float):
        return str(int(value) if value.is_integer() else value)
    if not isinstance(value, str):
        return json.dumps(value)
    return value if BARE.fullmatch(value) else QuotedString(value, Quote.double).with_quotes()


def value_of(cfg: DictConfig, name: str) -> str:
    """Return a parameter's value as text, the same for all spellings of it; `null` for one that is not there.

    For a group, as in users@users.careful=normal, it is what stands where the group is put.
    """
    value = OmegaConf.select(cfg, name.rpartition("@")[2])
    return canonical(OmegaConf.to_container(value) if OmegaConf.is_config(value) else value)


def _text(override: Override) -> str:
    """Return an override as Hydra hands it to a job, the same for all spellings of its value."""
    return f"{override.get_key_element()}={canonical(override.value())}"


def launch(sweep: Sweep, plan: Plan) -> None:
    """Run the jobs of a plan; raise InputError if Hydra refuses the command line, or its launcher fails."""

    def task(_) -> float:
        value = run_job(sweep, [text for text in HydraConfig.get().overrides.task if not text.startswith("hydra")])
        if plan.jobs is None and math.isnan(value):
            raise InputError("the job failed")  # a sweeper that is told NaN ends
        return value

    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors are reported by us
    paths = [str(sweep.root), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)  # processes that launchers start import the same code
    chosen = ["hydra.sweeper.max_failure_rate=1"] if plan.jobs is None else []  # a failed job takes no other along
    ray = ["hydra.launcher.ray.init.address=local"] if "hydra/launcher=ray" in plan.overrides else []  # one of its own
    folder = ["hydra.job.name=sweep", f"hydra.sweep.dir={QuotedString(str(sweep.folder), Quote.single).with_quotes()}"]
    sys.argv[1:] = ["--multirun", *folder, *QUIET, *chosen, *ray, *plan.overrides]
    try:
        hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(task)()
    except HydraException as error:
        raise InputError(explained(error)) from error
    except Exception as error:  # such as a Ray that does not start; jobs' own failures are in their job.json
        if plan.jobs is None and "No trials are completed" in str(error):
            return  # all jobs failed, and the summary says why
        why, resume = f"{type(error).__name__}: {error}", f"--resume {shlex.quote(str(sweep.folder))}"
        raise InputError(f"the launcher failed ({why}): `{resume}` runs what is missing") from error
