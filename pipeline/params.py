"""Compose conf/ into params.yaml, and check every parameter.

python -m pipeline.params                  write params.yaml from conf/, with the overrides kept in conf/composed.yaml
python -m pipeline.params profile=smoke    the same with these Hydra overrides, kept there from now on
python -m pipeline.params '~variants.ae'   a smaller graph
python -m pipeline.params profile=paper    back to the paper
python -m pipeline.params --check          exit 1 if params.yaml is not what conf/ composes
python -m pipeline.params --check --out F  write F, too, if it is: DVC's stage params

conf/composed.yaml is a part of conf/: whatever composes it, `dvc exp run -S` too, gets the kept overrides. It also
lists what dvc.yaml runs once per name: the variants of each stage that fits, and the pages of studies.
"""

import argparse
import os
import re
import shlex
import sys
from collections.abc import Collection, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from pipeline.launch import FITTED, check, check_variant, explained
from pipeline.runtime.errors import InputError, reported
from pipeline.runtime.places import CONF, PARAMS, ROOT
from pipeline.runtime.settings import NAME, RESERVED, Shared, need, need_one
from pipeline.runtime.writing import atomic_write

COMPOSED = CONF / "composed.yaml"
GRAPH = ("scenes", "demos", *FITTED, "evaluate", "readings", "repair", "intervene", "record", "report")
HEAD = """# @package _global_
# Written by `python -m pipeline.params OVERRIDES`: what params.yaml was composed with, and the lists of dvc.yaml.
"""


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """Return conf/ with Hydra `overrides`, resolved; every value is in its range. Raises InputError."""
    cfg = _compose(overrides)
    validate(cfg)
    return cfg


def _compose(overrides: Sequence[str]) -> DictConfig:
    """Return conf/ with Hydra `overrides`, resolved, with the lists of dvc.yaml."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException

    for entry in yaml.safe_load((CONF / "config.yaml").read_text(encoding="utf-8"))["defaults"]:
        if isinstance(entry, dict) and not all(isinstance(name, str) for name in entry.values()):
            raise InputError(f"conf/config.yaml: defaults have {entry}: put the name in quotes")  # Hydra leaves it out
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = hydra_compose("config", overrides=list(overrides))
        OmegaConf.resolve(cfg)
    except (HydraException, OmegaConfBaseException, yaml.YAMLError, OSError, ValueError) as error:
        raise InputError(f"conf/ with overrides {list(overrides)} does not compose: {explained(error)}") from error
    with open_dict(cfg):
        # a profile may set parameters of a study whose folder was deleted
        cfg.studies = {n: s for n, s in cfg.studies.items() if (ROOT / "studies" / str(n) / "stage.py").is_file()}
        if isinstance(cfg.variants, DictConfig):
            cfg.graph = {stage: [n for n, v in cfg.variants.items() if v.get("stage") == stage] for stage in FITTED}
        cfg.graph["pages"] = list(cfg.studies)
    return cfg


def validate(cfg: DictConfig, stages: Collection[str] = ()) -> None:
    """Raise InputError for the first wrong parameter.

    `stages`: those and studies about to run, whose constraints between groups are checked, too.
    """
    unknown = set(cfg) - set(Shared.model_fields) - {*GRAPH, "variants", "questions", "studies"}
    if unknown:
        raise InputError(f"unknown parameter {min(map(str, unknown))!r}")
    for stage in GRAPH:
        check(cfg, stage, import_module(f"pipeline.stages.{stage}"), agree=stage in stages)
    for name, settings in cfg.variants.items():
        need_one(f"variants.{name}.stage", settings.get("stage"), FITTED)
        check_variant(cfg, str(name), import_module(f"pipeline.stages.{settings.stage}"))
    for study in map(str, cfg.studies):
        check(cfg, study, import_module(f"studies.{study}.stage"), agree=study in stages)


def _written() -> dict[str, Any]:
    """Return what conf/composed.yaml holds; raise InputError if it is missing or damaged."""
    try:
        return {name: yaml.safe_load(COMPOSED.read_bytes())[name] for name in ("defaults", "composed", "graph")}
    except (OSError, yaml.YAMLError, KeyError, TypeError) as error:
        restored = "`git checkout conf/composed.yaml` restores it"
        raise InputError(f"conf/composed.yaml is missing or damaged ({error!r}): {restored}") from error


def kept(overrides: Sequence[str], cfg: DictConfig | None = None) -> str:
    """Return a conf/composed.yaml with these overrides; its lists are those of `cfg`, or as they were.

    Variants are the files of conf/variants, new ones last, but those in the defaults of others that lack `compared`.
    Raises InputError for any other file that lacks it, and for an override that no file can hold.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    before = _written()
    loaded = {path.stem: OmegaConf.load(path) for path in sorted((CONF / "variants").glob("*.yaml"))}
    files = {name: file if isinstance(file, DictConfig) else OmegaConf.create() for name, file in loaded.items()}
    parts = {str(part) for file in files.values() for part in file.get("defaults", [])}
    known = [name for name, file in files.items() if "compared" in file or name not in parts]
    if lacking := [name for name in known if "compared" not in files[name]]:
        wanted = "add `compared: true` or `compared: false`, whether studies and recordings show it"
        raise InputError(f"conf/variants/{lacking[0]}.yaml has no `compared`: {wanted}")
    for name in known:
        usable = re.match(NAME, name) and name not in RESERVED and OmegaConf.from_dotlist([f"v={name}"]).v == name
        other = f"another name, of letters, digits, - and _, that YAML reads as text; none of {', '.join(RESERVED)}"
        need(bool(usable), "variants", name, other)
    entries = [next(iter(entry)) for entry in before["defaults"] if entry != "_self_"]
    listed = [key.partition(".")[2] for key in entries if key.startswith("variants@")]
    variants = [*(v for v in listed if v in known), *(v for v in known if v not in listed)]
    groups: dict[str, str | None] = {"profile": "paper"}
    values = OmegaConf.create()
    try:
        for override in OverridesParser.create().parse_overrides(list(overrides)):
            key, group = override.key_or_group, override.key_or_group.partition(".")[0]
            if override.is_sweep_override():
                raise InputError(f"{override.input_line}: expected one value")
            if override.is_delete():
                if not (CONF / group).is_dir():
                    raise InputError(f"{override.input_line}: only variants, users, questions, studies can be left out")
                groups[f"override /{group}@{key}"] = None
            elif (CONF / key).is_dir():
                new = override.is_add() or key == "profile"
                groups[("" if new else "override /") + override.get_key_element().lstrip("+")] = override.value()  # pyright: ignore[reportArgumentType]
            else:
                OmegaConf.update(values, key, override.value(), force_add=True)
    except HydraException as error:
        raise InputError(explained(error)) from error
    defaults = [{f"variants@variants.{v}": v} for v in variants] + [{key: value} for key, value in groups.items()]
    graph = before["graph"] if cfg is None else OmegaConf.to_container(cfg.graph)
    own: Any = {"defaults": [*defaults, "_self_"], "composed": list(overrides), "graph": graph}
    return HEAD + yaml.safe_dump(own | OmegaConf.to_container(values), sort_keys=False, width=120)  # pyright: ignore


def _note_unread(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Print a note on each file of a user that no default names, and no override leaves out."""
    for name in sorted({path.stem for path in (CONF / "users").glob("*.yaml")} - {str(user) for user in cfg.users}):
        if f"~users.{name}" not in overrides:
            line = f'`- users@users.{name}: "{name}"`'
            print(f"note: conf/users/{name}.yaml is not read: add {line} to conf/config.yaml", file=sys.stderr)


def main(argv: list[str]) -> int:
    """Write or check params.yaml and conf/composed.yaml; return the exit code."""
    parser = argparse.ArgumentParser("python -m pipeline.params", description=__doc__, allow_abbrev=False)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("overrides", nargs="*", metavar="parameter=value")
    given = parser.parse_intermixed_args(argv)
    overrides = given.overrides or _written()["composed"]
    before = COMPOSED.read_text(encoding="utf-8")
    overrides = [override for override in overrides if override != "profile=paper"]
    if given.check:
        cfg = _compose([])
        _note_unread(cfg, overrides)
        written = {COMPOSED: kept(overrides, cfg), PARAMS: OmegaConf.to_yaml(cfg)}
        if stale := [p for p, text in written.items() if not p.is_file() or p.read_text(encoding="utf-8") != text]:
            command = shlex.join(["python", "-m", "pipeline.params", *given.overrides])
            command += " && dvc repro params`, then the experiment again" if "DVC_EXP_NAME" in os.environ else "`"
            print(f"error: {stale[0].name} is not what conf/ composes: run `{command}", file=sys.stderr)
            return 1
        if given.out:
            atomic_write(given.out, lambda part: part.write_bytes(b"params.yaml is what conf/ composes\n"))
        return 0
    try:
        COMPOSED.write_text(kept(overrides), encoding="utf-8")
        cfg = _compose([])
        validate(cfg, GRAPH)
    except BaseException:
        COMPOSED.write_text(before, encoding="utf-8")
        raise
    _note_unread(cfg, overrides)
    COMPOSED.write_text(kept(overrides, cfg), encoding="utf-8")
    atomic_write(PARAMS, lambda part: part.write_text(OmegaConf.to_yaml(cfg), encoding="utf-8"))  # as DVC writes it
    for stage in FITTED:  # stages that compare variants read these, also where a graph has none of one kind
        Path(cfg.paths[stage]).mkdir(parents=True, exist_ok=True)
    for study in map(str, cfg.studies):
        try:
            check(cfg, study, import_module(f"studies.{study}.stage"))
        except InputError as error:
            print(f"note: study {study} will not run: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    with reported(OSError, yaml.YAMLError):
        if Path.cwd() != ROOT:
            raise InputError(f"this is not the project's folder, whose params.yaml is written: run it in {ROOT}")
        sys.exit(main(sys.argv[1:]))
