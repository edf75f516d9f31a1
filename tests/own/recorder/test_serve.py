"""The recorder's process: one a folder, for its own page only, and killed without loss."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.own.__main__ import main
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from tests.own.recorder.factory import Served, command, make_folder, recorder, samples

PATH = {"scene": "first", "user": "Zoë", "valid": True, "samples": samples().tolist()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_folder(tmp_path_factory.mktemp("recorder"))


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[Served]:
    with recorder(folder) as served:
        yield served


def test_a_second_recorder_of_a_folder_a_missing_folder_and_a_taken_port_are_refused(served, folder, tmp_path: Path):
    done = subprocess.run(command(folder), cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and served.url in done.stderr
    with pytest.raises(InputError, match="there is no folder"):
        main(["record", str(tmp_path / "nowhere"), "--no-browser"])
    with pytest.raises(InputError, match=f"port {served.port} cannot be used"):
        main(["record", str(make_folder(tmp_path)), "--no-browser", "--port", str(served.port)])


def test_other_pages_can_neither_write_nor_read(served: Served, folder: Path):
    for name, value in (
        *(("Origin", origin) for origin in ("http://example.org", "null", "")),
        *(("Host", host) for host in ("example.org", "127.0.0.1")),
        ("Sec_Fetch_Site", "cross-site"),
    ):
        assert served.ask("POST", "/api/paths", PATH, **{name: value})[0] == 403
        assert served.ask("GET", "/api/overview", **{name: value})[0] == 403
    assert not (folder / "demonstrations.csv").exists()


def test_no_address_leads_out_of_the_pictures(served: Served):
    for path in ("/pictures/..%2f..%2ftable.yaml", "/pictures/%2e%2e", "/static/..%2fapp.py", "/../app.py"):
        assert served.ask("GET", path)[0] in (400, 404)
