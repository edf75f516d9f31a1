"""The report's panel in a real browser: it says what is true, and every control works by mouse and by keyboard."""

import base64
import json
import re
from collections.abc import Callable

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, FloatRect, Locator, Page

from pipeline.table.layout import SYMBOLS, Layouts, empty
from pipeline.table.rules import clearance, valid
from tests.browser.conftest import REPORT

PHONE, DESK = 375, 1280  # [px]
Opened = Callable[..., Page]


@pytest.fixture
def page(opened: Opened) -> Page:
    return opened(DESK)


@pytest.fixture
def data(page: Page) -> dict:
    return json.loads(page.locator("#panel-data").text_content() or "")


def choose(page: Page, name: str, index: int) -> None:
    page.locator(f"#panel-{name}").select_option(index=index)


def state(page: Page) -> str:
    return page.locator("#panel-state").inner_text()


def chosen(page: Page, data: dict) -> tuple[dict, dict]:
    """The scene and the table that the page shows."""
    split, scene, added = (int(page.locator(f"#panel-{n}").input_value()) for n in ("split", "scene", "added"))
    scene = data["splits"][split]["scenes"][scene]
    return scene, scene["tables"][added]


def unpacked(text: str, dtype: str = "u1") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype)


def layout(table: dict) -> Layouts:
    """One table's items as the world's own rules take them."""
    out = empty(1, len(table["items"]))
    for slot, item in enumerate(table["items"]):
        a, b = np.array(item["ends"])
        out.item[0, slot] = out.symbol[0, slot] = SYMBOLS.index(item["symbol"])
        out.centre[0, slot], out.half_length[0, slot] = (a + b) / 2, np.linalg.norm(b - a) / 2
        out.angle[0, slot], out.radius[0, slot] = np.arctan2(*(b - a)[::-1]), item["radius"]
    return out


def place(one: Locator) -> FloatRect:
    """Where it is in the window, scrolled into it: x, y, width, height [px]."""
    one.scroll_into_view_if_needed()
    box = one.bounding_box()
    assert box
    return box


def click_cell(page: Page, data: dict, name: str, column: int, row: int) -> None:
    """Click the middle of a cell of a map; row 0 is the lowest."""
    box = place(page.locator(f"#panel-{name}"))
    side = data["side"]
    x, y = (column + 0.5) / side * box["width"], (1 - (row + 0.5) / side) * box["height"]
    page.locator(f"#panel-{name}").click(position={"x": x, "y": y})


def middle(data: dict, column: int, row: int) -> np.ndarray:
    return data["low"] + (np.array([column, row]) + 0.5) * (data["high"] - data["low"]) / data["side"]


def control_point(page: Page, name: str = "believed") -> np.ndarray:
    mark = page.locator(f"#panel-{name} .mark")
    return np.array([float(mark.get_attribute(a) or "nan") for a in ("cx", "cy")])


def drawn(page: Page, name: str) -> np.ndarray:
    """A map's pixels, (side, side, 3), its lowest row first."""
    script = "one => [...one.getContext('2d').getImageData(0, 0, one.width, one.height).data]"
    values = np.array(page.locator(f"#panel-{name} canvas").evaluate(script), np.uint8)
    side = int((len(values) // 4) ** 0.5)
    return values.reshape(side, side, 4)[::-1, :, :3]


def test_the_page_measures_as_the_world_does(page: Page, data: dict):
    z = np.random.default_rng(0).uniform(data["low"], data["high"], (40, 2))
    script = "([items, zs]) => zs.map(z => items.map(item => clearance(item, curve(z)).distance))"
    for split in data["splits"]:
        for scene in split["scenes"]:
            for table in scene["tables"]:
                measured = page.evaluate(script, [table["items"], z.tolist()])
                np.testing.assert_allclose(measured, clearance(layout(table), z[None])[0], atol=1e-3)


def test_what_it_says_of_a_path_is_what_the_model_says_and_what_is_true(page: Page, data: dict):
    rng = np.random.default_rng(1)
    for _ in range(25):
        split = int(rng.integers(len(data["splits"])))
        choose(page, "split", split)
        choose(page, "scene", int(rng.integers(len(data["splits"][split]["scenes"]))))
        user, variant = int(rng.integers(len(data["users"]))), int(rng.integers(len(data["variants"])))
        choose(page, "user", user)
        choose(page, "variant", variant)
        column, row = (int(i) for i in rng.integers(data["side"], size=2))
        click_cell(page, data, "believed" if rng.random() < 0.5 else "true", column, row)
        z, cell = middle(data, column, row), row * data["side"] + column
        np.testing.assert_allclose([control_point(page), control_point(page, "true")], [z, z], atol=1e-9)

        _, table = chosen(page, data)
        margins, where = data["users"][user]["margins"], layout(table)
        away = clearance(where, z[None, None])[0, 0]
        is_valid = bool(valid(where, z[None, None], margins)[0, 0])
        assert is_valid == np.unpackbits(unpacked(table["truth"][user]))[cell]
        p = unpacked(table["maps"][user][variant])[cell] / 255
        words = state(page)
        assert f"P(valid) {p:.2f} by {data['variants'][variant]['phrase']}" in words
        assert f"in truth {'valid' if is_valid else 'invalid'}" in words
        symbols = [item["symbol"] for item in table["items"]]
        room = np.array([np.inf if margins[s] is None else d - margins[s] for s, d in zip(symbols, away, strict=True)])
        least, nearest = int(room.argmin()), int(away.argmin())
        met = [least] * bool(np.isfinite(room[least])) + [nearest] * (margins[symbols[nearest]] is None)
        said = re.findall(r"([\d.]+)\scm (from|into) the (\w+)", words)
        for (length, word, symbol), i in zip(said, met, strict=True):
            assert (word, symbol) == ("into" if away[i] < 0 else "from", symbols[i])
            assert float(length) == pytest.approx(abs(100 * away[i]), abs=0.051)


def test_maps_are_drawn_in_the_figures_colours(page: Page, data: dict):
    palette = unpacked(data["palette"]).reshape(256, 3)
    side = data["side"]
    for variant in range(len(data["variants"])):
        choose(page, "variant", variant)
        _, table = chosen(page, data)
        believed = unpacked(table["maps"][0][variant])
        truth = np.unpackbits(unpacked(table["truth"][0]), count=side**2)
        np.testing.assert_array_equal(drawn(page, "believed"), palette[believed].reshape(side, side, 3))
        np.testing.assert_array_equal(drawn(page, "true"), palette[255 * truth].reshape(side, side, 3))
        right = f"right at {100 * ((believed > 127) == truth).mean():.1f}\u00a0%"
        assert right in page.locator("#panel-believed-text").inner_text()


def by_keyboard(select: Locator) -> None:
    select.press("ArrowDown")


def by_mouse(select: Locator) -> None:
    select.select_option(index=1)


@pytest.mark.parametrize("use", [by_keyboard, by_mouse])
@pytest.mark.parametrize("name", ["split", "scene", "user", "variant", "added", "start"])
def test_every_choice_changes_what_is_shown(page: Page, name: str, use: Callable[[Locator], None]):
    if name == "split":
        choose(page, "split", 0)
    shown = page.locator(".views").inner_html() + state(page)
    use(page.locator(f"#panel-{name}"))
    assert page.locator(f"#panel-{name}").input_value() == "1"
    assert page.locator(".views").inner_html() + state(page) != shown


def test_arrow_keys_move_the_control_point_by_a_cell_and_shift_by_five(page: Page, data: dict):
    believed = page.get_by_role("application")
    click_cell(page, data, "believed", 20, 20)
    for key, move in {"ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowLeft": (-1, 0), "ArrowDown": (0, -1)}.items():
        for keys, cells in ((key, 1), (f"Shift+{key}", 5)):
            before, words = control_point(page), state(page)
            believed.press(keys)
            moved = (control_point(page) - before) * data["side"] / (data["high"] - data["low"])
            np.testing.assert_allclose(moved, cells * np.array(move), atol=1e-9)
            assert state(page) != words
    for _ in range(10):
        believed.press("Shift+ArrowRight")
    assert control_point(page)[0] == pytest.approx(middle(data, data["side"] - 1, 0)[0])


def test_the_control_point_can_be_dragged_and_the_map_then_has_the_keyboard(page: Page, data: dict):
    box = place(page.locator("#panel-true"))
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=4)
    np.testing.assert_allclose(control_point(page), 0.5, atol=0.04)
    page.mouse.move(box["x"] + box["width"] + 80, box["y"] - 80)
    np.testing.assert_allclose(control_point(page), middle(data, data["side"] - 1, data["side"] - 1))
    page.mouse.up()
    assert page.get_by_role("application").evaluate("one => one === document.activeElement")


@pytest.mark.parametrize("way", ["keyboard", "mouse"])
def test_a_repair_is_followed_step_by_step(page: Page, data: dict, way: str):
    choose(page, "variant", 5)
    choose(page, "start", 2)
    scene, table = chosen(page, data)
    ascent = scene["repairs"][0]["ascents"][5]
    starts = len(scene["repairs"][0]["starts"])
    z, p = unpacked(ascent["z"], "<i2").reshape(starts, -1, 2)[1] * data["unit"], unpacked(ascent["p"])
    p = p.reshape(starts, -1)[1] / 255
    slider = page.get_by_role("slider", name="Step of the repair")
    steps = int(slider.get_attribute("max") or 0)
    assert steps == len(z) - 1
    assert state(page).startswith(f"Step 0 of {steps}: ") and "in truth invalid" in state(page)
    if way == "keyboard":
        slider.press("ArrowRight")
        at = 1
    else:
        box = place(slider)
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        at = steps // 2
    assert state(page).startswith(f"Step {at} of {steps}: P(valid) {p[at]:.2f}")
    np.testing.assert_allclose(control_point(page), z[at])
    truth = bool(valid(layout(table), z[None, at, None], data["users"][0]["margins"])[0, 0])
    assert f"in truth {'valid' if truth else 'invalid'}" in state(page)
    page.get_by_role("application").press("ArrowDown")
    assert not state(page).startswith("Step") and slider.is_disabled()


def test_an_added_item_changes_the_map_and_can_be_taken_away(page: Page, data: dict):
    before = drawn(page, "believed"), drawn(page, "true"), page.locator("#panel-table .near-rim, .item-rim").count()
    choose(page, "added", 4)
    _, table = chosen(page, data)
    assert table["added"] == "glass"
    assert page.locator("#panel-table image").get_attribute("href") == table["picture"]
    assert page.locator("#panel-table .near-rim, .item-rim").count() == before[2] + 1
    assert (drawn(page, "believed") != before[0]).any() and (drawn(page, "true") != before[1]).any()
    assert page.get_by_role("combobox", name="Repair from").is_disabled(), "repairs are of the scene as it is"
    choose(page, "added", 0)
    assert (drawn(page, "believed") == before[0]).all() and (drawn(page, "true") == before[1]).all()


def test_what_is_not_there_cannot_be_chosen(page: Page, data: dict):
    choose(page, "split", 0)
    for name in ("Added item", "Repair from"):
        assert page.get_by_role("combobox", name=name).is_disabled()
    assert page.get_by_role("slider", name="Step of the repair").is_disabled()
    choose(page, "split", 2)
    for i, scene in enumerate(data["splits"][2]["scenes"]):
        for user, repairs in enumerate(scene["repairs"]):
            choose(page, "scene", i)
            choose(page, "user", user)
            offered = page.locator("#panel-start option").all_inner_texts()
            assert offered == ["nowhere", *(f"start {start + 1}" for start in repairs["starts"])]
            assert page.get_by_role("combobox", name="Repair from").is_disabled() is (repairs["starts"] == [])


@pytest.mark.parametrize("width", [PHONE, DESK])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation_in_use(opened: Opened, width: int, scheme: str):
    page = opened(width, scheme)
    choose(page, "start", 1)
    page.locator("#panel-step").press("End")
    results = Axe().run(page, context="#panel")
    assert results.violations_count == 0, results.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_using_it_is_quiet_and_asks_for_nothing(browser: Browser):
    page = browser.new_page()
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(REPORT)
    for name in ("split", "scene", "user", "variant", "added", "start"):
        choose(page, "split", 2)
        choose(page, "added", 0)
        choose(page, "user", 0)  # the careful one, who minds some path in every scene: others may have none to repair
        for i in range(page.locator(f"#panel-{name} option").count()):
            choose(page, name, i)
            page.get_by_role("application").press("ArrowLeft")
    page.close()
    assert said == [] and asked == [REPORT]


def test_without_javascript_a_sentence_stands_in(browser: Browser):
    page = browser.new_page(java_script_enabled=False)
    page.goto(REPORT)
    section = page.locator("section[aria-labelledby='try']")
    assert not section.locator("form").is_visible()
    assert section.get_by_text("That needs JavaScript").is_visible()
    page.close()


def test_on_paper_a_sentence_stands_in(page: Page):
    section = page.locator("section[aria-labelledby='try']")
    in_print = section.get_by_text("On a screen, one can")
    assert not section.get_by_text("That needs JavaScript").is_visible()
    assert section.locator("form").is_visible() and not in_print.is_visible()
    page.emulate_media(media="print")
    assert not section.locator("form").is_visible() and in_print.is_visible()
    assert section.locator("p:visible").count() == 1


def test_touch_moves_the_control_point(browser: Browser, data: dict):
    context = browser.new_context(viewport={"width": PHONE, "height": 700}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(REPORT)
    box = place(page.locator("#panel-believed"))
    page.locator("#panel-believed").tap(position={"x": box["width"] / 2, "y": box["height"] / 2})
    np.testing.assert_allclose(control_point(page), 0.5, atol=0.04)
    context.close()
