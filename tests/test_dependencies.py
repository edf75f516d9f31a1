"""dvc.yaml and the code agree on what each stage runs."""

from pathlib import Path

from ruamel.yaml import YAML

from pipeline.dependencies import GRAPH, differences, import_closures

STAGES = Path(__file__).parent.parent / "pipeline" / "stages"


def _graph() -> dict:
    return YAML(typ="safe").load(GRAPH.read_text())


def test_every_stage_lists_exactly_the_modules_it_imports():
    content = _graph()
    assert differences(content, import_closures(list(content["stages"]))) == []


def test_a_change_of_what_parameters_may_be_makes_no_result_stale():
    content = _graph()
    assert (STAGES.parent / "schema" / "settings.py").is_file()
    assert not any(d.startswith("pipeline/schema/") for stage in content["stages"].values() for d in stage["deps"])


def test_a_stage_is_a_module_of_the_same_name():
    assert set(_graph()["stages"]) == {p.stem for p in STAGES.glob("*.py")} - {"__init__"}


def test_a_forgotten_and_a_stale_dependency_are_named():
    content = _graph()
    closures = import_closures(["evaluate"])
    deps = content["stages"]["evaluate"]["deps"]
    deps.remove("pipeline/stages/evaluate.py")
    deps.append("pipeline/gone.py")
    assert differences(content, closures) == [
        "evaluate: imports pipeline/stages/evaluate.py, which dvc.yaml does not list",
        "evaluate: dvc.yaml lists pipeline/gone.py, which it does not import",
    ]


def test_arrows_point_one_way():
    import grimp

    graph = grimp.build_graph("pipeline", cache_dir=None)
    rooms = ("table", "spec", "causal", "report", "recording", "artifacts", "fitting", "exhibits", "stages")
    allowed = {
        "table": set(), "spec": {"table"}, "causal": {"table"}, "report": {"table"}, "recording": {"table"},
        "artifacts": {"spec", "table"}, "fitting": {"artifacts", "spec", "table"},
        "exhibits": {"report", "recording", "artifacts", "spec", "causal", "table"}, "stages": set(rooms) - {"stages"},
    }  # fmt: skip
    for importer in rooms:
        for imported in set(rooms) - {importer} - allowed[importer]:
            chains = graph.find_shortest_chains(f"pipeline.{importer}", f"pipeline.{imported}", as_packages=True)
            direct = [c for c in chains if len(c) == 2]
            assert not direct, f"{importer} imports {imported}: {direct}"


def test_only_the_recording_room_imports_rerun():
    import grimp

    graph = grimp.build_graph("pipeline", include_external_packages=True, cache_dir=None)
    importers = graph.find_modules_that_directly_import("rerun")
    assert importers and all(m.startswith("pipeline.recording") for m in importers)
