"""A headless Chromium of the system's, and a site from the factory's tables in it."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from pipeline.report.render import render
from pipeline.stages.report import write_site
from tests.report import factory

FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
Opened = Callable[..., Page]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    results = factory.results()
    write_site(render(results), folder, results.facts)
    (folder / "metrics.json").write_text("{}")
    return folder


@pytest.fixture
def opened(browser: Browser, site: Path) -> Iterator[Opened]:
    """Opens a page in a window so wide [px], in a light or dark scheme, every figure loaded."""
    pages: list[Page] = []

    def open_page(name: str, width: int = 1440, scheme: str = "light") -> Page:
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)  # pyright: ignore
        pages.append(page)
        page.goto((site / f"{name}.html").as_uri())
        page.evaluate("document.querySelectorAll('img').forEach(image => { image.loading = 'eager'; })")
        page.wait_for_function("[...document.images].every(image => image.complete)")
        return page

    yield open_page
    for page in pages:
        page.close()
