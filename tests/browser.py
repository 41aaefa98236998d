"""A page and a real Chromium for tests: everything is asserted on Python objects in this process.

Without a Chromium the tests are skipped with the reason, except where `CI` is set: there they fail.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from vita.ui import App
from vita.ui.board import Board

FLAGS = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--force-color-profile=srgb", "--use-gl=angle",
    "--use-angle=gl-egl", "--ignore-gpu-blocklist",
)
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def chromium_path() -> str | None:
    chosen = os.environ.get("VITA_CHROMIUM")
    return chosen or next((path for path in map(shutil.which, NAMES) if path), None)


def wait_for(condition: Callable[[], Any], what: str, seconds: float = 20.0) -> Any:
    """Poll until `condition()` is true and return its value; the bound only ends a hung test."""
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            pytest.fail(f"waited {seconds:.0f} s for {what}")
        time.sleep(0.03)


class Visit:
    """One browser window that looks at the page of a runner, a fake or the real one."""

    def __init__(self, app: App, runner: Any, page: Any) -> None:
        self.app, self.runner, self.page = app, runner, page

    @property
    def board(self) -> Board:
        return self.app.boards[max(self.app.boards)]

    def open(self) -> None:
        self.page.goto(f"{self.app.url}/?fixedDpr=1")
        self.ready()

    def ready(self) -> None:
        """The newest window has its views and shows pictures."""
        wait_for(lambda: self.app.boards and self.board.layout is not None, "the board")
        wait_for(lambda: self.canvas() is not None, "the canvas")
        # The notice about software rendering lies over the pictures and takes clicks.
        self.page.locator(".mantine-Notification-closeButton").first.click(timeout=15000)
        wait_for(lambda: self.page.locator(".mantine-Notification-root").count() == 0, "a free canvas")

    def canvas(self) -> dict[str, float] | None:
        found = self.page.locator("canvas").first
        return found.bounding_box() if found.count() else None

    def place(self, camera: str, uv: tuple[float, float]) -> tuple[float, float]:
        """Page coordinates at which a pixel of a view is seen."""
        box = self.canvas()
        assert box is not None
        x, y = self.board.picking.screen_of(camera, uv)
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def click(self, camera: str, uv: tuple[float, float]) -> None:
        self.page.mouse.click(*self.place(camera, uv))

    def press(self, label: str) -> None:
        self.page.get_by_role("button", name=label, exact=True).click()

    def picture(self) -> np.ndarray:
        """(h, w, 3) screenshot."""
        import io

        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB"))


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser with a fresh profile, or a skip that says what is missing."""
    path = chromium_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sync_playwright = None
    if path is None or sync_playwright is None:
        missing = "Chromium or Chrome" if path is None else "the Python package playwright"
        reason = f"browser tests need {missing}"
        if os.environ.get("CI", "").lower() in ("1", "true", "yes"):
            pytest.fail(reason)
        pytest.skip(reason)
    with tempfile.TemporaryDirectory() as profile, sync_playwright() as play:
        context = play.chromium.launch_persistent_context(
            profile, executable_path=path, args=list(FLAGS), viewport={"width": 1280, "height": 720}
        )
        try:
            yield context
        finally:
            context.close()
