"""A headless Chromium of the system's, and the committed report in it as a reader has it before them."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

REPORT = (Path(__file__).parent.parent.parent / "reports" / "index.html").as_uri()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"))
        yield browser
        browser.close()


@pytest.fixture
def opened(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens the report in a window so wide [px], in a light or dark scheme, its folded parts open or not."""
    pages: list[Page] = []

    def open_report(width: int = 1280, scheme: str = "light", unfolded: bool = False) -> Page:
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)  # pyright: ignore
        pages.append(page)
        page.goto(REPORT)
        if unfolded:
            page.locator("details").evaluate_all("all => all.forEach(one => one.open = true)")
        return page

    yield open_report
    for page in pages:
        page.close()
