"""Compute a digest of a recording's contents.

The bytes of Rerun's files differ from run to run (ids of rows, chunks and stores, times of the blueprint). The contents
are therefore read with Rerun's reader, sorted and hashed.
"""

import hashlib
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader

from pipeline.runtime.errors import InputError

Cell = tuple[str, str, tuple[tuple[str, int], ...], bytes]  # entity, component, times, value


def digest(path: Path) -> str:
    """Return the sha256 (hexadecimal) of all values in the recording at `path`, with entity, component and times.

    Raises InputError for a file that Rerun cannot read to its end.
    """
    try:
        reader = RrdReader(path)
        stores = [*reader.recordings(), *reader.blueprints()]
        cells = [cell for store in stores for chunk in reader.stream(store=store).to_chunks() for cell in _cells(chunk)]
    except Exception as error:  # of Rerun, whose reader names no class for it
        raise InputError(f"{path} is damaged ({error}): delete its folder and run `make repro`") from error
    hashed = hashlib.sha256()
    for entity, component, times, value in sorted(cells):
        for part in (entity.encode(), component.encode(), repr(times).encode(), value):
            hashed.update(len(part).to_bytes(8, "little") + part)
    return hashed.hexdigest()


def worst_scenes(path: Path) -> list[int]:
    """Return the numbers of a run's worst scenes, as its recording at `path` names them; of an overview none."""
    batches = [c.to_record_batch() for c in RrdReader(path).stream().filter(content="/__properties/worst").to_chunks()]
    return [scene for batch in batches if "scene" in batch.schema.names for scene in batch["scene"][0].as_py()]


def _cells(chunk: Chunk) -> list[Cell]:
    """Return one cell per row and component, without absent values, whose presence depends on chunking."""
    batch = chunk.to_record_batch()
    timelines = sorted(name for name in chunk.timeline_names if name != "log_time")  # of the blueprint alone
    times = {name: batch.column(name).cast(pa.int64()).to_pylist() for name in timelines}
    cells = []
    for i, field in enumerate(batch.schema):
        metadata = {k.decode(): v.decode() for k, v in (field.metadata or {}).items()}
        if metadata.get("rerun:kind", "data") != "data":
            continue
        for row, value in enumerate(batch.column(i)):
            if value.is_valid:
                when = tuple((name, times[name][row]) for name in timelines)
                cells.append((str(chunk.entity_path), field.name, when, _canonical(value.values)))
    return cells


def _canonical(array: pa.Array) -> bytes:
    """Return an Arrow array's type, length, nulls and values, without its buffers' offsets and padding."""
    head = f"{array.type}|{len(array)}|".encode() + np.packbits(array.is_valid().to_numpy(False)).tobytes()
    if pa.types.is_fixed_size_list(array.type) or pa.types.is_list(array.type) or pa.types.is_large_list(array.type):
        lengths = np.array(array.value_lengths().fill_null(0).to_pylist(), dtype="<i8")
        return head + lengths.tobytes() + _canonical(array.flatten())
    if pa.types.is_struct(array.type):
        return head + b"".join(_canonical(child) for child in array.flatten())
    if pa.types.is_integer(array.type) or pa.types.is_floating(array.type):
        return head + array.fill_null(0).to_numpy(False).tobytes()
    return head + repr(array.to_pylist()).encode()
