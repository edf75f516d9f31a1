"""The results of a small made-up experiment, read as the stage reads them."""

import pytest

from pipeline.report.results import Results
from pipeline.stages.report import read_results
from tests.report_artefacts import write_all


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return read_results(write_all(tmp_path_factory.mktemp("artefacts")))
