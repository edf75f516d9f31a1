"""One `main(cfg, out_dir)` a stage, served to DVC (`--params params.yaml`) and to Hydra (everything else)."""

import sys
from collections.abc import Callable
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from pipeline.memory import keep_freed
from pipeline.params import CONF, load, validate

Main = Callable[[DictConfig, Path], None]
PER_VARIANT = ("train", "irl", "path")  # stages DVC runs once per variant, each in a folder of its own


def launch(main: Main, stage: str) -> None:
    """Run a stage from the command line; bad input ends it with one line on stderr and exit code 2.

    `--params FILE [key=value ...]` reads resolved parameters and writes to `paths.<stage>`, as DVC wants it;
    otherwise Hydra composes conf/ (`--multirun` sweeps) and the run writes to Hydra's output directory.
    """
    keep_freed()
    try:
        if "--params" in sys.argv[1:]:
            _from_params(main, stage, sys.argv[1:])
        else:
            _from_hydra(main, stage)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def _from_params(main: Main, stage: str, argv: list[str]) -> None:
    at = argv.index("--params")
    if len(argv) < at + 2:
        raise ValueError("--params needs a file: python -m pipeline.stages.<stage> --params params.yaml")
    cfg = load(Path(argv[at + 1]), argv[:at] + argv[at + 2 :])
    out_dir = Path(cfg.paths[stage])
    out_dir = out_dir / cfg.variant if stage in PER_VARIANT else out_dir
    out_dir.mkdir(parents=True, exist_ok=True)
    main(cfg, out_dir)


def _from_hydra(main: Main, stage: str) -> None:
    """Compose conf/ and run; Hydra's folders carry the stage's name (by itself it would name them after this file)."""
    import hydra
    from hydra.core.hydra_config import HydraConfig

    def run(cfg: DictConfig) -> None:
        OmegaConf.resolve(cfg)
        try:
            validate(cfg)
            main(cfg, Path(HydraConfig.get().runtime.output_dir))
        except (ValueError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            sys.exit(2)

    if not any(argument.startswith("hydra.job.name=") for argument in sys.argv):
        sys.argv.append(f"hydra.job.name={stage}")
    hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run)()
