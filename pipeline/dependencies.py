"""Does dvc.yaml name the code each stage runs? Every stage depends on exactly the modules it imports.

python -m pipeline.dependencies            exit 1 where dvc.yaml and a stage's import closure differ
python -m pipeline.dependencies --write    write the closures into dvc.yaml
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import grimp
from ruamel.yaml import YAML

from pipeline.writing import write_whole

ROOT = Path(__file__).resolve().parent.parent
GRAPH = ROOT / "dvc.yaml"
HARMLESS = "pipeline.schema"  # it can refuse parameters, which DVC watches by themselves, but no result comes from it


def import_closures(stages: list[str]) -> dict[str, list[str]]:
    """Per stage the files of every `pipeline` module it imports, directly or not, itself included; sorted.

    HARMLESS is left out: to change them makes no result stale.
    """
    graph = grimp.build_graph("pipeline", cache_dir=None)
    closures = {}
    for stage in stages:
        modules = {f"pipeline.stages.{stage}"}
        modules |= graph.find_upstream_modules(f"pipeline.stages.{stage}")
        modules |= {m.rsplit(".", level)[0] for m in set(modules) for level in range(1, m.count(".") + 1)}
        closures[stage] = sorted(_file(m) for m in modules if not m.startswith(HARMLESS))
    return closures


def differences(dvc_yaml: Mapping, closures: Mapping[str, list[str]]) -> list[str]:
    """One line per module that a stage lists without importing it, or imports without listing it."""
    lines = []
    for stage, closure in closures.items():
        listed = {d for d in dvc_yaml["stages"][stage]["deps"] if _is_code(d)}
        lines += [f"{stage}: imports {path}, which dvc.yaml does not list" for path in sorted(set(closure) - listed)]
        lines += [f"{stage}: dvc.yaml lists {path}, which it does not import" for path in sorted(listed - set(closure))]
    return lines


def _file(module: str) -> str:
    path = Path(*module.split("."))
    package = path / "__init__.py"
    return str(package if (ROOT / package).is_file() else path.with_suffix(".py"))


def _is_code(dependency: str) -> bool:
    return dependency.startswith("pipeline/") and dependency.endswith(".py")


def _main(write: bool) -> int:
    yaml = YAML()
    yaml.width = 120
    content = yaml.load(GRAPH.read_text())
    closures = import_closures(list(content["stages"]))
    found = differences(content, closures)
    if write and found:
        for stage, closure in closures.items():
            deps = content["stages"][stage]["deps"]
            kept = [d for d in deps if not _is_code(d)]
            deps[:] = closure + kept
        write_whole(GRAPH, lambda part: yaml.dump(content, part))
        return 0
    for line in found:
        print(f"error: {line}; run `make deps`", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(_main("--write" in sys.argv[1:]))
