"""A real browser at the door: every name of the page works, with its policy and its token."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from browser import Visit, chromium, wait_for
from fake_runner import FakeRunner

from vita.ui import App, selfcheck

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as made:
        yield made


def opens(browser: Any, app: App, runner: FakeRunner, address: str) -> Any:
    """The page comes up, shows pictures and stops the arm; nothing that it needs is forbidden to it."""
    page = browser.new_page()
    forbidden: list[str] = []
    page.on("console", lambda said: forbidden.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda problem: forbidden.append(str(problem)))
    visit = Visit(app, runner, page)
    page.goto(address)
    visit.ready()
    before = runner.stops
    visit.press("Stop")
    wait_for(lambda: runner.stops > before, "the stop")
    assert not forbidden
    where = page.url
    page.close()
    wait_for(lambda: not app.boards, "the page to be gone")
    return where


@pytest.mark.parametrize("name", ["localhost", "[::1]"])
def test_the_page_works_under_its_other_names(browser: Any, name: str) -> None:
    """127.0.0.1 is what every other test opens."""
    runner = FakeRunner()
    app = App(runner, port=0)
    try:
        selfcheck.check(app.door)
        opens(browser, app, runner, f"http://{name}:{app.port}/?fixedDpr=1")
    finally:
        app.close()
        runner.close()


def test_a_remote_page_works_with_its_token_and_forgets_it_from_its_address(browser: Any) -> None:
    runner = FakeRunner()
    app = App(runner, "0.0.0.0", 0, allow_remote=True)
    try:
        bare = browser.new_page()
        assert bare.goto(app.url).status == 403
        bare.close()
        where = opens(browser, app, runner, f"{app.door.address}&fixedDpr=1")
        assert where == f"{app.url}/?fixedDpr=1"
        opens(browser, app, runner, f"{app.url}/?fixedDpr=1")
    finally:
        app.close()
        runner.close()
