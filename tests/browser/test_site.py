"""The pages in a real browser: quiet, reachable by everyone, readable on a phone, in the dark and on paper."""

import re
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser

from pipeline.report.render import PAGES
from tests.browser.conftest import Opened

PHONE, DESK, SHEET = 390, 1440, 688  # [px]; the last is A4's 210 mm less the margins of page.css
every_page = pytest.mark.parametrize("name", PAGES)


@every_page
@pytest.mark.parametrize(("width", "scheme"), [(DESK, "light"), (PHONE, "dark")])
def test_axe_finds_no_violation_and_no_page_scrolls_sideways(opened: Opened, name: str, width: int, scheme: str):
    page = opened(name, width, scheme)
    results = Axe().run(page)
    assert results.violations_count == 0, results.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth") == width


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
    pages = [opened("causes", scheme=scheme) for scheme in ("light", "dark")]
    grounds = [page.evaluate("getComputedStyle(document.body).backgroundColor") for page in pages]
    assert grounds == ["rgb(255, 255, 255)", "rgb(20, 23, 26)"]
    shots = [page.locator("figure img").first.screenshot() for page in pages]
    assert shots[0] != shots[1]


@every_page
def test_paper_shows_every_table_and_figure_within_the_sheet(opened: Opened, name: str):
    page = opened(name, SHEET)
    page.emulate_media(media="print")
    parts = page.locator("table, img, object")
    assert parts.evaluate_all("all => Math.max(...all.map(one => one.getBoundingClientRect().right))") <= SHEET
    assert not page.get_by_role("navigation").is_visible()
    assert page.pdf(prefer_css_page_size=True).startswith(b"%PDF")


def test_the_reproduction_summary_prints_on_one_sheet(opened: Opened):
    sheets = re.findall(rb"/Type\s*/Page\b", opened("reproduction", SHEET).pdf(prefer_css_page_size=True))
    assert len(sheets) == 1


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


def test_headings_stand_at_the_side_of_wide_pages_and_lead_to_their_section(opened: Opened):
    page = opened("accuracy")
    contents = page.get_by_role("navigation", name="On this page")
    contents.get_by_role("link").last.click()
    assert page.locator("h2").last.bounding_box()["y"] < 900  # pyright: ignore[reportOptionalSubscript]
    assert contents.is_visible() and not opened("accuracy", PHONE).locator(".contents").is_visible()


def test_the_arrow_keys_move_the_path_and_the_verdicts_are_spoken(opened: Opened):
    page = opened("index")
    handle, status = page.locator(".handle"), page.get_by_role("status")
    spoken = [status.inner_text()]
    for key in ("Shift+ArrowDown", "ArrowLeft"):
        before = handle.get_attribute("transform")
        handle.press(key)
        assert handle.get_attribute("transform") != before
        spoken.append(status.inner_text())
    assert spoken[0].startswith("careful: Truth valid, Paper’s model 0.") and spoken[0] != spoken[1]
    for _ in range(20):
        handle.press("ArrowLeft")  # at the edge it stops
    assert handle.get_attribute("transform").startswith("translate(-0.1")  # pyright: ignore[reportOptionalMemberAccess]


@pytest.mark.parametrize("width", [PHONE, DESK])
def test_the_pointer_drags_the_path_over_table_and_maps(opened: Opened, width: int):
    page = opened("index", width)
    handle, path = page.locator(".handle"), page.locator(".widget .path").last
    for target in (page.locator(".widget svg"), page.locator(".widget .map").last):
        target.scroll_into_view_if_needed()
        before, box = path.get_attribute("d"), target.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 4)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.up()
        assert path.get_attribute("d") != before
        x, y = map(float, handle.get_attribute("transform")[10:-1].split(","))  # pyright: ignore
        assert abs(x - 0.5) < 0.12 and abs(y - 0.5) < 0.12
        page.locator(".handle").press("Shift+ArrowUp")


def test_a_model_that_is_wrong_on_a_patterned_table_is_marked(opened: Opened):
    page = opened("index")
    assert page.locator(".wrong").count() == 0
    page.get_by_role("checkbox", name="on onyx").check()
    assert page.locator(".wrong").count() == 4  # two users, two models
    assert "wrong" in page.locator(".wrong").first.inner_text()


def test_a_chart_shows_values_and_hides_series(opened: Opened):
    page = opened("accuracy")
    [chart] = [frame for frame in page.frames if "by-demonstrations" in frame.url]
    tip = chart.locator(".tip")
    assert not tip.is_visible()
    chart.get_by_label("Clearance model, 9 demonstrations").last.hover()
    assert tip.is_visible() and tip.text_content() == "Clearance model, 9 demonstrations a scene: 97.0\u00a0%"
    toggle, line = chart.get_by_role("button", name="Clearance model"), chart.locator("[data-series=clearance]").first
    toggle.press("Enter")
    assert not line.is_visible() and toggle.get_attribute("aria-pressed") == "false"
    toggle.click()
    assert line.is_visible()


def test_a_chart_is_whole_without_scripts(browser: Browser, site: Path):
    page = browser.new_page(java_script_enabled=False)
    page.goto((site / "figures" / "accuracy-by-demonstrations.svg").as_uri())
    assert page.locator(".series").first.is_visible()
    page.goto((site / "index.html").as_uri())
    assert not page.locator(".widget").is_visible() and page.locator("figure object").first.is_visible()
    page.close()
