"""The committed report in a real browser: quiet, reachable by everyone, readable on a phone and on paper."""

from collections.abc import Callable

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from tests.browser.conftest import REPORT

PHONE, DESK, SHEET = 390, 1280, 688  # [px]; the last is A4's 210 mm less the margins of page.css
Opened = Callable[..., Page]


def test_the_page_is_quiet_and_asks_for_nothing_else(browser: Browser):
    page = browser.new_page()
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(REPORT)
    for summary in page.locator("summary").all():
        summary.click()
    page.close()
    assert said == [] and asked == [REPORT]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [PHONE, DESK])
def test_axe_finds_no_violation(opened: Opened, width: int, scheme: str):
    results = Axe().run(opened(width, scheme, unfolded=True))
    assert results.violations_count == 0, results.generate_report()


@pytest.mark.parametrize("width", [PHONE, DESK])
def test_the_page_never_scrolls_sideways(opened: Opened, width: int):
    page = opened(width, unfolded=True)
    assert page.evaluate("document.documentElement.scrollWidth") == width


@pytest.mark.parametrize(
    "use", [lambda link: link.click(), lambda link: link.press("Enter")], ids=["mouse", "keyboard"]
)
def test_every_link_of_the_contents_leads_to_its_section(opened: Opened, use: Callable):
    page = opened()
    links = page.get_by_role("navigation").get_by_role("link").all()
    assert len(links) == page.locator("main > section").count()
    for link in links:
        use(link)
        target = link.get_attribute("href") or ""
        assert page.url == REPORT + target
        assert page.locator(target).bounding_box()["y"] < page.viewport_size["height"]  # pyright: ignore


@pytest.mark.parametrize("use", ["click", "Enter", "Space"])
def test_folded_parts_open_and_close(opened: Opened, use: str):
    for details in opened().locator("details").all():
        summary = details.locator("summary")
        for is_open in (True, False):
            summary.click() if use == "click" else summary.press(use)
            assert details.locator("table").first.is_visible() is is_open


@pytest.mark.parametrize("use", ["click", "Enter"])
def test_the_numbers_are_a_link_away(opened: Opened, use: str):
    page = opened()
    link = page.get_by_role("link", name="metrics.json")
    link.click() if use == "click" else link.press(use)
    page.wait_for_url("**/metrics.json")


def test_the_keyboard_reaches_every_control_in_order_and_shows_where_it_is(opened: Opened):
    page = opened(unfolded=True)
    controls = page.locator("a, summary, select:enabled, input:enabled, [tabindex='0']")
    for i in range(controls.count()):
        page.keyboard.press("Tab")
        assert controls.nth(i).evaluate("one => one === document.activeElement")
        assert controls.nth(i).evaluate("one => getComputedStyle(one).outlineStyle") != "none"


def test_the_first_control_skips_the_contents(opened: Opened):
    page = opened()
    page.keyboard.press("Tab")
    skip = page.get_by_role("link", name="Skip")
    assert skip.bounding_box()["y"] >= 0  # pyright: ignore[reportOptionalSubscript]
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    assert page.locator("main :focus").count() == 1


def test_wide_tables_scroll_by_the_keyboard(opened: Opened):
    page = opened(PHONE)
    table = page.get_by_role("group", name="Table: accuracy", exact=True)
    table.press("ArrowRight")
    page.wait_for_function("one => one.scrollLeft > 0", arg=table.element_handle())


def test_paper_shows_every_table_whole(opened: Opened):
    page = opened(SHEET)
    page.emulate_media(media="print")
    tables = page.locator("table")
    assert all(table.is_visible() for table in tables.all())
    assert tables.evaluate_all("all => Math.max(...all.map(one => one.getBoundingClientRect().right))") <= SHEET
    assert not page.get_by_role("navigation").is_visible()


def test_it_prints(opened: Opened):
    sheets = opened().pdf(prefer_css_page_size=True)
    assert sheets.startswith(b"%PDF") and 10 < sheets.count(b"/Type /Page\n") < 40
