"""Run a stage's `main(cfg, out_dir)` from the command line: for DVC (`--params params.yaml`) or through Hydra."""

import argparse
import json
import logging
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, OmegaConfBaseException

from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.instructions import disable_malloc_trim
from pipeline.runtime.places import CONF, PARAMS, PROCESSORS
from pipeline.runtime.settings import Shared, checked, need, need_one
from pipeline.runtime.writing import atomic_write

Main = Callable[[DictConfig, Path], None]
FITTED = ("train", "irl", "clearance")  # stages that run once per variant, each variant in its own folder
COMPARING = ("evaluate", "readings", "repair", "intervene")  # stages that, like studies, give intervals over seeds


def launch(main: Main, stage: str) -> None:
    """Run a stage from the command line; a user error ends it with a one-line message and exit code 2.

    `--params FILE [key=value ...]` reads resolved parameters and writes to the stage's folder in `paths`, for DVC.
    Otherwise Hydra composes conf/, and the run writes to Hydra's output directory.
    """
    disable_malloc_trim()
    with reported(OSError, yaml.YAMLError):
        try:
            if "--params" in sys.argv:
                _from_params(main, stage)
            else:
                _from_hydra(main, stage)
        except KeyboardInterrupt:
            print("error: interrupted", file=sys.stderr)
            sys.exit(130)


def load(path: Path = PARAMS, overrides: Sequence[str] = ()) -> DictConfig:
    """Return the parameters of a params.yaml with dotted `overrides` (`variant=ae`).

    Raises InputError for a file that holds none, or an override of a parameter that is not there.
    """
    again = "run `python -m pipeline.params` to write it from conf/"
    try:
        cfg = OmegaConf.load(path)
        if not isinstance(cfg, DictConfig) or not cfg:
            raise InputError(f"{path} is not a mapping: {again}")
        OmegaConf.set_struct(cfg, True)
        cfg.merge_with_dotlist(list(overrides))
        OmegaConf.resolve(cfg)
    except ConfigAttributeError as error:
        raise InputError(f"unknown parameter {error.full_key!r} in {list(overrides)} (see conf/)") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise InputError(f"{path} with {list(overrides)} could not be read ({error}): {again}") from error
    return cfg


def check(cfg: DictConfig, stage: str, module: ModuleType, agree: bool = True) -> None:
    """Check the parameters that all stages share and those of a stage or study, whose classes are in its `module`.

    Without `agree`, its constraints between groups are left out. Raises InputError for the first wrong parameter.
    """
    values: Any = OmegaConf.to_container(cfg, resolve=True)
    checked(Shared, {name: values[name] for name in Shared.model_fields if name in values})
    study = stage not in values["paths"]
    if agree and (study or stage in COMPARING):
        seeds = list(cfg.protocol.seeds)
        need(len(seeds) > 1, "protocol.seeds", seeds, "at least 2 seeds, or intervals mean nothing")
    if hasattr(module, "Settings"):
        group = values["studies"] if study else values
        settings = checked(module.Settings, group.get(stage), f"studies.{stage}" if study else stage)
        if agree and hasattr(module, "agree"):
            module.agree(settings, cfg)


def check_variant(cfg: DictConfig, variant: str, module: ModuleType) -> None:
    """Check the parameters of a variant by the module of the stage that fits it. Raises InputError."""
    checked(module.Variant, OmegaConf.to_container(cfg.variants[variant]), f"variants.{variant}")


def _begin(cfg: DictConfig, stage: str, main: Main, folder: Path | None = None) -> Path:
    """Check what a run of the stage reads; return its output folder, by default DVC's. Each variant has its own."""
    module = sys.modules[main.__module__]
    check(cfg, stage, module)
    if folder is None:
        folder = Path(cfg.paths[stage]) if stage in cfg.paths else Path(cfg.paths.studies) / stage
    if stage not in FITTED:
        return folder
    need_one("variant", cfg.variant, [name for name, settings in cfg.variants.items() if settings.stage == stage])
    check_variant(cfg, cfg.variant, module)
    return folder / cfg.variant


def _from_params(main: Main, stage: str) -> None:
    """Run with the parameters of a file, and note the processor if DVC runs this."""
    parser = argparse.ArgumentParser(prog=f"stage {stage}")
    parser.add_argument("--params", type=Path, required=True, metavar="FILE")
    parser.add_argument("overrides", nargs="*", metavar="parameter=value")
    given = parser.parse_intermixed_args()
    cfg = load(given.params, given.overrides)
    try:
        out_dir = _begin(cfg, stage, main)
    except InputError as error:
        if "DVC_EXP_NAME" not in os.environ:
            raise
        restore = f"`git checkout outputs && dvc checkout {os.environ['DVC_STAGE']}`"
        raise InputError(f"{error}; DVC had removed the stage's outputs: {restore} restores them") from error
    all_seeds = "null, since DVC keeps the files of all seeds; for one, leave --params out"
    need(cfg.seed is None, "seed", cfg.seed, all_seeds)
    out_dir.mkdir(parents=True, exist_ok=True)
    main(cfg, out_dir)
    if "DVC_STAGE" in os.environ:  # DVC's name, such as train@full
        known = {}
        with suppress(FileNotFoundError, ValueError):  # the first stage, or a merge left its marks in the file
            known = json.loads(PROCESSORS.read_text(encoding="utf-8"))
        lines = json.dumps(known | {os.environ["DVC_STAGE"]: processor()}, indent=2, sort_keys=True) + "\n"
        atomic_write(PROCESSORS, lambda part: part.write_text(lines, encoding="utf-8"))


def processor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name, family and model as Linux gives them, and whether it has AVX-512."""
    if not cpuinfo.is_file():
        return f"{platform.machine()} {platform.processor()}".strip()
    fields = dict(re.findall(r"(?m)^([^\t:]+)\t*: (.*)$", cpuinfo.read_text(encoding="utf-8")))
    parts = [fields.get("model name", platform.machine())]
    parts += [f"{name.removeprefix('cpu ')} {fields[name]}" for name in ("cpu family", "model") if name in fields]
    return ", ".join([*parts, *(["AVX-512"] if "avx512f" in fields.get("flags", "") else [])])


def _from_hydra(main: Main, stage: str) -> None:
    """Compose conf/ and run; a sweep runs every combination, even after failures."""
    import hydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.errors import HydraException
    from hydra.types import RunMode

    refused: list[Exception] = []

    def run(cfg: DictConfig) -> None:
        settings = HydraConfig.get()
        start = time.perf_counter()
        try:
            OmegaConf.resolve(cfg)
            main(cfg, _begin(cfg, stage, main, Path(settings.runtime.output_dir)))
        except (InputError, OSError, OmegaConfBaseException) as error:
            if settings.mode == RunMode.MULTIRUN:  # Hydra reports only the first failure
                print(f"error: {settings.job.override_dirname}: {error}", file=sys.stderr)
                raise
            refused.append(error)  # raised after Hydra's return, as Hydra would print a message of its own
            return
        logging.getLogger(stage).info("done in %.1f s: %s", time.perf_counter() - start, settings.overrides.task)

    # Hydra names its folders after the job; argparse wants all overrides in a row
    overrides = [argument for argument in sys.argv[1:] if re.match(r"[~+]|(?!-).*=", argument)]
    flags = [argument for argument in sys.argv[1:] if argument not in overrides]
    sys.argv[1:] = [f"hydra.job.name={stage}", *overrides, *flags]
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors are reported here, not with Hydra's message and exit code
    try:
        hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run)()
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(explained(error)) from error
    if refused:
        raise InputError(str(refused[0])) from refused[0]


def explained(error: Exception) -> str:
    """Return Hydra's message, or the unknown parameter: Hydra does not name one inside an override's dictionary."""
    name = getattr(error.__cause__, "full_key", None)
    message = str(error).partition("\nConfig search path:")[0]
    if "item value in defaults" in message:
        message += "; put names such as no, true or 1e5 in quotes"
    return f"unknown parameter {name!r} (see conf/; + in front of the override adds it)" if name else message
