"""The pages of all commands in a real browser.

Quiet, readable by everybody, whole on a phone and on paper.
"""

from __future__ import annotations

from typing import Any

import pytest
from page_checks import DESKTOP, PHONE, SHEET, looks, serious, unreached

MEGABYTE = 1_000_000


@pytest.mark.parametrize(
    ("scheme", "viewport"), [("light", DESKTOP), ("dark", PHONE)], ids=["light", "dark"]
)
def test_axe_finds_nothing_serious(opened: Any, scheme: str, viewport: dict[str, int]) -> None:
    page = opened.look(viewport, scheme)
    looks(page, "unfold()")
    assert serious(page, seen_before=scheme == "dark") == []


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
    assert unreached(opened.look(DESKTOP)) == []


def test_a_plot_s_legend_lists_its_own_curves_in_colours_of_their_own(opened: Any) -> None:
    page = opened.look(DESKTOP)
    plots = page.evaluate(
        """() => [...document.querySelectorAll("figure.plot")].flatMap((figure) => {
          const names = (box) => [...box.querySelectorAll(":scope > .legend button[data-name]")].map((b) => b.dataset.name);
          const drawn = JSON.parse(figure.querySelector("script").textContent), boxes = [...figure.querySelectorAll(".panels > div")];
          return drawn.map((plot, k) => [[...names(figure), ...names(boxes[k])],
            plot.series.filter((s) => s.listed).map((s) => [s.name, s.style.colour])]);
        })"""
    )
    for listed, series in plots:
        names = dict(series)
        assert len(set(names.values())) == len(names)
        assert set(listed) == set(names) or (not listed and len(names) < 2)
