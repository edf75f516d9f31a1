"""One `main(cfg, out_dir)` a stage, served to DVC (`--params params.yaml`) and to Hydra (everything else)."""

import sys
from collections.abc import Callable
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.params import CONF, GRAPH, load, need, read_by, validate
from pipeline.runtime.errors import InputError
from pipeline.runtime.memory import disable_malloc_trim

Main = Callable[[DictConfig, Path], None]
PER_VARIANT = ("train", "irl", "clearance")  # stages DVC runs once per variant, each in a folder of its own


def launch(main: Main, stage: str) -> None:
    """Run a stage from the command line; InputError, or a file in the way, ends it with one line and exit code 2.

    `--params FILE [key=value ...]` reads resolved parameters and writes to `paths.<stage>`, as DVC wants it;
    otherwise Hydra composes conf/ (`--multirun` sweeps) and the run writes to Hydra's output directory.
    """
    disable_malloc_trim()
    try:
        failed = _from_params(main, stage, sys.argv[1:]) if "--params" in sys.argv[1:] else _from_hydra(main, stage)
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        sys.exit(130)
    if failed:
        sys.exit(2)


def _from_params(main: Main, stage: str, argv: list[str]) -> bool:
    """Whether the run failed."""
    at = argv.index("--params")

    def run() -> None:
        if len(argv) < at + 2:
            raise InputError("--params needs a file: python -m pipeline.stages.<stage> --params params.yaml")
        overrides = argv[:at] + argv[at + 2 :]  # DVC gives none, and will run the other stages, too
        cfg = load(Path(argv[at + 1]), overrides, [stage] if overrides else GRAPH)
        need(cfg, "seed", cfg.seed is None, "null, since DVC keeps the files of all seeds; for one, leave --params out")
        out_dir = _folder(Path(cfg.paths[stage]), stage, cfg)
        out_dir.mkdir(parents=True, exist_ok=True)
        main(cfg, out_dir)

    return _failed(run)


def _from_hydra(main: Main, stage: str) -> bool:
    """Compose conf/ and run, each combination of a sweep whatever became of the others; whether any failed.

    Hydra's folders carry the stage's name (by itself it would name them after this file). A sweep over what the stage
    does not read, which would give the same results under several names, is refused, unless a launcher runs each
    combination in a process of its own: none knows of the others then.
    """
    import hydra
    from hydra.core.hydra_config import HydraConfig

    failures, runs = [], {}

    def run(cfg: DictConfig) -> None:
        def once() -> None:
            try:
                OmegaConf.resolve(cfg)
            except OmegaConfBaseException as error:
                raise InputError(f"parameters do not resolve ({error}): mend the override") from error
            validate(cfg, [stage])
            asked, read = HydraConfig.get().job.override_dirname, read_by(cfg, stage)
            before = asked if read is None else runs.setdefault(read, asked)
            if before != asked:
                raise InputError(
                    f"{asked}: nothing that stage {stage} reads differs from {before}. What stages before it read goes "
                    "into their files: sweep it with `dvc exp run -S`, which runs those again"
                )
            main(cfg, _folder(Path(HydraConfig.get().runtime.output_dir), stage, cfg))

        failures.append(_failed(once))

    if not any(argument.startswith("hydra.job.name=") for argument in sys.argv):
        overrides = [i for i, argument in enumerate(sys.argv) if "=" in argument and not argument.startswith("-")]
        sys.argv.insert(min(overrides, default=len(sys.argv)), f"hydra.job.name={stage}")
    hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run)()
    return any(failures)


def _folder(folder: Path, stage: str, cfg: DictConfig) -> Path:
    """Where a stage writes: variants fitted by one stage lie side by side, as those who read them expect."""
    return folder / cfg.variant if stage in PER_VARIANT else folder


def _failed(run: Callable[[], None]) -> bool:
    """Run it; whether it ended with an error that a person can put right, which is then said in one line."""
    try:
        run()
    except (InputError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return True
    return False
