"""The pages from the factory's tables, drawn once."""

import pytest

from pipeline.report.page import Site
from pipeline.report.render import render
from tests.report import factory


@pytest.fixture(scope="session")
def site() -> Site:
    return render(factory.results())
