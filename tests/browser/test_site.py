"""The pages in a real browser: quiet, reachable by everyone, readable on a phone, in the dark and on paper."""

from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser

from pipeline.report.render import PAGES
from tests.browser.conftest import Opened

PHONE, DESK, SHEET = 390, 1440, 688  # [px]; the last is A4's 210 mm less the margins of page.css
every_page = pytest.mark.parametrize("name", PAGES)


@every_page
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [PHONE, DESK])
def test_axe_finds_no_violation(opened: Opened, name: str, width: int, scheme: str):
    results = Axe().run(opened(name, width, scheme))
    assert results.violations_count == 0, results.generate_report()


@every_page
@pytest.mark.parametrize("width", [PHONE, DESK])
def test_no_page_scrolls_sideways(opened: Opened, name: str, width: int):
    assert opened(name, width).evaluate("document.documentElement.scrollWidth") == width


@every_page
def test_every_figure_loads_and_no_request_leaves_the_machine(browser: Browser, site: Path, name: str):
    page, messages, requests = browser.new_page(), [], []
    page.on("console", lambda message: messages.append(message.text))
    page.on("request", lambda request: requests.append(request.url))
    page.goto((site / f"{name}.html").as_uri())
    page.evaluate("document.querySelectorAll('img').forEach(image => { image.loading = 'eager'; })")
    page.wait_for_function("[...document.images].every(image => image.complete)")
    assert page.evaluate("[...document.images].every(image => image.naturalWidth > 0)")
    page.close()
    assert messages == [] and all(url.startswith("file://") for url in requests)


def test_the_first_page_fits_four_screens(opened: Opened):
    assert opened("index").evaluate("document.documentElement.scrollHeight") <= 4 * 900


def test_the_dark_scheme_turns_page_and_figures_dark(opened: Opened):
    grounds = [
        opened("causes", scheme=s).evaluate("getComputedStyle(document.body).backgroundColor")
        for s in ("light", "dark")
    ]
    assert grounds == ["rgb(255, 255, 255)", "rgb(20, 23, 26)"]
    shots = [opened("causes", scheme=s).locator("figure img").first.screenshot() for s in ("light", "dark")]
    assert shots[0] != shots[1]


@every_page
def test_paper_shows_every_table_and_figure_within_the_sheet(opened: Opened, name: str):
    page = opened(name, SHEET)
    page.emulate_media(media="print")
    parts = page.locator("table, img")
    assert parts.evaluate_all("all => Math.max(...all.map(one => one.getBoundingClientRect().right))") <= SHEET
    assert not page.get_by_role("navigation").is_visible()
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")


def test_every_page_leads_to_every_other_by_keyboard(opened: Opened):
    page = opened("index")
    for title in list(PAGES.values())[1:]:
        page.get_by_role("navigation").get_by_role("link", name=title, exact=True).press("Enter")
        page.wait_for_load_state()
        current = page.locator("nav [aria-current]")
        assert current.inner_text() == title


def test_the_first_control_skips_to_the_content(opened: Opened):
    page = opened("accuracy")
    page.keyboard.press("Tab")
    skip = page.get_by_role("link", name="Skip")
    assert skip.bounding_box()["y"] >= 0  # pyright: ignore[reportOptionalSubscript]
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
