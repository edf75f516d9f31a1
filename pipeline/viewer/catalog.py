"""Serve recordings as Rerun's catalog: a table of all runs and one of their worst scenes, with links to each.

Runs carry their facts as properties (`run.properties`). What is known later, the commit and what people said of a
run, lies in a layer that is added to a recording in the catalog and leaves its file as it is.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.table import Column, SortBy, TableBlueprint, TableLayout
from rerun.catalog import CatalogClient, DatasetEntry
from rerun.server import Server

from pipeline.runtime.errors import InputError
from pipeline.viewer.run import OVERVIEW, REPAIR
from pipeline.viewer.scene import APPLICATION

RUNS, SCENES = "runs", "worst_scenes"  # the catalog's tables
SEGMENT, LINK = "rerun_segment_id", "recording link"  # Rerun's columns with a run's name and its address
RUN_COLUMNS = ["variant", "user", "seed", "accuracy", "unsafe_repairs", "repairs", "verdicts_right", "verdicts"]
OTHERS = ["n_demos", "profile", "source", "data_version"]  # after the reviews
WORST = ["scene", "step", "wrong", "unsafe_repairs"]  # of `run.properties`
REVIEW = ["verdict", "note", "who", "when", "commit"]
SCENE_COLUMNS = {
    "id": pa.int64(), "run": pa.string(), "variant": pa.string(), "user": pa.string(), "seed": pa.int64(),
    "scene": pa.int64(), "unsafe_repairs": pa.int64(), "wrong": pa.float64(), "verdict": pa.string(),
    "note": pa.string(), "link": pa.string(),
}  # fmt: skip


@contextmanager
def catalog(
    files: Mapping[str, Path], layouts: Mapping[str, rrb.Blueprint], reviews: pd.DataFrame, commit: str
) -> Iterator[CatalogClient]:
    """Serve recordings (`files` by name) to this machine alone, and yield a client of the catalog.

    layouts: blueprints of the overview and of runs, by `OVERVIEW` and `RUNS`. reviews: run, scene (missing: the whole
    run) and what was said (REVIEW without the commit), the last one counts. Raises InputError without Rerun's extra.
    """
    kinds: dict[str, Any] = {RUNS: [path for name, path in files.items() if name != OVERVIEW]}
    kinds |= {OVERVIEW: [files[OVERVIEW]]} if OVERVIEW in files else {}
    with TemporaryDirectory() as scratch, Server(host="127.0.0.1", datasets=kinds) as server:
        try:
            client = server.client()
        except ImportError as error:
            raise InputError(f"the catalog needs an extra: pip install -e .[review] ({error})") from error
        folder = Path(scratch)
        for name in kinds:
            layouts[name].save(name, folder / f"{name}.rbl")
            client.get_dataset(name).register_blueprint((folder / f"{name}.rbl").as_uri())
        dataset = client.get_dataset(RUNS)
        if not dataset.segment_ids():
            raise InputError("no recording of a run can be read here: expected those of stage record; run `make repro`")
        whole = reviews[reviews["scene"].isna()].drop_duplicates("run", keep="last").set_index("run")
        layers = []
        for run in dataset.segment_ids():
            facts = {"commit": commit} | (whole.loc[run, REVIEW[:-1]].to_dict() if run in whole.index else {})
            layers.append(_layer(folder / f"{run}.rrd", run, facts))
        dataset.register(layers, layer_name="review").wait()
        _show_runs(dataset, folder / "columns.rbl")
        _add_scenes(client, dataset, reviews, folder / "scenes.rbl")
        yield client


def facts_of_runs(client: CatalogClient) -> list[dict[str, Any]]:
    """Return variant, user, seed and accuracy of each `run`, and lists of its worst scenes (WORST, in the plural)."""
    runs = []
    for row in client.get_dataset(RUNS).segment_table().to_pandas().to_dict("records"):
        facts = {str(name).removeprefix("property:"): value for name, value in row.items()}
        if facts.get("run:variant") is None:  # a recording of another program
            continue
        lists = {f"{name}s": facts.get(f"worst:{name}") for name in WORST}
        lists = {name: [] if x is None else list(x) for name, x in lists.items()}  # none: every path is valid
        run = {name: facts[f"run:{name}"][0] for name in ("variant", "user", "seed", "accuracy")}
        runs.append(run | {"run": row[SEGMENT]} | lists)
    return runs


def _layer(path: Path, run: str, facts: Mapping[str, str]) -> str:
    """Write a recording of a run's property `review`, and return its address."""
    recording = rr.RecordingStream(APPLICATION, recording_id=run, send_properties=False)
    recording.save(path)
    recording.send_property("review", rr.AnyValues(drop_untyped_nones=True, **facts))
    recording.flush()
    recording.disconnect()
    return path.as_uri()


def _show_runs(dataset: DatasetEntry, path: Path) -> None:
    """Order the columns of the table of runs, and sort it by accuracy, the lowest first."""
    names = {f"property:run:{name}": name for name in RUN_COLUMNS}
    names |= {f"property:review:{name}": name for name in REVIEW}
    names |= {f"property:run:{name}": name for name in OTHERS}
    columns = [Column(LINK, name="open"), *(Column(x, name=name) for x, name in names.items())]
    hidden = "property:RecordingInfo:name", *(f"property:worst:{name}" for name in WORST)
    columns += [Column(name, visible=False) for name in (SEGMENT, *hidden)]
    TableBlueprint(table_layout=TableLayout(columns=columns), sort_by="property:run:accuracy").save(RUNS, path)
    dataset.register_blueprint(path.as_uri(), segment_table=True)


def _add_scenes(client: CatalogClient, dataset: DatasetEntry, reviews: pd.DataFrame, path: Path) -> None:
    """Add the table of the runs' worst scenes, with links to the end of their repairs, most unsafe repairs first."""
    said = reviews.dropna(subset="scene").drop_duplicates(["run", "scene"], keep="last").set_index(["run", "scene"])
    rows = []
    for run in facts_of_runs(client):
        who = {name: run[name] for name in ("variant", "user", "seed", "run")}
        for scene, step, wrong, unsafe in zip(*(run[f"{name}s"] for name in WORST), strict=True):
            key = run["run"], scene
            review = said.loc[key, ["verdict", "note"]].to_dict() if key in said.index else {}
            shown = {"scene": scene, "unsafe_repairs": unsafe, "wrong": wrong, "id": len(rows)}
            rows.append(who | shown | review | {"link": dataset.segment_url(run["run"], REPAIR, int(step))})
    index = {rr.SORBET_IS_TABLE_INDEX: "true"}
    fields = [pa.field(name, kind, metadata=index if name == "id" else None) for name, kind in SCENE_COLUMNS.items()]
    table = client.create_table(SCENES, pa.schema(fields))
    table.append(**{name: [row.get(name) for row in rows] for name in SCENE_COLUMNS})
    columns = [Column("link", name="open", column_type=rr.components.Url), Column("id", visible=False)]
    columns += [Column(name, name=name) for name in SCENE_COLUMNS if name not in ("link", "id")]
    layout = TableLayout(columns=columns)
    TableBlueprint(table_layout=layout, sort_by=SortBy("unsafe_repairs", direction="descending")).save(SCENES, path)
    table.register_blueprint(path.as_uri())
