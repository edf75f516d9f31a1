"""Run a stage's `main(cfg, out_dir)` from the command line: for DVC (`--params params.yaml`) or through Hydra."""

import errno
import hashlib
import importlib
import json
import logging
import os
import platform
import re
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.config.graph import FITTED, stage_entry
from pipeline.params import (
    CONF,
    GRAPH,
    PARAMS,
    drop_absent,
    explained,
    load,
    need,
    read_by,
    refuse_recomposed,
    refuse_unread,
    validate,
)
from pipeline.runtime.errors import InputError
from pipeline.runtime.memory import disable_malloc_trim
from pipeline.runtime.writing import atomic_write

Main = Callable[[DictConfig, Path], None]
PROCESSORS = "processors.json"
USAGE = """
python -m {module} [parameter=value ...]            one run by Hydra, into multirun/single/{stage}
python -m {module} --multirun parameter=a,b ...     a sweep, into multirun/{stage}; --cfg job shows the parameters
python -m {module} --params params.yaml             the run that DVC makes, into {out}
"""


def launch(main: Main, stage: str) -> None:
    """Run a stage from the command line; a user error ends it with a one-line message and exit code 2.

    `--params FILE [key=value ...]` reads resolved parameters and writes to the stage's folder in `paths`, for DVC.
    Otherwise Hydra composes conf/, and the run writes to Hydra's output directory.
    """
    disable_malloc_trim()
    argv = sys.argv[1:]
    try:
        if {"-h", "--help"} & set(argv):
            print(usage(stage))
        elif "--params" in argv:
            _from_params(main, stage, argv)
        else:
            _from_hydra(main, stage, argv)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        sys.exit(130)
    except (InputError, OSError, yaml.YAMLError) as error:
        too_long = getattr(error, "errno", None) == errno.ENAMETOOLONG
        hint = "; name the runs by number: hydra.sweep.subdir='${hydra.job.num}'" if too_long else ""
        print(f"error: {' '.join(str(error).split())}{hint}", file=sys.stderr)
        sys.exit(2)


def usage(stage: str) -> str:
    """Return the help text of a stage: purpose, usage, files read and written, parameters."""
    module = f"studies.{stage}.stage" if (CONF.parent / "studies" / stage).is_dir() else f"pipeline.stages.{stage}"
    text = (importlib.import_module(module).__doc__ or "").strip()
    cfg = load(CONF.parent / PARAMS)
    entry = stage_entry(stage) or {}
    lines = [text, USAGE.format(module=module, stage=stage, out=_folder(cfg, stage))]
    lines += ["Reads:", *(f"  {dep}" for dep in entry.get("deps", []) if not dep.startswith(("pipeline/", "studies/")))]
    outs = [out for key in ("outs", "metrics") for out in entry.get(key, [])]
    lines += ["Writes:", *(f"  {out if isinstance(out, str) else next(iter(out))}" for out in outs)]
    lines += [f"Parameters (conf/ says what each is; these are of profile {cfg.profile}):"]
    lines += [f"  {line}" for line in read_by(cfg, stage).splitlines()]
    return "\n".join(lines).replace("${item.variant}", cfg.variant)


def _folder(cfg: DictConfig, stage: str, folder: Path | None = None) -> Path:
    """Return the output folder of a run, by default DVC's: variants fitted by one stage have sibling folders."""
    if folder is None:
        folder = Path(cfg.paths[stage]) if stage in cfg.paths else Path(cfg.paths.studies) / stage
    return folder / cfg.variant if stage in FITTED else folder


def _from_params(main: Main, stage: str, argv: list[str]) -> None:
    """Run with the parameters of a file."""
    index = argv.index("--params")
    if len(argv) < index + 2:
        raise InputError("--params needs a file: --params params.yaml")
    overrides = argv[:index] + argv[index + 2 :]
    cfg = load(Path(argv[index + 1]), overrides, [stage] if overrides else [*GRAPH, stage])
    refuse_recomposed(cfg)
    refuse_unread(cfg, stage, overrides)
    need(cfg, "seed", cfg.seed is None, "null, since DVC keeps the files of all seeds; for one, leave --params out")
    out_dir = _folder(cfg, stage)
    out_dir.mkdir(parents=True, exist_ok=True)
    main(cfg, out_dir)
    if "DVC_STAGE" in os.environ:  # DVC runs this: note the processor beside dvc.lock, by DVC's name such as train@full
        known, path = {}, Path(PROCESSORS)
        with suppress(FileNotFoundError, ValueError):  # the first stage, or a merge left its marks in the file
            known = json.loads(path.read_text())
        lines = json.dumps(known | {os.environ["DVC_STAGE"]: processor()}, indent=2, sort_keys=True) + "\n"
        atomic_write(path, lambda part: part.write_text(lines))


def processor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name, family and model as Linux gives them, and whether it has AVX-512."""
    if not cpuinfo.is_file():
        return f"{platform.machine()} {platform.processor()}".strip()
    fields = dict(re.findall(r"(?m)^([^\t:]+)\t*: (.*)$", cpuinfo.read_text()))
    parts = [fields.get("model name", platform.machine())]
    parts += [f"{name.removeprefix('cpu ')} {fields[name]}" for name in ("cpu family", "model") if name in fields]
    return ", ".join([*parts, *(["AVX-512"] if "avx512f" in fields.get("flags", "") else [])])


def _from_hydra(main: Main, stage: str, argv: list[str]) -> None:
    """Compose conf/ and run; a sweep runs every combination, even after failures."""
    import hydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.errors import HydraException
    from hydra.types import RunMode

    refused: list[Exception] = []

    def run(cfg: DictConfig) -> None:
        settings = HydraConfig.get()
        overrides = [override for override in settings.overrides.task if not override.startswith("hydra.")]
        try:
            _job(main, stage, cfg, overrides, Path(settings.runtime.output_dir))
        except (InputError, OSError) as error:
            if settings.mode == RunMode.MULTIRUN:  # Hydra reports only the first failure
                print(f"error: {settings.job.override_dirname}: {error}", file=sys.stderr)
                raise
            refused.append(error)  # raised after Hydra's return, as Hydra would print a message of its own

    # Hydra names its folders after the job; argparse wants all overrides in a row
    overrides = [argument for argument in argv if re.match(r"[~+]|(?!-).*=", argument)]
    flags = [argument for argument in argv if argument not in overrides]
    if not any(override.startswith("hydra.job.name=") for override in overrides):
        overrides.insert(0, f"hydra.job.name={stage}")
    sys.argv[1:] = [*overrides, *flags]
    os.environ["HYDRA_FULL_ERROR"] = "1"  # errors are reported here, not with Hydra's message and exit code
    _note_other_profile(overrides)
    try:
        hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run)()
    except HydraException as error:
        raise InputError(explained(error)) from error
    if refused:
        raise refused[0]


def _job(main: Main, stage: str, cfg: DictConfig, overrides: list[str], folder: Path) -> None:
    """Check one combination of parameters, run it, and log its parameters and duration."""
    try:
        OmegaConf.resolve(cfg)
    except OmegaConfBaseException as error:
        raise InputError(f"parameters do not resolve ({error}): correct the override") from error
    drop_absent(cfg)
    validate(cfg, [stage])
    refuse_unread(cfg, stage, overrides)
    start = time.perf_counter()
    main(cfg, _folder(cfg, stage, folder))
    digest = hashlib.sha256(read_by(cfg, stage).encode()).hexdigest()[:12]
    logging.getLogger(stage).info("done in %.1f s, parameters %s: %s", time.perf_counter() - start, digest, overrides)


def _note_other_profile(overrides: list[str]) -> None:
    """Print which profile Hydra composes if params.yaml has another one."""
    asked = next((o.partition("=")[2] for o in reversed(overrides) if o.startswith("profile=")), "paper")
    path = CONF.parent / PARAMS
    found = re.search(r"(?m)^profile: (\S+)", path.read_text()) if path.is_file() else None
    if found and found[1] != asked:
        print(f"profile {asked}; params.yaml is {found[1]}", file=sys.stderr, flush=True)
