"""Fill the texts of a recording, `texts.md.j2`."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.legend import label
from pipeline.viewer.contents import grouped

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)
_TEMPLATES.globals |= {"label": label, "grouped": grouped}


def text(name: str, *shown: Any) -> str:
    """Return the markdown text that the macro `name` makes of a run, or of several."""
    return getattr(_TEMPLATES.get_template("texts.md.j2").module, name)(*shown)
