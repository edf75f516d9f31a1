"""Pictures of recordings, and what they are said to show."""

import io
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass

from PIL import Image

from pipeline.report.results import Results
from pipeline.report.wording import listed, percent, variant_phrase


@dataclass(frozen=True)
class Shot:
    """Rerun's viewer, open on a recording."""

    recording: str
    image: Image.Image


@dataclass(frozen=True)
class Shown:
    """An image of the page with its two texts."""

    caption: str
    alt: str
    source: str  # data URI: WebP without loss
    width: int  # [px]
    height: int  # [px]


def screenshots(results: Results, shots: Mapping[str, Shot]) -> list[Shown]:
    """Those pictures of recordings that the page has words for, in its order."""
    captions = {
        "overview": "The overview: a table with items never seen, the truth, and what each variant believes of it and "
        "where that is wrong (orange: invalid and called valid; blue: valid and called invalid).",
        "repairs": "A run, in that of its recorded scenes where it errs most: repairs in the picture and on the maps; "
        "below, step by step, the model's probability and the true room.",
        "learning": "A run's training: its map of a new scene beside the truth, and its losses.",
    }
    shown = []
    for name in (name for name in captions if name in shots):
        shot, buffer = shots[name], io.BytesIO()
        shot.image.save(buffer, "WEBP", lossless=True, method=4)
        source = "data:image/webp;base64," + b64encode(buffer.getvalue()).decode()
        opens = "make review" if shot.recording == "overview" else f"make review RUN={shot.recording}"
        caption = f"{captions[name]} To open it: {opens}."
        shown.append(Shown(caption, _alt(results, shot.recording), source, *shot.image.size))
    return shown


def _alt(results: Results, recording: str) -> str:
    """What the recording's maps say: how far they agree with the truth."""
    agreement = results.recorded["agreement"].dropna()
    if recording in agreement.index:
        return (
            f"Rerun's viewer with the recording {recording}: its maps of the recorded new scenes agree with the "
            f"truth in {percent(agreement[recording])} of their cells."
        )
    user, seed = results.judged_users[0], results.seeds[0]
    parts = [f"{variant_phrase(v)} {percent(agreement[f'{v}-{user}-s{seed}'])}" for v in results.variants]
    return (
        f"Rerun's viewer with the overview of the variants: the shares of their maps' cells, in the recorded "
        f"scenes, that agree with the truth, user {user}, are {listed(parts)}."
    )
