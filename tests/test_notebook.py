"""The notebook says what its code prints."""

import io
import json
from contextlib import redirect_stdout

import pytest

from pipeline.runtime.places import ROOT


@pytest.mark.slow
def test_the_notebook_of_the_library_prints_what_it_shows():
    cells, names = json.loads((ROOT / "docs/library.ipynb").read_text(encoding="utf-8"))["cells"], {}
    for cell in (cell for cell in cells if cell["cell_type"] == "code"):
        with redirect_stdout(io.StringIO()) as printed:
            exec("".join(cell["source"]), names)
        assert printed.getvalue() == "".join(line for output in cell["outputs"] for line in output["text"])
