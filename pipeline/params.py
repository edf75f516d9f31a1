"""Compose conf/ into params.yaml, check that they agree, and check every parameter.

python -m pipeline.params                  write params.yaml from conf/, with the overrides in conf/composed.yaml
python -m pipeline.params profile=smoke    the same with these Hydra overrides, which conf/composed.yaml keeps
python -m pipeline.params '~variants.ae'   a smaller graph: dvc.yaml's lists of variants follow
python -m pipeline.params profile=paper    back to the paper
python -m pipeline.params --check          exit 1 if params.yaml or dvc.yaml is not what conf/ composes
python -m pipeline.params --check --out F  write F, too, if they agree: DVC's stage params
"""

import argparse
import shlex
import sys
from collections.abc import Collection, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigAttributeError, OmegaConfBaseException
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from pipeline.config.graph import ROOT, graph_files, listed_variants, stage_entry, with_variants
from pipeline.config.settings import NEEDS, Settings, check_study, is_study
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import explain
from pipeline.runtime.writing import atomic_write

CONF = ROOT / "conf"
COMPOSED_WITH = CONF / "composed.yaml"
PARAMS = Path("params.yaml")
GRAPH = tuple(NEEDS)  # the paper's stages with requirements across several groups
# parameter -> the parameters in params.yaml that conf/ composes from it
COMPOSED = {"profile": "", "train.model": "variants"}
COMPOSED |= dict.fromkeys(("protocol", "seeds", "validation_seeds"), "protocol")


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """Return conf/config.yaml with Hydra `overrides`, resolved and checked.

    Variants and users that an override removes also leave all lists of names. Raises InputError.
    """
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException

    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = hydra_compose("config", overrides=list(overrides))
        OmegaConf.resolve(cfg)
    except (HydraException, OmegaConfBaseException, yaml.YAMLError, OSError, ValueError) as error:  # no name of a file
        raise InputError(f"conf/ with overrides {list(overrides)} does not compose: {explained(error)}") from error
    drop_absent(cfg)
    with open_dict(cfg):
        cfg.composed = list(overrides)
    validate(cfg)
    return cfg


def composed_with() -> list[str]:
    """Return the overrides that conf/composed.yaml names. Raises InputError for a file that holds no list of them."""
    try:
        overrides = yaml.safe_load(COMPOSED_WITH.read_text(encoding="utf-8"))["composed"]
        return [str(override) for override in overrides]
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError) as error:
        raise InputError(
            f"{COMPOSED_WITH} names no overrides ({error}): expected `composed: []`; restore it with git"
        ) from error


def explained(error: Exception) -> str:
    """Return Hydra's message, or the unknown parameter: Hydra does not name one inside an override's dictionary."""
    name = getattr(error.__cause__, "full_key", None)
    message = str(error).partition("\nConfig search path:")[0]
    return f"unknown parameter {name!r} (see conf/; + in front of the override adds it)" if name else message


def drop_absent(cfg: DictConfig) -> None:
    """Remove absent variants, users and studies from the lists of `cfg`, and questions that lack a second user.

    Leave `cfg` as it is where a group that has lists is none: `validate` says so.
    """
    if not all(isinstance(x, DictConfig) for x in (cfg.variants, cfg.users, cfg.evaluate, cfg.record, cfg.report)):
        return
    variants = {path.stem for path in (CONF / "variants").glob("*.yaml")} - set(cfg.variants)
    users = set(OmegaConf.load(CONF / "users.yaml")["users"]) - set(cfg.users)  # pyright: ignore
    with open_dict(cfg):
        for comparison in list(cfg.evaluate.comparisons):
            comparison.against = [name for name in comparison.against if name not in variants]
            if comparison.variant in variants or not comparison.against:
                cfg.evaluate.comparisons.remove(comparison)
        cfg.record.first = [name for name in cfg.record.first if name not in variants]
        cfg.report.shown = [name for name in cfg.report.shown if name not in variants] or list(cfg.variants)[:3]
        if len(cfg.users) < 2:
            cfg.questions = {n: q for n, q in cfg.get("questions", {}).items() if q.get("kind") != "user"}
        cfg.evaluate.users = [name for name in cfg.evaluate.users if name not in users]
        if cfg.variant in variants:
            cfg.variant = next(iter(cfg.variants))
        if "studies" in cfg:
            cfg.studies = {n: s for n, s in cfg.studies.items() if (ROOT / "studies" / str(n) / "stage.py").is_file()}


def load(path: Path, overrides: Sequence[str] = (), stages: Collection[str] = ()) -> DictConfig:
    """Return the parameters of a params.yaml with dotted `overrides` (`variant=ae`), checked as by `validate`.

    Raises InputError for an invalid file or override.
    """
    if not path.is_file():
        raise InputError(f"{path} is missing: run `python -m pipeline.params` to write it from conf/")
    try:
        cfg = OmegaConf.create(path.read_text())
        if not isinstance(cfg, DictConfig) or not cfg:
            raise InputError(f"{path} is not a mapping: run `python -m pipeline.params` to write it again")
        OmegaConf.set_struct(cfg, True)
        for override, source in product(overrides, COMPOSED):
            if f"{override.partition('=')[0]}.".startswith(f"{source}."):
                raise InputError(
                    f"{override}: params.yaml holds other parameters that were composed of {source}. Run "
                    f"`python -m pipeline.params {override}`, or the stage without --params"
                )
        cfg.merge_with_dotlist(list(overrides))
        OmegaConf.resolve(cfg)
    except ConfigAttributeError as error:
        raise InputError(f"unknown parameter {error.full_key!r} in {list(overrides)} (see conf/)") from error
    except (UnicodeDecodeError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise InputError(
            f"{path} with {list(overrides)} could not be read ({error}): run `python -m pipeline.params`"
        ) from error
    validate(cfg, stages)
    return cfg


def refuse_recomposed(cfg: DictConfig) -> None:
    """Raise InputError if params.yaml has lost all values that the overrides in conf/composed.yaml had given it.

    `dvc exp run -S` composes conf/ anew, without them.
    """
    overrides = composed_with()
    if not overrides or list(cfg.composed) != overrides:
        return
    kept, plain = (_leaves(OmegaConf.to_container(compose(chosen))) for chosen in (overrides, []))
    now = _leaves(OmegaConf.to_container(cfg))
    given = {key for key in kept.keys() | plain.keys() if key != ".composed" and kept.get(key) != plain.get(key)}
    has_kept, has_plain = (any(now.get(key) == tree.get(key) for key in given) for tree in (kept, plain))
    if has_plain and not has_kept:
        again = " ".join(f"-S {shlex.quote(override)}" for override in overrides)
        raise InputError(
            f"params.yaml was composed without {' '.join(overrides)}, which conf/composed.yaml names: repeat it as in "
            f"`dvc exp run {again}`, or run `python -m pipeline.params profile=paper` first"
        )


def _leaves(tree: Any, name: str = "") -> dict[str, Any]:
    """Return dotted name (.train.steps) -> value of a nested mapping; lists are values."""
    if not isinstance(tree, dict):
        return {name: tree}
    return {key: value for part, sub in tree.items() for key, value in _leaves(sub, f"{name}.{part}").items()}


def validate(cfg: DictConfig, stages: Collection[str] = ()) -> None:
    """Raise InputError for the first invalid parameter, before any work is done.

    `stages`: the stages and studies about to run; their requirements across groups are checked too.
    """
    prefix = ""
    try:
        settings = Settings.model_validate(OmegaConf.to_container(cfg, resolve=True), context=stages)
        for name in settings.studies:
            prefix = f"studies.{name}."
            if is_study(name):
                check_study(name, settings, agree=name in stages)
    except ValidationError as error:
        raise InputError(f"{explain(error, prefix)}; change it in conf/ or on the command line") from error
    except PydanticCustomError as error:
        stated = "parameter {name} is {value!r}: expected ".format(**error.context) if error.context else ""
        raise InputError(f"{stated}{error.message()}; change it in conf/ or on the command line") from error


def need(cfg: DictConfig, name: str, holds: bool, expected: str) -> None:
    """Raise InputError with the parameter's name, its value and what was expected, unless `holds`."""
    if not holds:
        raise InputError(f"parameter {name} is {OmegaConf.select(cfg, name)!r}: expected {expected}")


def names_read(cfg: DictConfig, stage: str) -> list[str]:
    """Return the names of the parameters that a stage reads: those listed in dvc.yaml, and those DVC does not track.

    Empty for a stage that no dvc.yaml contains.
    """
    entry = stage_entry(stage)
    if entry is None:
        return []
    names = [*entry.get("params", []), *(("variant", "seed") if "matrix" in entry else ()), "workers", "paths"]
    return [str(name).replace("${item.variant}", cfg.variant) for name in names]


def read_by(cfg: DictConfig, stage: str) -> str:
    """Return, as YAML, the parameters that a stage reads; all of them for a stage that no dvc.yaml contains."""
    names = names_read(cfg, stage)
    return OmegaConf.to_yaml(OmegaConf.create({name: OmegaConf.select(cfg, name) for name in names}) if names else cfg)


def refuse_unread(cfg: DictConfig, stage: str, overrides: Sequence[str]) -> None:
    """Raise InputError for an override that the stage does not read, as it would mislabel an unchanged result.

    `overrides`: as on Hydra's command line. Stages that no dvc.yaml contains accept every override.
    """
    read = names_read(cfg, stage)
    for override in overrides if read else ():
        name = override.lstrip("+~").partition("=")[0].rpartition("@")[2]
        targets = [name, *(target for source, target in COMPOSED.items() if f"{name}.".startswith(f"{source}."))]
        pairs = [(f"{target}.", f"{own}.") for target, own in product(targets, read)]
        if "" not in targets and not any(a.startswith(b) or b.startswith(a) for a, b in pairs):
            raise InputError(
                f"{override}: stage {stage} does not read {name} (it reads {', '.join(read)}). If an earlier stage "
                f"reads it, run that one again, too: `dvc exp run -S {override} {stage}`"
            )


def main(argv: list[str]) -> int:
    """Write or check params.yaml and dvc.yaml's lists of variants; return the exit code."""
    if {"-h", "--help"} & set(argv):
        print(__doc__)
        return 0
    parser = argparse.ArgumentParser(prog="python -m pipeline.params", add_help=False, exit_on_error=False)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--out", type=Path)
    options, given = parser.parse_known_args(argv)
    if unknown := [argument for argument in given if argument.startswith("-")]:
        raise InputError(f"unknown option {unknown[0]!r}: expected --check or overrides such as train.steps=100")
    overrides = given or composed_with()
    cfg = compose(overrides)
    validate(cfg, GRAPH)
    stage_of = {str(name): str(variant.stage) for name, variant in cfg.variants.items()}
    before = listed_variants()
    files = {PARAMS: OmegaConf.to_yaml(cfg)}  # byte for byte as DVC writes it for `dvc exp run -S`
    files |= {path: with_variants(path.read_text(), stage_of, before) for path in graph_files()}
    if overrides != composed_with():
        first = COMPOSED_WITH.read_text(encoding="utf-8").splitlines()[0]
        files[COMPOSED_WITH] = f"{first}\n{yaml.safe_dump({'composed': overrides}, default_flow_style=True)}"
    stale = [path for path, text in files.items() if not path.is_file() or path.read_text() != text]
    if options.check and stale:
        command = shlex.join(["python", "-m", "pipeline.params", *given])
        print(f"error: {stale[0]} is not what conf/ composes: run `{command}`", file=sys.stderr)
        return 1
    for path in stale:
        atomic_write(path, lambda part, path=path: part.write_text(files[path]))
    for study in cfg.get("studies", {}):
        try:
            validate(cfg, [study])
        except InputError as error:
            print(f"note: study {study} will not run: {error}", file=sys.stderr)
    if options.out:
        atomic_write(options.out, lambda part: part.write_text("params.yaml is what conf/ composes\n"))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
