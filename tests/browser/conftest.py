"""A real browser, the pages of all commands, and what a page did while it was looked at."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pages
import pytest
from page_checks import DESKTOP
from trebucheck.comparisons.report import html

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page

NAMES = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium as the system has it; `CHROMIUM` in the environment names another one."""
    asked = os.environ.get("CHROMIUM")
    found = asked or next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(
            f"no browser here: none of {', '.join(NAMES)} is on PATH, and CHROMIUM names none"
        )
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed here")
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found)
        yield started
        started.close()


@dataclass
class Opened:
    """A page in the browser, with all that went wrong since it was opened."""

    page: Page
    size: int
    complaints: list[str] = field(default_factory=list)

    def look(self, viewport: dict[str, Any], scheme: str = "light") -> Page:
        """Show it so; a page that was printed is on the screen again."""
        self.page.emulate_media(color_scheme=scheme, media="screen")  # type: ignore[arg-type]
        self.page.set_viewport_size(viewport)  # type: ignore[arg-type]
        return self.page


Open = Callable[[str], Opened]


@pytest.fixture(scope="session")
def written(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The file of a command's page."""
    folder = tmp_path_factory.mktemp("pages")

    @cache
    def write(name: str) -> Path:
        path = folder / f"{name}.html"
        path.write_text(html.page(pages.DOCUMENTS[name]()), encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def windows(browser: Browser) -> Iterator[BrowserContext]:
    """What all windows share: another profile takes as long to start as a page to be checked."""
    context = browser.new_context(viewport=DESKTOP)  # type: ignore[arg-type]
    yield context
    context.close()


@pytest.fixture(scope="session")
def show(windows: BrowserContext) -> Callable[[Path], Opened]:
    """Opens a file in a window of its own."""

    def opened(path: Path) -> Opened:
        page = windows.new_page()
        found = Opened(page, path.stat().st_size)
        page.on("console", lambda said: found.complaints.append(f"{said.type}: {said.text}"))
        page.on("pageerror", lambda error: found.complaints.append(str(error)))
        page.on(
            "request",
            lambda sent: (
                None
                if sent.url == path.as_uri() or sent.url.startswith("data:")
                else found.complaints.append(f"asks for {sent.url}")
            ),
        )
        page.goto(path.as_uri())
        return found

    return opened


@pytest.fixture(scope="session")
def open_page(written: Callable[[str], Path], show: Callable[[Path], Opened]) -> Open:
    """A command's page, opened once."""
    return cache(lambda name: show(written(name)))


@pytest.fixture(params=list(pages.DOCUMENTS), scope="session")
def opened(request: pytest.FixtureRequest, open_page: Open) -> Opened:
    """The page of each command."""
    return open_page(request.param)
