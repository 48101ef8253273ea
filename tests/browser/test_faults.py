"""Each check of a page finds the fault that it is there for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from page_checks import DESKTOP, PHONE, looks, serious, unreached

_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="
_SMALL = "<figure class='plot' style='break-inside: auto'>cut</figure>"


def _tells(call: str) -> Callable[[Any], list[str]]:
    return lambda page: looks(page, call)


FAULTS: dict[str, tuple[str, Callable[[Any], list[str]], str]] = {
    "no alternative text": (f"<img src='{_PIXEL}'>", serious, "image-alt"),
    "faint text": ("<p style='color: #ccc; background: #fff'>faint</p>", serious, "contrast"),
    "a control without a name": ("<button></button>", serious, "button-name"),
    "wider than a phone": ("<div style='width: 500px'>wide</div>", _tells("leaving(390)"), "wide"),
    "text over text": (
        "<p>below</p><p style='margin-top: -2em'>above</p>",
        _tells("overlapping()"),
        "above",
    ),
    "a level left out": ("<h2>two</h2><h4>four</h4>", _tells("structure()"), "skips"),
    "a link to nowhere": ("<a href='#nowhere'>there</a>", _tells("structure()"), "nowhere"),
    "an anchor twice": ("<p id='main'>again</p>", _tells("structure()"), "twice"),
    "a figure that is cut": (_SMALL, _tells("cut(703)"), "cut"),
    "a button without focus": (
        "<button style='outline: none'>press</button>",
        unreached,
        "no outline",
    ),
}


@pytest.fixture(scope="module")
def plain(written: Callable[[str], Path], show: Callable[[Path], Any]) -> Any:
    """The smallest page, without a fault."""
    return show(written("problems"))


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found(name: str, plain: Any) -> None:
    """What is put at the page's end, and taken away again."""
    fault, check, word = FAULTS[name]
    page = plain.look(PHONE if "phone" in name else DESKTOP)
    page.evaluate("() => document.querySelector('main').append(document.createElement('div'))")
    last = "document.querySelector('main').lastElementChild"
    page.evaluate(f"(fault) => {{ {last}.innerHTML = fault; }}", fault)
    try:
        assert [said for said in check(page) if word in said]
    finally:
        page.evaluate(f"() => {last}.remove()")
    assert not [said for said in check(page) if word in said]


def test_requests_and_errors_are_heard(
    written: Callable[[str], Path], show: Callable[[Path], Any], tmp_path: Path
) -> None:
    path, text = tmp_path / "page.html", written("problems").read_text(encoding="utf-8")
    more = "<img alt='x' src='http://127.0.0.1:9/x.png'><script>undefined.x</script>"
    path.write_text(text.replace("</main>", f"{more}</main>"), encoding="utf-8")
    opened = show(path)
    opened.page.wait_for_timeout(50)
    said = " ".join(opened.complaints)
    assert "asks for http://127.0.0.1:9/x.png" in said and "undefined" in said
