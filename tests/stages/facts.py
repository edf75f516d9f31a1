"""What is true of every stage: it refuses bad settings before any work, names what is missing, reads what it lists."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
import torch
import yaml
from omegaconf import DictConfig, OmegaConf
from safetensors.torch import load_file

from pipeline.artifacts.models import model_dir, save_weights, weights_path
from pipeline.params import validate
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT

Stage = Callable[[DictConfig, Path], None]


def stage_name(main: Stage) -> str:
    """Return its name in dvc.yaml: "repair" of pipeline.stages.repair, "safety" of studies.safety.stage."""
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
    with _other_weights(cfg, variant) as path:
        path.unlink()
        with pytest.raises(InputError, match=f"{path.name} is missing: run stage"):
            main(cfg, out)
    assert not out.exists()


def names_a_model_with_nan(main: Stage, cfg: DictConfig, variant: str, out: Path) -> None:
    """With a weight that is NaN, the stage names the file and the weight, and leaves no `out`."""
    with _other_weights(cfg, variant) as path:
        weights = load_file(path)
        name = next(name for name, value in weights.items() if value.is_floating_point())
        save_weights(path, weights | {name: torch.full_like(weights[name], torch.nan)})
        with pytest.raises(InputError, match=rf"{path.name} has NaN or infinite values in {name}: delete it and fit"):
            main(cfg, out)
    assert not out.exists()


@contextmanager
def _other_weights(cfg: DictConfig, variant: str) -> Iterator[Path]:
    """The path of one model's weights, which are restored in the end."""
    path = weights_path(model_dir(cfg, variant), "careful", cfg.protocol.seeds[-1], cfg.main_n_demos)
    kept = path.read_bytes()
    yield path
    path.write_bytes(kept)


@cache
def all_stages() -> dict[str, dict]:
    """DVC's name of each stage, of the paper or a study, without its file -> its entry, resolved by params.yaml."""
    from dvc.parsing import DataResolver
    from dvc.repo import Repo

    with Repo(str(ROOT)) as repo:
        stages = {}
        for file in (ROOT / "dvc.yaml", *ROOT.glob("studies/dvc.yaml"), *sorted(ROOT.glob("studies/*/dvc.yaml"))):
            resolver = DataResolver(repo, str(file.parent), yaml.safe_load(file.read_text()))
            stages |= resolver.resolve()["stages"]
    return stages


def listed(cfg: DictConfig, stage: str) -> DictConfig:
    """The parameters that dvc.yaml lists for the stage, and those DVC does not watch."""
    stages = all_stages()
    entry = stages.get(f"{stage}@{cfg.variant}") or stages[stage]
    few = OmegaConf.create()
    for name in (*entry.get("params", []), "workers", "paths", "variant", "seed"):
        OmegaConf.update(few, name, OmegaConf.select(cfg, name))
    OmegaConf.set_struct(few, True)
    return few


def run_as_listed(main: Stage, cfg: DictConfig, out: Path) -> Path:
    """Run the stage; it fails if it reads a parameter that dvc.yaml does not list for it."""
    main(listed(cfg, stage_name(main)), out)
    return out
