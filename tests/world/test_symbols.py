"""The kinds of item."""

from pathlib import Path

import pytest

from pipeline.runtime.errors import InputError
from pipeline.world.symbols import read_symbols


@pytest.mark.parametrize("kind", ["mug: {height: 0.02}", "mug: {height_m: 2}", "mug: {transparent: rim}", "[mug]", "{"])
def test_a_kind_with_a_wrong_value_is_refused(kind: str, tmp_path: Path):
    (tmp_path / "symbols.yaml").write_text(kind)
    with pytest.raises(InputError, match=r"symbols\.yaml: .*(height|transparent|dictionary|parsing)"):
        read_symbols(tmp_path / "symbols.yaml")
