"""Parameters: conf/ composed into params.yaml, the check that they agree, and the ranges they must keep.

python -m pipeline.params                  write params.yaml from conf/
python -m pipeline.params profile=smoke    the same with Hydra overrides
python -m pipeline.params --check          exit 1 if params.yaml is not what conf/ composes
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, OmegaConfBaseException

from pipeline.table.layout import SYMBOLS

CONF = Path(__file__).resolve().parent.parent / "conf"
PARAMS = Path("params.yaml")
FITTED_BY = {"vae": "train", "reward": "irl", "clearance": "path"}  # a variant's kind -> the stage that fits it
MAX_N = 10  # demonstrations a scene has at the most (paper: 10)
COMPOSED = ("profile", "protocol", "seeds", "train.model", "validation_seeds")  # what conf/ makes other parameters of


class InputError(ValueError):
    """Something a person can put right: says what came, what was expected and what to do."""


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


def load(path: Path, overrides: Sequence[str] = ()) -> DictConfig:
    """Parameters from a params.yaml with dotted `overrides` (`variant=ae`); InputError if they make none."""
    if not path.is_file():
        raise InputError(f"no parameters at {path}: run `python -m pipeline.params` to write them from conf/")
    try:
        cfg = OmegaConf.create(path.read_text())
        if not isinstance(cfg, DictConfig):
            raise InputError(f"{path} holds no mapping: run `python -m pipeline.params` to write it anew")
        OmegaConf.set_struct(cfg, True)
        _not_composed(overrides)
        cfg.merge_with_dotlist(list(overrides))
        OmegaConf.resolve(cfg)
        validate(cfg)
    except ConfigAttributeError as error:
        raise InputError(
            f"{path} with {list(overrides)} has no parameter {error.full_key}: conf/ names them all, and "
            "`python -m pipeline.params` writes them anew"
        ) from error
    except (yaml.YAMLError, OmegaConfBaseException) as error:
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


def validate(cfg: DictConfig) -> None:
    """Raise InputError for the first parameter out of its range, before any work is done."""

    def need(holds: bool, name: str, got: object, expected: str) -> None:
        if not holds:
            raise InputError(
                f"parameter {name} is {got!r}: expected {expected}; change it in conf/ or on the command line"
            )

    def whole(value: object, low: int, high: int = sys.maxsize) -> bool:
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high

    for name in ("seeds", "validation_seeds", "n"):
        need(OmegaConf.is_list(cfg[name]), name, cfg[name], "a list, such as [1, 3]")
    for name in ("users", "variants", "scenes", "demos", "paths", "protocol"):
        need(OmegaConf.is_dict(cfg[name]), name, cfg[name], "a mapping from names to values")
    for group in ("users", "variants"):
        for name, value in cfg[group].items():
            need(isinstance(name, str), f"a name in {group}", name, "letters: put it in quotes")
            need(OmegaConf.is_dict(value), f"{group}.{name}", value, "a mapping from names to values")
    for name, value in cfg.paths.items():
        need(isinstance(value, str), f"paths.{name}", value, "a path")
    for name in ("seeds", "validation_seeds"):
        seeds = list(cfg[name])
        need(len(seeds) > 0, name, seeds, "at least one seed")
        need(all(whole(s, 0) for s in seeds), name, seeds, "whole numbers from 0")
        need(len(set(seeds)) == len(seeds), name, seeds, "every seed once")
    shared = sorted(set(cfg.seeds) & set(cfg.validation_seeds))
    need(not shared, "validation_seeds", list(cfg.validation_seeds), f"none of `seeds` (shared: {shared})")
    for n in cfg.n:
        need(whole(n, 1, MAX_N), "n", n, f"whole numbers from 1 to {MAX_N}")
    need(len(cfg.n) > 0 and len(set(cfg.n)) == len(cfg.n), "n", list(cfg.n), "at least one value, each once")
    need(cfg.study_n in cfg.n, "study_n", cfg.study_n, f"one of n = {list(cfg.n)}")
    steps = OmegaConf.to_container(cfg)["checkpoints"]  # pyright: ignore
    each_once = isinstance(steps, list) and all(whole(step, 0) for step in steps) and len(set(steps)) == len(steps)
    need(each_once, "checkpoints", steps, "a list of whole numbers from 0, each once")
    need(
        whole(cfg.demos.per_scene, max(cfg.n), MAX_N),
        "demos.per_scene",
        cfg.demos.per_scene,
        f"a whole number from max(n) = {max(cfg.n)} to {MAX_N}",
    )
    need(cfg.variant in cfg.variants, "variant", cfg.variant, f"one of {', '.join(cfg.variants)}")
    for name, variant in cfg.variants.items():
        kind = variant.get("kind")
        need(kind in FITTED_BY, f"variants.{name}.kind", kind, f"one of {', '.join(FITTED_BY)}")
        stage = variant.get("stage")
        need(stage == FITTED_BY[kind], f"variants.{name}.stage", stage, f"{FITTED_BY[kind]}, which fits kind {kind}")
    need(cfg.seed is None or whole(cfg.seed, 0), "seed", cfg.seed, "null or a whole number from 0")
    known = [*cfg.seeds, *cfg.validation_seeds]
    need(cfg.seed is None or cfg.seed in known, "seed", cfg.seed, f"null or one of {known}")
    asked = cfg.protocol.get("seeds")
    of_known = OmegaConf.is_list(asked) and len(asked) > 0 and set(asked) <= set(known)
    need(of_known, "protocol.seeds", asked, f"a list of some of {known}")
    need(whole(cfg.workers, 1), "workers", cfg.workers, "a whole number from 1")
    need(len(cfg.users) > 0, "users", {}, "at least one user")
    for user, margins in cfg.users.items():
        need(
            set(margins) == set(SYMBOLS),
            f"users.{user}",
            dict(margins),
            f"a margin for each of {', '.join(SYMBOLS)}",
        )
        for symbol, margin in margins.items():
            need(
                margin is None or (isinstance(margin, int | float) and 0 <= margin < 1),
                f"users.{user}.{symbol}",
                margin,
                "null (does not care) or a margin from 0 to 1 [m]",
            )
    for name in ("per_seed", "shared", "validation", "calibration", "calibration_paths", "prior_side"):
        need(whole(cfg.scenes[name], 1), f"scenes.{name}", cfg.scenes[name], "a whole number from 1")


def _main(argv: list[str]) -> int:
    check = "--check" in argv
    text = render(compose([a for a in argv if a != "--check"]))
    if not check:
        temporary = PARAMS.with_suffix(".yaml.part")
        temporary.write_text(text)
        os.replace(temporary, PARAMS)
        return 0
    if PARAMS.is_file() and PARAMS.read_text() == text:
        return 0
    print(f"error: {PARAMS} is not what conf/ composes: run `python -m pipeline.params`", file=sys.stderr)
    return 1


if __name__ == "__main__":
    try:
        sys.exit(_main(sys.argv[1:]))
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
