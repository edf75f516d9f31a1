"""The recorder in a real browser: mouse, finger and keys draw; a kill loses only the path that was being drawn."""

import json
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from pipeline.own.recorder.storage import Recordings
from tests.own.recorder import factory
from tests.own.recorder.factory import CORNERS, DETOUR, GOAL, Served, make_folder, pixels, recorder, samples

PHONE, DESK = 390, 1280  # [px]
Points = list[tuple[float, float]]
LET_GO_ONCE_CROSS_PASSES = """async ([key, axis, sign, end]) => {
  const { board } = await import("/static/recorder.js");
  while (board.cross[axis] * sign < end * sign) await new Promise(requestAnimationFrame);
  board.canvas.dispatchEvent(new KeyboardEvent("keyup", { key }));
}"""
expect.set_options(timeout=20_000)  # [ms]; a busy machine answers late


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path)


@pytest.fixture
def served(folder: Path) -> Iterator[Served]:
    with recorder(folder) as served:
        yield served


@pytest.fixture
def tab(browser: Browser, served: Served) -> Iterator[Callable[..., Page]]:
    """Opens a step of the recorder in a tab; the test fails if the page reports an error."""
    contexts, errors = [], []

    def open_tab(step: str = "paths", user: str | None = "Zoë", width: int = DESK, **options) -> Page:
        context = browser.new_context(viewport={"width": width, "height": 900}, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"{served.url}#{step}")
        until_ready(page)
        if user and step.startswith("paths"):
            add_user(page, user)
        return page

    yield open_tab
    for context in contexts:
        context.close()
    assert errors == []


def until_ready(page: Page) -> None:
    """Wait until the page knows what is recorded, as a person would."""
    expect(page.locator("body")).to_have_attribute("aria-busy", "false")


def add_user(page: Page, name: str) -> None:
    page.get_by_label("Another person’s name").fill(name)
    page.get_by_role("button", name="Add", exact=True).click()


def on_screen(page: Page, points: Points | list[list[int]], metres: bool = True) -> list[tuple[float, float]]:
    """Places on the table [m], or in the picture [px], as places on the screen."""
    canvas = page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    expect(page.locator("#picture")).to_have_js_property("complete", True)  # the page's policy forbids to poll by eval
    box = canvas.bounding_box()
    assert box
    places = pixels([(x, y) for x, y in points]) if metres else np.array(points, float)
    return [
        (box["x"] + x / factory.WIDTH * box["width"], box["y"] + y / factory.HEIGHT * box["height"]) for x, y in places
    ]


def drag(page: Page, points: Points, let_go: bool = True) -> None:
    first, *rest = on_screen(page, points)
    page.mouse.move(*first)
    page.mouse.down()
    for place in rest:
        page.mouse.move(*place, steps=15)
    if let_go:
        page.mouse.up()


def click(page: Page, points: Points | list[list[int]], metres: bool = True) -> None:
    for place in on_screen(page, points, metres):
        page.mouse.click(*place)


def judge(page: Page, word: str = "Valid") -> None:
    page.get_by_role("button", name=word, exact=True).click()
    expect(page.locator("#message")).to_contain_text("Stored")


def paths(folder: Path) -> list[pd.DataFrame]:
    file = folder / "demonstrations.csv"
    if not file.exists():
        return []
    return [rows for _, rows in pd.read_csv(file).groupby(["scene", "user", "demo"], sort=False)]


def distance_to(points: Points, rows: pd.DataFrame) -> float:
    """The largest distance [m] of a path's samples from the polygon through `points`."""
    polygon = np.array(points)
    along, each = np.diff(polygon, axis=0), rows[["x", "y"]].to_numpy()[:, None]
    share = np.clip(((each - polygon[:-1]) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    return float(np.linalg.norm(polygon[:-1] + share[..., None] * along - each, axis=-1).min(axis=1).max())


def test_a_person_draws_with_the_mouse_judges_takes_back_and_goes_on(tab, folder: Path):
    user = "<img src=x onerror=alert(1)>"
    page = tab(user=user)
    for word in ("Valid", "Not valid", "Discard"):
        expect(page.get_by_role("button", name=word, exact=True)).to_be_disabled()
    assert paths(folder) == []
    for word in ("Valid", "Not valid"):
        drag(page, DETOUR)
        judge(page, word)
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("#message")).to_contain_text("Removed path 2")
    (rows,) = paths(folder)
    assert distance_to(DETOUR, rows) < 0.01 and len(rows) >= 20
    assert np.allclose(rows[["x", "y"]].iloc[[0, -1]], [factory.START, GOAL], atol=0.01)
    assert rows["t"].is_monotonic_increasing and rows["valid"].all() and set(rows["user"]) == {user}
    expect(page.get_by_role("columnheader", name=user)).to_be_visible()
    assert page.locator("img[src=x]").count() == 0, "a name is text"
    page.get_by_role("button", name="Skip").click()
    expect(page.get_by_role("heading", name="Scene 2 of 2: second")).to_be_visible()
    page.get_by_role("button", name="Back").click()
    expect(page.get_by_role("heading", name="Scene 1 of 2: first")).to_be_visible()
    expect(page.get_by_role("row", name="first 1 + 0")).to_be_visible()
    expect(page.get_by_role("row", name="second –")).to_be_visible()
    page.goto(page.url.partition("#")[0])
    until_ready(page)
    page.reload()
    expect(page.get_by_role("heading", name="Scene 2 of 2: second")).to_be_visible()  # goes on where it stopped


def test_a_path_drawn_with_a_finger_on_a_phone_is_stored(tab, folder: Path):
    page = tab(width=PHONE, has_touch=True, is_mobile=True)
    session = page.context.new_cdp_session(page)
    steps, (x, y) = np.linspace(0, 3, 40), np.transpose(DETOUR)
    curve = list(zip(np.interp(steps, range(4), x), np.interp(steps, range(4), y), strict=True))
    places = on_screen(page, curve)
    for index, (x, y) in enumerate(places):
        kind = "touchMove" if index else "touchStart"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    judge(page, "Not valid")
    (rows,) = paths(folder)
    assert distance_to(DETOUR, rows) < 0.01 and not rows["valid"].any()


def test_a_path_drawn_with_the_arrow_keys_is_stored(tab, folder: Path):
    page = tab()
    page.locator("canvas").focus()
    page.keyboard.press("Enter")
    goal = pixels([GOAL])[0]
    for key, axis, sign in (("ArrowUp", 1, -1), ("ArrowRight", 0, 1)):  # from the picture's middle
        page.keyboard.down(key)
        page.evaluate(LET_GO_ONCE_CROSS_PASSES, [key, axis, sign, float(goal[axis])])
        page.keyboard.up(key)
    page.keyboard.press("Enter")
    page.keyboard.press("v")
    expect(page.locator("#message")).to_contain_text("Stored")
    (rows,) = paths(folder)
    assert rows["t"].iloc[-1] > 1 and len(rows) > 20


def test_a_kill_in_the_middle_of_drawing_loses_only_that_path(browser: Browser, folder: Path):
    page = browser.new_page(viewport={"width": DESK, "height": 900})
    with recorder(folder) as served:
        page.goto(served.url)
        until_ready(page)
        add_user(page, "Zoë")
        for _ in range(3):
            drag(page, DETOUR)
            judge(page)
        drag(page, DETOUR[:-1], let_go=False)
        served.process.kill()
        served.process.wait()
        drag(page, [DETOUR[-1]])
        assert len(paths(folder)) == 3
        drag(page, DETOUR)
        page.get_by_role("button", name="Valid", exact=True).click()
        expect(page.locator("#message")).to_contain_text(f"--port {served.port}")
    with recorder(folder, served.port):
        page.get_by_role("button", name="Valid", exact=True).click()  # the tab kept the path
        expect(page.locator("#message")).to_contain_text("Stored: path 4")
        page.reload()
        expect(page.get_by_role("row", name="first 4 + 0")).to_be_visible()
    assert [len(rows) > 20 for rows in paths(folder)] == [True] * 4
    page.close()


def test_imported_paths_without_a_label_are_judged_by_a_key_each(tab, folder: Path):
    keys = ("first,robot,1", "first,robot,2", "second,robot,1")
    rows = [f"{key},{t / 10},{0.1 + t / 12},{0.1 + t / 12}," for key in keys for t in range(9)]
    (folder / "demonstrations.csv").write_text("\n".join(["scene,user,demo,t,x,y,valid", *rows, ""]))
    page = tab(user=None)
    expect(page.locator("#message")).to_contain_text("A stored path of robot waits, yellow: is it valid? 1 more")
    page.locator("canvas").focus()
    page.keyboard.press("v")
    expect(page.get_by_role("row", name="first 1 + 0, 1 to judge")).to_be_visible()
    page.keyboard.press("n")
    expect(page.get_by_role("row", name="first 1 + 1")).to_be_visible()
    expect(page.locator("#scene-title")).to_contain_text("second")
    expect(page.locator("#message")).to_contain_text("robot waits")
    page.keyboard.press("v")
    expect(page.get_by_role("row", name="second 1 + 0")).to_be_visible()
    assert [bool(one["valid"].all()) for one in paths(folder)] == [True, False, True]


def test_corners_and_size_of_the_table_are_stored(browser: Browser, tab, folder: Path):
    (folder / "table.yaml").unlink()
    page = tab("paths", user=None)
    expect(page.locator("#message")).to_contain_text("Mark its corners first")
    page.get_by_role("link", name="Table", exact=True).click()
    expect(page.locator("#message")).to_contain_text("Mark the far left corner")
    click(page, CORNERS, metres=False)
    page.get_by_label("Depth of the table").fill("0.8")
    page.get_by_role("button", name="Save the table").click()
    expect(page.locator("#message")).to_contain_text("The table is stored")
    content = yaml.safe_load((folder / "table.yaml").read_text())
    assert np.allclose(content["corners"], CORNERS, atol=1) and content["size_m"] == [1.0, 0.8]


def test_axe_finds_no_violation_no_step_scrolls_sideways_and_nothing_is_loaded_from_elsewhere(browser, served: Served):
    requests, messages = [], []
    for step, width, scheme in product(("paths", "table"), (DESK, PHONE), ("light", "dark")):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: messages.append(message.text))
        page.goto(f"{served.url}#{step}")
        until_ready(page)
        expect(page.locator("#where")).to_contain_text("kitchen")
        if step == "paths":
            add_user(page, "Zoë")
            drag(page, DETOUR)
            judge(page)
            drag(page, DETOUR)  # not judged: all buttons are on
        assert messages == [] and all(url.startswith(served.url) for url in requests)
        results = Axe().run(page)
        assert results.violations_count == 0, results.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.close()


def test_nothing_is_judged_before_it_is_shown_nor_by_a_person_who_is_guessed(tab: Callable[..., Page], folder: Path):
    stored = Recordings(folder)
    for scene, user in (("first", "Zoë"), ("second", "Ben")):
        stored.add_path(scene, user, True, samples().tolist())
    file = folder / "demonstrations.csv"
    file.write_text(file.read_text().replace(",true", ","))
    page, held = tab(user=None), []
    expect(page.locator("#users input:checked")).to_have_count(0)
    page.route("**/pictures/second", lambda route: held.append(route))
    page.locator("canvas").focus()
    page.keyboard.press("v")
    expect(page.locator("#scene-title")).to_contain_text("second")
    page.keyboard.press("v")
    page.wait_for_timeout(300)
    held[0].continue_()
    expect(page.locator("#message")).to_contain_text("of Ben waits")
    assert pd.read_csv(file).groupby("scene")["valid"].count().tolist() == [40, 0]


def test_items_are_outlined_by_a_click_named_and_undone(tab: Callable[..., Page], folder: Path):
    page, message = tab("items/first"), "#message"
    expect(page.locator(message)).to_contain_text("items found", timeout=90_000)  # torch takes long to import
    click(page, [(0.4, 0.5)])
    expect(page.locator(message)).to_contain_text("Stored: 1 item")
    page.get_by_label("Kind of the chosen item").fill("Tasse")
    page.keyboard.press("Enter")
    expect(page.locator(message)).to_contain_text("Stored: 1 item")
    click(page, [(0.7, 0.4)])
    expect(page.locator(message)).to_contain_text("Stored: 2 items")
    page.keyboard.press("u")
    expect(page.locator(message)).to_contain_text("Stored: 1 item")
    coco = json.loads((folder / "items.json").read_text())
    assert [category["name"] for category in coco["categories"]] == ["Tasse"]
    (one,) = coco["annotations"]
    ring = np.reshape(one["segmentation"][0], (-1, 2))
    np.testing.assert_allclose((ring.min(0) + ring.max(0)) / 2, pixels([(0.4, 0.5)])[0], atol=6)
    page.keyboard.press("u")  # the name
    page.keyboard.press("u")
    expect(page.locator("#counted")).to_contain_text("the detector decides")
    expect(page.locator(message)).to_contain_text("Stored: 0 items")
    assert json.loads((folder / "items.json").read_text())["images"] == []
