"""Write what a report says to the files that planners read ("Files for robots" in docs/own-tables.md)."""

import importlib.util
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from jaxtyping import Bool
from numpy import ndarray as Array

from pipeline.models.base import ValidityModel
from pipeline.own.fitting import VARIANT
from pipeline.own.results import Results
from pipeline.stats.scores import DECISION

FIELDS = 50  # of a mask, along the table's longer side
STANDING_M = 1e-3  # length of the path by which a place is asked [m of the model]
PATH = "nav_msgs/msg/Path"


def write_exports(results: Results, folder: Path) -> None:
    """Write all of them into a folder."""
    text = "# Lengths in metres. docs/own-tables.md says what each line is.\n"
    known = {"users": {user: specification(results, user) for user in results.fitted}}
    text += yaml_text(known)
    (folder / "specification.yaml").write_text(text, encoding="utf-8")
    (folder / "keep_out").mkdir()
    size_m, objects = results.folder.frame.size_m, results.folder.seen.objects
    for number, (user, fitted) in enumerate(results.fitted.items(), 1):
        for scene, name in enumerate(results.folder.scenes, 1):
            stem = folder / "keep_out" / f"user_{number}-scene_{scene}"
            mask = keep_out(fitted.model, objects[[scene - 1]], size_m)
            write_mask(stem, mask, max(size_m), f"{user}, {name}")
    if importlib.util.find_spec("rosbags"):
        _write_bag(folder / "repaired", results)


def specification(results: Results, user: str) -> dict[str, Any]:
    """Return what is known of a user, in plain types."""

    def interval(row: Any, name: str) -> dict[str, Any]:
        mean, *ends = (round(float(row[column]), 4) for column in (name, "ci_low", "ci_high"))
        return {name: mean, "interval_95": ends}

    scores = results.tables["scores"]
    own = scores[(scores["user"] == user) & (scores["predictor"] == VARIANT) & (scores["share"] == 1)].iloc[0]
    said: dict[str, Any] = {"demonstrations": int(own["demonstrations"]), "scenes": int(own["scenes"])}
    said["sure"] = interval(own, "accuracy") | {"invalid_paths_accepted": round(float(own["missed"]), 4)}
    kinds: dict[str, Any] = {}
    if "interventions" in results.tables:
        asked, kept = (results.tables[name].set_index(["user", "kind"]) for name in ("interventions", "distances"))
        for kind in results.added:
            kinds[kind] = {"verdict": str(asked.loc[(user, kind), "verdict"])}
            kinds[kind] |= interval(asked.loc[(user, kind)], "effect")
            if (user, kind) in kept.index:
                kinds[kind]["keep_away"] = interval(kept.loc[(user, kind)], "radius_m")
    named = {item.kind for items in results.folder.told.values() for item in items if item.kind}
    return said | {"kinds": kinds, "never_tested": sorted(named - kinds.keys())}


def yaml_text(values: dict[str, Any]) -> str:
    """Return YAML that 1.1 and 1.2 read alike: PyYAML leaves 1e5 bare, which is a text in the former alone."""

    class Dumper(yaml.SafeDumper): ...

    def quoted(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
        return dumper.represent_scalar(dumper.DEFAULT_SCALAR_TAG, text, style="" if text.isidentifier() else "'")

    Dumper.add_representer(str, quoted)
    return yaml.dump(values, Dumper=Dumper, sort_keys=False, allow_unicode=True)


def keep_out(model: ValidityModel, seen: Any, size_m: tuple[float, float]) -> Bool[Array, "row column"]:
    """Return where the model rejects standing on a table of this width and depth, row 0 at the far edge.

    seen: the objects, or the picture, of one scene.
    """
    width, depth = (max(1, round(FIELDS * each / max(size_m))) for each in size_m)
    x, y = np.meshgrid((np.arange(width) + 0.5) / FIELDS, (np.arange(depth)[::-1] + 0.5) / FIELDS)
    places = np.stack([x, y], -1).reshape(1, -1, 1, 2)
    standing = np.concatenate([places, places + np.array([STANDING_M, 0])], axis=2)
    return (model.probability(seen, standing)[0] <= DECISION).reshape(depth, width)


def write_mask(stem: Path, mask: Bool[Array, "row column"], side_m: float, title: str) -> None:
    """Write a mask as PGM with the yaml of Nav2's map server; its origin is the table's near left corner."""
    grey = np.where(mask, 0, 254).astype(np.uint8)  # occupied and free, as Nav2 reads them
    stem.with_suffix(".pgm").write_bytes(cv2.imencode(".pgm", grey)[1].tobytes())
    told = {"image": f"{stem.name}.pgm", "mode": "trinary", "resolution": side_m / FIELDS, "origin": [0.0, 0.0, 0.0]}
    told |= {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196}
    text = f"# {''.join(c if c.isprintable() else '?' for c in title)}\n{yaml.safe_dump(told, sort_keys=False)}"
    stem.with_suffix(".yaml").write_text(text, encoding="utf-8")


def _write_bag(folder: Path, results: Results) -> None:
    """Write each repaired path in frame `table` on its user's topic; its stamp is its row in tables/repaired.csv."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    upright = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        names = {user: f"/repaired/user_{number}" for number, user in enumerate(results.fitted, 1)}
        topics = {user: bag.add_connection(name, PATH, typestore=store) for user, name in names.items()}
        for second, row in enumerate(results.tables["repaired"].itertuples(), 2):  # as a spreadsheet counts
            points = results.repaired_paths(str(row.user), str(row.scene)).get(str(row.demo))
            if points is not None:
                stamp = types["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
                header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="table")
                places = [types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0) for x, y in points.tolist()]
                poses = [types["geometry_msgs/msg/Pose"](position=place, orientation=upright) for place in places]
                stamped = [types["geometry_msgs/msg/PoseStamped"](header=header, pose=pose) for pose in poses]
                message = types[PATH](header=header, poses=stamped)
                bag.write(topics[str(row.user)], second * 1_000_000_000, store.serialize_cdr(message, PATH))
