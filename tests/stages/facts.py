"""What is true of every stage: it refuses bad settings before any work, names what is missing, reads what it lists."""

from collections.abc import Callable
from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.models import model_dir, weights_path
from pipeline.params import read_by, validate
from pipeline.runtime.errors import InputError

Stage = Callable[[DictConfig, Path], None]


def stage_name(main: Stage) -> str:
    """Return its name in dvc.yaml: "repair" of pipeline.stages.repair, "envelope" of studies.envelope.stage."""
    package, _, module = main.__module__.rpartition(".")
    return package.rpartition(".")[2] if module == "stage" else module


def refuses(main: Stage, cfg: DictConfig, name: str, value: object, message: str, out: Path) -> None:
    """With `name` set to `value`, checks and stage raise `message` and leave no `out`."""
    changed = cfg.copy()
    OmegaConf.set_struct(changed, False)
    OmegaConf.update(changed, name, value, merge=False)
    with pytest.raises(ValueError, match=message):
        validate(changed, [stage_name(main)])
        main(changed, out)
    assert not out.exists()


def names_a_missing_model(main: Stage, cfg: DictConfig, variant: str, out: Path) -> None:
    """Without one model's weights, the stage names their file and leaves no `out`."""
    path = weights_path(model_dir(cfg, variant), "careful", cfg.protocol.seeds[-1], cfg.main_n_demos)
    hidden = path.rename(path.with_suffix(".away"))
    try:
        with pytest.raises(InputError, match=f"{path.name} is missing: run stage"):
            main(cfg, out)
    finally:
        hidden.rename(path)
    assert not out.exists()


def listed(cfg: DictConfig, stage: str) -> DictConfig:
    """The parameters that dvc.yaml lists for the stage, and those DVC does not watch."""
    few = OmegaConf.create()
    for name, value in OmegaConf.create(read_by(cfg, stage) or "").items():
        OmegaConf.update(few, str(name).replace("${item.variant}", cfg.variant), value)
    OmegaConf.set_struct(few, True)
    return few


def run_as_listed(main: Stage, cfg: DictConfig, out: Path) -> Path:
    """Run the stage; it fails if it reads a parameter that dvc.yaml does not list for it."""
    main(listed(cfg, stage_name(main)), out)
    return out
