"""What a reader does with the grid of verdicts: reads it whole, opens, filters and sorts it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import pages
import pytest
from page_checks import PHONE, looks, serious
from trebucheck.comparisons.report.pages.matrix import STATES, counted_runs

LAPTOP = {"width": 1280, "height": 800}
EACH_PRESET = "rows=presets"
CARD = ".card:popover-open"


@pytest.fixture
def page(open_page: Any) -> Iterator[Any]:
    """The page with a row for each preset, with nothing chosen and nothing open."""
    shown = open_page("matrix").look(LAPTOP)
    _at(shown, EACH_PRESET)
    shown.keyboard.press("Escape")
    shown.mouse.move(5, 5)
    shown.wait_for_function("() => !document.querySelector('.card:popover-open')")
    shown.evaluate("() => scrollTo(0, 0)")
    yield shown
    # Other tests look at the same window: nothing stays open or pointed at.
    shown.keyboard.press("Escape")
    shown.mouse.move(0, 0)
    shown.wait_for_function("() => !document.querySelector('.card:popover-open')")
    shown.evaluate(
        "() => { scrollTo(0, 0); document.querySelector('.verdicts-scroll').scrollTo(0, 0); }"
    )


def _at(page: Any, address: str) -> None:
    """Show what an address says behind its '#'."""
    change = "(to) => { location.hash = to; dispatchEvent(new Event('hashchange')); }"
    page.evaluate(change, address)


def _td(page: Any, engine: str, preset: str, problem: str) -> Any:
    names = page.locator(".names th[data-column]").all_text_contents()
    label = f"^\\s*{engine} {preset}\\s*$"
    row = page.locator("tr[data-row]", has=page.locator(f"th:text-matches('{label}')"))
    return row.locator("td:not(.leading)").nth(names.index(problem))


def _cells(page: Any) -> list[dict[str, float]]:
    """Where the cells of the grid are [px], their text's size, and how much of it is cut off."""
    return page.evaluate("""() => [...document.querySelectorAll("section.verdicts tbody td")].map((td) => {
      const {left, right, bottom} = td.getBoundingClientRect(), {fontSize} = getComputedStyle(td);
      return {left, right, bottom, size: parseFloat(fontSize), cut: td.scrollWidth - td.clientWidth};
    })""")  # fmt: skip


def _engines(page: Any) -> list[str]:
    return page.locator("tr[data-row] th").all_text_contents()


def test_every_engine_and_problem_is_on_a_laptops_screen_at_once(page: Any) -> None:
    _at(page, "")
    assert page.input_value("[data-control=rows]") == "engines"
    cells = _cells(page)
    assert len(cells) >= len(pages.matrix().runs)
    assert min(cell["left"] for cell in cells) >= 0
    assert max(cell["right"] for cell in cells) <= LAPTOP["width"]
    assert max(cell["bottom"] for cell in cells) <= LAPTOP["height"]
    assert min(cell["size"] for cell in cells) >= 11  # px
    assert max(cell["cut"] for cell in cells) <= 0  # no text leaves its cell
    heads = page.locator("tbody th[scope=row]").evaluate_all(
        "(heads) => Math.max(...heads.map((head) => head.scrollWidth - head.clientWidth))"
    )
    assert heads <= 0  # nor does an engine's name


def test_a_cell_of_an_engines_row_opens_the_run_of_its_preset(page: Any) -> None:
    _at(page, "rows=engines")
    matrix = pages.matrix()
    for preset in matrix.presets:
        run = next(run for run in counted_runs(matrix) if run.preset == preset)
        column = [problem.name for problem in matrix.problems].index(run.problem)
        place = 1 + column * len(matrix.presets) + matrix.presets.index(preset)
        row = page.locator("tbody tr", has=page.locator(f"th b:text-is('{run.engine}')")).first
        row.locator("td").nth(place).click()
        text = page.locator(CARD).inner_text()
        assert f"{run.engine} {preset}: {run.problem}" in text
        page.keyboard.press("Escape")


def test_arrows_move_over_an_engines_row_and_its_heads(page: Any) -> None:
    _at(page, "rows=engines")
    page.locator(".names th[data-column='0']").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate("() => document.activeElement.dataset.column") == "1"
    page.keyboard.press("ArrowDown")
    first = page.evaluate("() => document.activeElement.ariaLabel")
    page.keyboard.press("ArrowRight")
    second = page.evaluate("() => document.activeElement.ariaLabel")
    assert first != second


def test_numbers_and_few_rows_are_shown_by_preset(page: Any) -> None:
    _at(page, "rows=engines&show=position")
    assert page.input_value("[data-control=rows]") == "presets"
    assert page.locator("[data-control=rows]").is_disabled()
    _at(page, f"engine={pages.matrix().runs[0].engine}")
    assert page.input_value("[data-control=rows]") == "presets"


def test_the_whole_grid_is_read_on_a_laptop_without_scrolling_sideways(page: Any) -> None:
    assert page.evaluate("() => document.documentElement.scrollWidth") <= LAPTOP["width"]
    cells = _cells(page)
    runs = len({run.label for run in pages.matrix().runs}) * len(pages.matrix().problems)
    assert len(cells) >= runs
    assert min(cell["left"] for cell in cells) >= 0
    assert max(cell["right"] for cell in cells) <= LAPTOP["width"]
    assert min(cell["size"] for cell in cells) >= 11  # px
    assert max(cell["cut"] for cell in cells) <= 0  # no text leaves its cell


def test_heads_stay_where_the_grid_is_scrolled(page: Any) -> None:
    page.evaluate("() => scrollTo(0, 300)")
    assert page.locator(".names th[data-column]").first.bounding_box()["y"] < 40
    page.set_viewport_size(PHONE)
    box = page.locator(".verdicts-scroll")
    box.evaluate("(box) => box.scrollTo(300, 200)")
    left = box.bounding_box()["x"]
    assert page.locator("tr[data-row] th").first.bounding_box()["x"] == pytest.approx(left, abs=2)


def test_counts_are_those_of_the_runs_that_count(page: Any) -> None:
    counted = counted_runs(pages.matrix())
    outcomes = Counter(run.outcome for run in counted)
    text = page.locator(".counts").inner_text()
    assert f"{len(counted)} runs" in text
    for outcome, number in outcomes.items():
        assert f"{number} {STATES[outcome].counted}" in text
    engine = counted[0].engine
    _at(page, f"{EACH_PRESET}&engine={engine}")
    page.wait_for_function("() => document.querySelectorAll('tr[data-row]').length < 6")
    mine = sum(run.engine == engine for run in counted)
    assert f"{mine} runs" in page.locator(".counts").inner_text()


def test_pointing_opens_a_cell_and_leaving_closes_it(page: Any) -> None:
    run = next(run for run in pages.matrix().runs if run.causes and run.explained)
    _td(page, run.engine, run.preset, run.problem).hover()
    page.wait_for_selector(CARD)
    text = page.locator(CARD).inner_text()
    assert run.problem in text and run.causes[0] in text and run.engine_version in text
    assert f"trebucheck compare --models {run.problem} --engines {run.engine}" in text
    page.mouse.move(5, 5)
    page.wait_for_function("() => !document.querySelector('.card:popover-open')")


def test_a_cell_is_reached_and_opened_by_keys_alone(page: Any) -> None:
    page.locator("table[role=grid] [tabindex='0']").focus()
    before = page.evaluate("() => document.activeElement.cellIndex")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowDown")
    here = (
        "() => [document.activeElement.cellIndex, document.activeElement.parentElement.dataset.row]"
    )
    column, row = page.evaluate(here)
    assert column == before + 1 and row is not None
    assert page.locator(CARD).count() == 1  # focus shows the card
    page.keyboard.press("Enter")
    assert page.evaluate("() => document.activeElement.className") == "close"
    page.keyboard.press("Escape")
    assert page.locator(CARD).count() == 0
    assert page.evaluate(here) == [column, row]


def test_a_tap_opens_a_cell_on_a_phone(page: Any) -> None:
    page.set_viewport_size(PHONE)
    run = next(run for run in pages.matrix().runs if run.problem == "free-swing")
    _td(page, run.engine, run.preset, run.problem).click()
    box = page.locator(CARD).bounding_box()
    assert box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"]
    assert looks(page, "leaving(390)") == []
    page.locator(".card .close").click()
    assert page.locator(CARD).count() == 0


def test_in_a_narrow_window_a_click_opens_a_cell_that_the_mouse_has_rested_on(page: Any) -> None:
    """The card is the lower part of the screen there, and would lie under the mouse."""
    page.set_viewport_size(PHONE)
    run = next(run for run in pages.matrix().runs if run.problem == "free-swing")
    cell = _td(page, run.engine, run.preset, run.problem)
    cell.scroll_into_view_if_needed()
    box = cell.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_timeout(500)  # longer than pointing takes to open a card elsewhere
    page.mouse.down()
    page.mouse.up()
    page.wait_for_selector(CARD)
    assert "pinned" in page.locator(CARD).get_attribute("class").split()
    assert cell.get_attribute("class").split().count("opened") == 1


def test_what_is_chosen_is_in_the_address_and_comes_back_with_it(page: Any) -> None:
    page.select_option("[data-control=sort]", "agrees")
    page.select_option("[data-control=show]", "position")
    page.click("[data-filter=feature]")
    page.check("#filter-feature input[value='stops']")
    page.keyboard.press("Escape")
    order = _engines(page)
    columns = page.locator(".names th[data-column]:visible").all_text_contents()
    stopped = [problem.name for problem in pages.matrix().problems if problem.stops]
    assert columns == stopped
    assert page.locator("tr.group:visible:not(.apart)").count() == 0
    page.reload()
    assert _engines(page) == order and "feature=stops" in page.url
    assert page.locator(".names th[data-column]:visible").all_text_contents() == columns
    page.click("[data-control=reset]")
    assert "feature" not in page.url
    assert page.locator(".names th[data-column]:visible").count() == len(pages.matrix().problems)


def test_rows_are_sorted_by_the_error_on_a_problem(page: Any) -> None:
    page.click(".names th[data-column='0']")
    page.click(".card .actions button")
    name = pages.matrix().problems[0].name
    errors = {
        run.label: run.error("position_max").part  # type: ignore[union-attr]
        for run in counted_runs(pages.matrix())
        if run.problem == name and run.error("position_max")
    }
    shown = [label for label in _engines(page) if label in errors]
    # As written, in two digits: those that are equal so stay as they were.
    assert [f"{errors[label]:.1e}" for label in shown] == sorted(
        (f"{errors[label]:.1e}" for label in shown), key=float
    )


@pytest.mark.parametrize(
    ("scheme", "rows", "state", "clicked"),
    [
        ("light", EACH_PRESET, "", "td.disagrees"),
        ("dark", EACH_PRESET, "", "td.disagrees"),
        ("light", EACH_PRESET, "", "tr[data-row] th"),
        ("light", "rows=engines", "", "td.disagrees"),
        ("dark", "rows=engines", "", "tbody th[scope=row]"),
        ("dark", EACH_PRESET, "", "[data-filter=scheme]"),
        ("dark", EACH_PRESET, "show=position&only=disagrees", ""),
    ],
    ids=["cell", "dark-cell", "row", "engine-cell", "engine", "filter", "numbers"],
)
def test_axe_finds_nothing_at_all(
    page: Any, scheme: str, rows: str, state: str, clicked: str
) -> None:
    page.emulate_media(color_scheme=scheme)
    _at(page, f"{rows}&{state}")
    page.wait_for_function("(state) => !state || document.querySelector('td.value')", arg=state)
    if clicked:
        page.click(clicked)
    assert serious(page, impacts=("minor", "moderate", "serious", "critical")) == []
    page.keyboard.press("Escape")


def test_a_link_to_a_cell_opens_it(page: Any) -> None:
    run = pages.matrix().runs[0]
    page.goto(page.url.split("#")[0] + f"#cell={run.engine}+{run.preset}+{run.problem}")
    page.reload()
    assert run.problem in page.locator(CARD).inner_text()
    page.keyboard.press("Escape")
    assert "cell" not in page.url
