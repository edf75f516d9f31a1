"""Stages as dvc.yaml lists them."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import yaml
from omegaconf import DictConfig, OmegaConf

from pipeline.runtime.places import ROOT

Stage = Callable[[DictConfig, Path], None]


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
    """Run pipeline.stages.<name> or studies.<name>.stage; it fails if it reads what dvc.yaml does not list for it."""
    package, _, module = main.__module__.rpartition(".")
    main(listed(cfg, package.rpartition(".")[2] if module == "stage" else module), out)
    return out
