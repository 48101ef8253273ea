"""The pages of all commands in a real browser: quiet, readable by everybody, whole on a phone and on paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

LOOKS = Path(__file__).with_name("looks.js").read_text(encoding="utf-8")
DESKTOP, PHONE = {"width": 1400, "height": 900}, {"width": 390, "height": 844}
SHEET = {"width": 1032, "height": 703}
"""[px] of A4, landscape, within margins of 12 mm."""
MEGABYTE = 1_000_000


def looks(page: Page, call: str) -> Any:
    return page.evaluate(f"() => {{ const looks = {LOOKS}; return looks.{call}; }}")


@pytest.mark.parametrize(("scheme", "viewport"), [("light", DESKTOP), ("dark", PHONE)], ids=["light", "dark"])
def test_axe_finds_nothing_serious(opened: Any, scheme: str, viewport: dict[str, int]) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    page = opened.look(viewport, scheme)
    looks(page, "unfold()")
    found = axe.Axe().run(page, context={"exclude": [["[aria-hidden=true]"]]}).response["violations"]
    assert not [_said(each) for each in found if each["impact"] in ("serious", "critical")]


def _said(violation: dict[str, Any]) -> str:
    nodes = [node["html"][:150] + " ".join(c["message"] for c in node["any"]) for node in violation["nodes"][:3]]
    return f"{violation['impact']} {violation['id']} ({len(violation['nodes'])}): {nodes}"


def test_the_structure_is_a_tree_and_every_link_lands(opened: Any) -> None:
    page = opened.look(DESKTOP)
    assert looks(page, "structure()") == []


def test_a_phone_shows_all_and_nothing_twice_in_one_place(opened: Any) -> None:
    page = opened.look(PHONE)
    looks(page, "unfold()")
    assert looks(page, "leaving(390)") == []
    assert looks(page, "overlapping()") == []


def test_a_desktop_shows_all_and_nothing_twice_in_one_place(opened: Any) -> None:
    page = opened.look(DESKTOP)
    looks(page, "unfold()")
    assert looks(page, "leaving(1400, 'pre, .animation-scroll, .scroll')") == []
    assert looks(page, "overlapping()") == []


def test_print_cuts_nothing(opened: Any) -> None:
    page = opened.look(SHEET)
    page.emulate_media(media="print", color_scheme="light")
    looks(page, "unfold()")
    assert looks(page, "leaving(1032)") == []
    assert looks(page, "cut(703)") == []
    assert looks(page, "overlapping()") == []


def test_a_page_is_light_and_asks_for_nothing(opened: Any) -> None:
    opened.look(DESKTOP)
    assert opened.complaints == []
    assert opened.size < 2 * MEGABYTE


def test_every_control_is_reached_by_keyboard_and_shows_it(opened: Any) -> None:
    page = opened.look(DESKTOP)
    count = looks(page, "watch_focus()")
    for _ in range(count // 20 + 2):  # a box that scrolls is a stop, too
        for _ in range(20):
            page.keyboard.press("Tab")
    assert looks(page, "unreached()") == []
