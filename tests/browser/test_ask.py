"""`ask` in a real browser: a simulated person judges 60 trials, over a kill, with a second window open."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from pipeline.causal.experiment import local_verdicts
from pipeline.own.asked import Sitting, sittings
from tests.own import folders
from tests.own.folders import add_kind, make_folder
from tests.own.recorder.factory import recorder

WAIT_MS = 120_000  # a busy machine places items slowly


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.set_default_timeout(WAIT_MS)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    context.close()
    assert errors == []


def ready(page: Page) -> None:
    """Wait until a picture is shown."""
    expect(page.locator("body")).to_have_attribute("aria-busy", "false", timeout=WAIT_MS)


def judge(page: Page, sitting: Sitting, begin: int, end: int) -> None:
    """Press V, or N where a cup is near, as a person who sees the picture would."""
    for count in range(begin, end):
        expect(page.locator("#count")).to_contain_text(f"{count} judged", timeout=WAIT_MS)
        ready(page)
        trial = int(str(page.locator("#picture").get_attribute("src")).rpartition("/")[2])
        row = sitting.plan.iloc[trial]
        near_cup = row["condition"] == "cup" and row["clearance_m"] <= 0.04
        page.keyboard.press("n" if near_cup else "v")
    expect(page.locator("#count")).to_contain_text(f"{end} judged", timeout=WAIT_MS)


def test_sixty_trials_judged_by_keys_over_a_kill_tell_what_a_person_reacts_to(page: Page, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(folders, "SCENES", tuple("abcdefgh"))
    folder = make_folder(tmp_path / "table")
    add_kind(folder)
    with recorder(folder, verb="ask") as served:
        page.goto(served.url)
        page.get_by_role("button", name="Ana").click()
        expect(page.locator("#count")).to_contain_text("0 judged, about 10 minutes left", timeout=WAIT_MS)
        assert Axe().run(page).response["violations"] == []
        (sitting,) = sittings(folder).values()
        page.keyboard.press("Enter")  # favours neither answer
        judge(page, sitting, 0, 24)
        ready(page)
        page.locator("#invalid").focus()
        for _ in range(3):  # held
            page.keyboard.down("Enter")
            ready(page)
        page.keyboard.up("Enter")
        expect(page.locator("#count")).to_contain_text("25 judged")
        ready(page)
        page.route("**/trials/**", lambda _: None)  # the next picture does not come
        page.keyboard.press("n")
        expect(page.locator("#count")).to_contain_text("26 judged")
        page.unroute("**/trials/**")
        for left in (25, 24):
            page.keyboard.press("u")
            expect(page.locator("#count")).to_contain_text(f"{left} judged")
        judge(page, sitting, 24, 25)
        served.process.send_signal(signal.SIGKILL)
        served.process.wait()
    with recorder(folder, verb="ask") as served:
        second = page.context.new_page()
        second.set_default_timeout(WAIT_MS)
        for window in (page, second):
            window.goto(served.url)
            window.get_by_role("button", name="Ana").click()
            expect(window.locator("#count")).to_contain_text("25 judged", timeout=WAIT_MS)
        judge(page, sitting, 25, 60)
        ready(second)
        second.keyboard.press("v")
        expect(second.locator("#message")).to_contain_text("answered in another window", timeout=WAIT_MS)
        expect(second.locator("#count")).to_contain_text("60 judged", timeout=WAIT_MS)
    answers = pd.read_csv(folder / "asked" / "001.csv")
    assert len(answers) == answers["trial"].nunique() == 60 and (answers["response_ms"] > 0).all()
    (sitting,) = sittings(folder).values()
    verdicts = local_verdicts(sitting.plan, sitting.answers).set_index("kind")["verdict"]
    assert verdicts["cup"] == "effect"
