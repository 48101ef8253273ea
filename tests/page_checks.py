"""What is asked of a page that is open in a browser.

Each check tells what it finds, nothing where all is well.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

DESKTOP, PHONE = {"width": 1400, "height": 900}, {"width": 390, "height": 844}
SHEET = {"width": 1032, "height": 703}
"""[px] of A4, landscape, within margins of 12 mm."""
_LOOKS = Path(__file__).with_name("browser").joinpath("looks.js").read_text(encoding="utf-8")


def looks(page: Page, call: str) -> Any:
    """What a function of `looks.js` tells."""
    return page.evaluate(f"() => {{ const looks = {_LOOKS}; return looks.{call}; }}")


_LAYOUT = ["scrollable-region-focusable", "link-in-text-block"]
"""Rules of axe, beside contrast, whose results differ between screens and colours."""


def serious(
    page: Page, *, seen_before: bool = False, impacts: tuple[str, ...] = ("serious", "critical")
) -> list[str]:
    """Serious and critical violations that axe finds, or those of other impacts.

    Drawings whose boxes have names are left out. Contrast, which is most of the work, is judged of
    one text of each kind of place and colour.

    Args:
        seen_before: on another screen; rules that ask for the page's structure alone are not asked
            again.
    """
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed"
    )
    assert looks(page, "mark_kinds()") > 0
    if not page.evaluate("'axe' in window"):
        page.evaluate(axe.Axe().axe_script)
    unnamed, contrast = [["[aria-hidden=true]"]], "color-contrast"
    others: dict[str, Any] = {"rules": {contrast: {"enabled": False}}}
    if seen_before:
        others = {"runOnly": _LAYOUT}
    found: list[dict[str, Any]] = []
    for where, options in (
        ({}, others),
        ({"include": [["[data-kind]"]]}, {"runOnly": [contrast]}),
    ):
        # What is in order is not described.
        options |= {"resultTypes": ["violations"], "selectors": False}
        run = "([where, options]) => axe.run(where, options).then((found) => found.violations)"
        found += page.evaluate(run, [where | {"exclude": unnamed}, options])
    return [_said(each) for each in found if each["impact"] in impacts]


def _said(violation: dict[str, Any]) -> str:
    nodes = [
        node["html"][:150] + " ".join(c["message"] for c in node["any"])
        for node in violation["nodes"][:3]
    ]
    return f"{violation['impact']} {violation['id']} ({len(violation['nodes'])}): {nodes}"


def unreached(page: Page) -> list[str]:
    """Controls that Tab does not come to, or where that is not seen."""
    for _ in range(looks(page, "watch_focus()") // 20 + 2):  # a box that scrolls is a stop, too
        for _ in range(20):
            page.keyboard.press("Tab")
    return looks(page, "unreached()")
