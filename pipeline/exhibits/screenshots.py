"""Pictures of recordings, for the report: those that show recordings as they are now."""

from collections.abc import Mapping
from pathlib import Path

from pipeline.recording.screenshot import read_png
from pipeline.report.pictures.recordings import Shot


def current(folder: Path, digests: Mapping[str, str]) -> dict[str, Shot]:
    """The pictures in `folder` by name, but for those of recordings that now have another digest, or none.

    InputError for a file that is no picture of a recording.
    """
    shots = {path.stem: read_png(path) for path in sorted(folder.glob("*.png"))}
    return {
        name: Shot(shot.recording, shot.image)
        for name, shot in shots.items()
        if digests.get(shot.recording) == shot.contents
    }
