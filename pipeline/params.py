"""Parameters: conf/ composed into params.yaml, the check that they agree, and the ranges they must keep.

python -m pipeline.params                  write params.yaml from conf/
python -m pipeline.params profile=smoke    the same with Hydra overrides
python -m pipeline.params --check          exit 1 if params.yaml is not what conf/ composes
"""

import sys
from collections.abc import Collection, Sequence
from pathlib import Path

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, OmegaConfBaseException
from pydantic import ValidationError

from pipeline.config import AGREEMENTS, Agreed, sentence
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

CONF = Path(__file__).resolve().parent.parent / "conf"
PARAMS = Path("params.yaml")
GRAPH = tuple(AGREEMENTS)  # every stage that needs something of several groups
COMPOSED = ("profile", "protocol", "seeds", "train.model", "validation_seeds")  # what conf/ makes other parameters of


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """conf/config.yaml with Hydra `overrides`, every interpolation resolved."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException

    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = hydra_compose("config", overrides=list(overrides))
        OmegaConf.resolve(cfg)
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(f"conf/ with overrides {list(overrides)} does not compose: {error}") from error
    validate(cfg)
    return cfg


def render(cfg: DictConfig) -> str:
    """The text of params.yaml: the very bytes DVC writes for `dvc exp run -S`."""
    return OmegaConf.to_yaml(cfg)


def load(path: Path, overrides: Sequence[str] = (), stages: Collection[str] = ()) -> DictConfig:
    """Parameters from a params.yaml with dotted `overrides` (`variant=ae`); InputError if they make none.

    `stages`: of `validate`.
    """
    if not path.is_file():
        raise InputError(f"no parameters at {path}: run `python -m pipeline.params` to write them from conf/")
    try:
        cfg = OmegaConf.create(path.read_text())
        if not isinstance(cfg, DictConfig) or not cfg:
            raise InputError(f"{path} holds no mapping: run `python -m pipeline.params` to write it anew")
        OmegaConf.set_struct(cfg, True)
        _not_composed(overrides)
        cfg.merge_with_dotlist(list(overrides))
        OmegaConf.resolve(cfg)
        validate(cfg, stages)
    except ConfigAttributeError as error:
        raise InputError(
            f"{path} with {list(overrides)} has no parameter {error.full_key}: conf/ names them all, and "
            "`python -m pipeline.params` writes them anew"
        ) from error
    except (UnicodeDecodeError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise InputError(
            f"{path} with {list(overrides)} is not parameters ({error}): run `python -m pipeline.params`"
        ) from error
    return cfg


def _not_composed(overrides: Sequence[str]) -> None:
    """Raise InputError for an override that would leave what was composed of the parameter as it is."""
    for override in overrides:
        name = override.partition("=")[0]
        for made in COMPOSED:
            if name == made or name.startswith(f"{made}."):
                raise InputError(
                    f"override {override!r} would leave the parameters that are composed of {made} as they are: run "
                    f"`python -m pipeline.params {override}`, or the stage without --params"
                )


def validate(cfg: DictConfig, stages: Collection[str] = ()) -> None:
    """Raise InputError for the first parameter out of its range, before any work is done.

    And for the first that does not suit others with which one of `stages` (of GRAPH, all there are) reads it.
    """
    try:
        Agreed.model_validate(OmegaConf.to_container(cfg, resolve=True), context=stages)
    except ValidationError as error:
        raise InputError(f"{sentence(error)}; change it in conf/ or on the command line") from error


def need(cfg: DictConfig, name: str, holds: bool, expected: str) -> None:
    """Raise InputError, which says what a parameter is and what was expected, unless that holds."""
    if not holds:
        raise InputError(f"parameter {name} is {OmegaConf.select(cfg, name)!r}: expected {expected}")


def read_by(cfg: DictConfig, stage: str) -> str | None:
    """As text, what a stage reads: the parameters dvc.yaml lists for it, and those that DVC does not watch.

    None for a stage that dvc.yaml does not have; InputError if it is no graph.
    """
    path = CONF.parent / "dvc.yaml"
    try:
        stages = yaml.safe_load(path.read_text())["stages"]
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise InputError(f"{path} is no graph of stages ({error}): mend it, or take it from git") from error
    if stage not in stages:
        return None
    of_job = ("variant", "seed") if "matrix" in stages[stage] else ()  # what a stage of one model at a time is told
    names = [*stages[stage].get("params", []), *of_job, "workers", "paths"]
    values = {name: OmegaConf.select(cfg, name.replace("${item.variant}", cfg.variant)) for name in names}
    return OmegaConf.to_yaml(OmegaConf.create(values))


def _main(argv: list[str]) -> int:
    check = "--check" in argv
    cfg = compose([a for a in argv if a != "--check"])
    validate(cfg, GRAPH)
    text = render(cfg)
    if not check:
        atomic_write(PARAMS, lambda part: part.write_text(text))
        return 0
    if PARAMS.is_file() and PARAMS.read_text() == text:
        return 0
    print(f"error: {PARAMS} is not what conf/ composes: run `python -m pipeline.params`", file=sys.stderr)
    return 1


if __name__ == "__main__":
    try:
        sys.exit(_main(sys.argv[1:]))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
