"""Read LeRobot data sets of formats v2 and v3: columns from parquet, a demonstration's picture from video."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import av  # pyright: ignore[reportMissingImports]
import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy import ndarray as Array
from pydantic import BaseModel, NonNegativeInt, PositiveInt, ValidationError, field_validator

from pipeline.own.importing.segments import Choices, Recording
from pipeline.own.importing.text import pair
from pipeline.runtime.errors import InputError

STATE = "observation.state"  # the feature whose columns need not be named in full
NUMBERS = ("episode_chunk", "episode_index", "chunk_index", "file_index")  # in the names of videos


class Feature(BaseModel):
    """Check what a data set says of one feature: its type, the names of its columns, and the shape of a row."""

    dtype: str
    names: list[Any] | dict[str, list[Any]] | None = None  # some robots put them into groups
    shape: list[int] = []


class Info(BaseModel):
    """Check what is read of meta/info.json; other keys are ignored."""

    codebase_version: str
    features: dict[str, Feature]
    total_episodes: NonNegativeInt
    chunks_size: PositiveInt = 1000
    video_path: str | None = None

    @field_validator("video_path")
    @classmethod
    def _names_a_file(cls, template: str | None) -> str | None:
        try:
            (template or "").format(video_key="", **dict.fromkeys(NUMBERS, 0))
        except (AttributeError, LookupError, ValueError) as error:
            raise ValueError(f"{template!r} is no name with {', '.join(NUMBERS)} and video_key in braces") from error
        return template


def read(path: Path, choices: Choices) -> tuple[list[Recording], Choices, list[str]]:
    """Return the episodes, the choices with what was found, and remarks; InputError for an unusable data set."""
    file = path / "meta" / "info.json"
    try:
        info = Info.model_validate_json(file.read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ": ".join([str(file), *filter(None, [".".join(map(str, first["loc"]))])])
        raise InputError(f"{place}: {first['msg']}; expected what LeRobot writes: copy it again") from error
    version, features, count = info.codebase_version, info.features, info.total_episodes
    if not version.startswith(("v2.", "v3.")):
        raise InputError(f"{path} has the format {version}: expected v2.0, v2.1 or v3.0; convert it by LeRobot")
    cameras = [key for key, one in features.items() if one.dtype == "video"]
    if choices.picture not in (None, *cameras) or (choices.picture is None and len(cameras) > 1):
        raise InputError(f"{path} has the cameras {', '.join(cameras) or 'none'}: choose one of them by --picture")
    names = {name: (key, i) for key, one in features.items() for i, name in enumerate(_names(key, one))}
    columns = choices.named
    if "x" not in columns:
        columns |= pair([name for name in names if name.startswith(STATE)]) or pair(names)
    places = {role: names.get(name) or names.get(f"{STATE}.{name}") for role, name in columns.items() if role != "t"}
    if not {"x", "y"} <= places.keys() or None in places.values():
        lacking = ", ".join(columns[role] for role, place in places.items() if place is None) or "x and y are"
        known = f"{path} has the columns {', '.join(names) or 'without names'}: {lacking} not among them"
        raise InputError(f"{known}; choose by --columns x=NAME,y=NAME, --gripper NAME, --label NAME")
    camera = choices.picture or next(iter(cameras), None)
    videos = _videos(path, info, camera) if camera else None
    recordings: dict[int, Recording] = {}
    lost = 0
    for file in sorted(path.glob("data/*/*.parquet")):
        table = _parquet(file, ["episode_index", "timestamp", *(key for key, _ in filter(None, places.values()))])
        for key, i in filter(None, places.values()):
            if len(table[key]) and i >= (width := table[key].shape[1]):
                raise InputError(f"{file}: {key} has {width} numbers a row, meta/info.json names more: copy it again")
        for episode in np.unique(table["episode_index"]).astype(int).tolist():
            rows = table["episode_index"][:, 0] == episode
            values = {role: table[place[0]][rows, place[1]] for role, place in places.items() if place}
            t, xy = table["timestamp"][rows, 0], np.stack([values["x"], values["y"]], -1)
            kept = np.isfinite(t) & np.isfinite(xy).all(1)
            lost, t, xy = lost + int((~kept).sum()), t[kept], xy[kept]
            values = {role: column[kept] for role, column in values.items()}

            def pictures(at: Sequence[int], t: Array = t, episode: int = episode) -> Iterator[bytes | None]:
                return (_frame(*videos[episode], float(t[row])) if videos else None for row in at)

            name = f"{path.resolve().name}-{episode:03d}"
            words = [(i, f"{word:g}") for i, word in enumerate(values.get("valid", ()), 1)]
            recordings[episode] = Recording(name, t, xy, values.get("gripper"), words, True, {}, pictures)
    if missing := {*range(count)} - recordings.keys():
        raise InputError(f"{path} lacks {len(missing)} of {count} episodes, the first {min(missing)}: copy it again")
    if more := recordings.keys() - {*range(count)}:
        raise InputError(f"{path} holds the episode {max(more)}, meta/info.json names {count} episodes: copy it again")
    if not any(len(one.t) for one in recordings.values()) and lost:
        raise InputError(f"{path} has no row with a time and a position: choose others by --columns")
    notes = [f"{lost} rows without a position were left out"] if lost else []
    choices = choices.model_copy(update={"columns": columns, "picture": camera})
    return [one for one in recordings.values() if len(one.t)], choices, notes


def _names(key: str, feature: Feature) -> list[str]:
    """Return the names of a feature's columns; single numbers have none."""
    names = feature.names or []
    names = [name for group in names.values() for name in group] if isinstance(names, dict) else names
    if feature.dtype in ("video", "image", "string"):
        return []
    return [key] if feature.shape == [1] else [f"{key}.{name}" for name in names]


def _parquet(file: Path, keys: Sequence[str]) -> dict[str, Array]:
    """Return columns of a parquet file as matrices (row, value)."""
    try:
        names = pq.read_schema(file).names
    except pa.ArrowInvalid as error:
        why = "it is truncated, or a pointer of Git LFS: copy it again, or run `git lfs pull` in the clone"
        raise InputError(f"{file} is no whole parquet file: {why}") from error
    if missing := {*keys} - {*names}:
        raise InputError(f"{file} has no column {', '.join(sorted(missing))}: copy it again, or see --columns")
    table = pq.read_table(file, columns=[*dict.fromkeys(keys)])
    matrices = {}
    for key in keys:
        column = table[key].combine_chunks()
        nested = pa.types.is_nested(column.type)
        widths = pc.unique(pc.list_value_length(column)).to_pylist() if nested else [1]
        try:
            matrices[key] = np.array(column.flatten() if nested else column, float).reshape(len(table), *widths)
            whole = not key.endswith(("_index", "/from_timestamp")) or np.isfinite(matrices[key]).all()
        except (TypeError, ValueError):
            whole = False
        if not whole:
            raise InputError(f"{file}: {key} is not a number, or equally many numbers, in each row: copy it again")
    return matrices


def _videos(path: Path, info: Info, camera: str) -> dict[int, tuple[Path, float]]:
    """Return the video of each episode, and when in it the episode begins [s]."""
    template, videos = info.video_path, {}
    if template is None:
        raise InputError(f"{path}/meta/info.json: video_path: Field required for the camera {camera}: copy it again")
    if info.codebase_version.startswith("v2."):
        for i in range(info.total_episodes):
            place = template.format(video_key=camera, episode_chunk=i // info.chunks_size, episode_index=i)
            videos[i] = path / place, 0.0
    keys = [f"videos/{camera}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    for file in sorted(path.glob("meta/episodes/*/*.parquet")):
        table = _parquet(file, ["episode_index", *keys])
        for i, chunk, number, begin in np.hstack(list(table.values())).tolist():
            place = template.format(video_key=camera, chunk_index=int(chunk), file_index=int(number))
            videos[int(i)] = path / place, begin
    if missing := {*range(info.total_episodes)} - videos.keys():
        raise InputError(f"{path}/meta/episodes lacks {len(missing)} episodes, the first {min(missing)}: copy it again")
    return videos


def _frame(video: Path, begin: float, t: float) -> bytes:
    """Return the frame at `begin + t` [s] as png; by PyAV, as OpenCV's wheels cannot decode AV1, LeRobot's default."""
    with av.open(str(video)) as container:
        stream: Any = container.streams.video[0]
        container.seek(int((begin + t) / stream.time_base), stream=stream)
        half = 0.5 / float(stream.average_rate)
        frame = next((one for one in container.decode(stream) if one.time > begin + t - half), None)
    if frame is None:
        raise InputError(f"{video} ends before {begin + t:.6g} s, where a demonstration begins: copy it again")
    return cv2.imencode(".png", frame.to_ndarray(format="bgr24"))[1].tobytes()
