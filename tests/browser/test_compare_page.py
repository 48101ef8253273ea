"""What a reader does with the page of compare.

Plays the motion, follows links, points, zooms, reads numbers.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pages
import pytest
from page_checks import DESKTOP
from scipy.interpolate import CubicSpline

if TYPE_CHECKING:
    from playwright.sync_api import Page

MODEL, MARKER = "fixed", "projectile"
PLAYER = "document.querySelector('section.animation').trebucheck"


@pytest.fixture
def page(open_page: Any) -> Page:
    """As it is when it was just opened, at its top."""
    shown = open_page("compare").look(DESKTOP)
    shown.evaluate("() => { history.replaceState(null, '', '#'); scrollTo(0, 0); }")
    shown.mouse.move(0, 0)
    return shown


def player(page: Page, call: str) -> Any:
    return page.evaluate(f"() => {PLAYER}.{call}")


def picture(page: Page) -> str:
    return page.evaluate("() => document.querySelector('section.animation canvas').toDataURL()")


# The motion


def test_play_and_scrub_move_the_drawing(page: Page) -> None:
    player(page, "seek(0.1)")
    before = picture(page)
    page.click(".animation-play")
    page.wait_for_function(f"() => {PLAYER}.time > 0.12")
    page.click(".animation-play")
    assert not player(page, "playing")
    played = picture(page)
    box = page.locator(".animation-bar input").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    end = player(page, "times")[-1]
    assert player(page, "time") == pytest.approx(end / 2, abs=0.01 * end)
    assert len({before, played, picture(page)}) == 3


def test_keys_move_the_drawing(page: Page) -> None:
    page.focus("section.animation canvas")
    times = []
    for key in ("Home", "ArrowRight", "Shift+ArrowRight", "ArrowLeft", "End"):
        page.keyboard.press(key)
        times.append(player(page, "time"))
    home, right, far, left, end = times
    assert 0 == home < right < left < far < end == player(page, "times")[-1]
    page.keyboard.press("Space")
    assert player(page, "playing")
    page.keyboard.press("Space")
    assert not player(page, "playing")


WATCH = """() => {
  if (window.discs) return;
  const kind = CanvasRenderingContext2D.prototype, {arc, fill} = kind;
  let last = null;
  window.discs = [];
  kind.arc = function (x, y, ...rest) { last = [x, y]; return arc.call(this, x, y, ...rest); };
  kind.fill = function (...rest) {
    if (last) discs.push([this.fillStyle.toLowerCase(), ...last]);
    last = null;
    return fill.call(this, ...rest);
  };
}"""
"""Keeps the centres of all discs that are drawn, with their colours."""


@pytest.mark.parametrize(
    ("preset", "magnification"), [("default", 1.0), ("assisted", 1.0), ("assisted", 100.0)]
)
def test_a_point_is_drawn_where_the_data_say(page: Page, preset: str, magnification: float) -> None:
    """To a pixel, from the engine's own samples and the reference; and its colour is there."""
    found, label = pages.comparison(), f"pymunk {preset}"
    run, solution = found.trajectories[MODEL, label], found.solutions[MODEL]
    page.evaluate(WATCH)
    times = np.array(player(page, "times"))
    data = json.loads(page.locator("section.animation script").first.text_content() or "")[0]
    colour = next(each["colour"] for each in data["runs"] if each["name"] == label)
    own = CubicSpline(run.t, run.marker(MARKER).position)
    for part in (0.2, 0.7, 0.95):
        time = times[np.argmin(np.abs(times - part * times[-1]))]
        at = solution.trajectory(np.array([time])).marker(MARKER).position[0]
        expected = _pixel(page, data["box"], at + magnification * (own(time) - at))
        player(page, f"magnify({magnification})")
        page.evaluate("() => discs.splice(0)")
        player(page, f"seek({float(time)!r})")
        discs = np.array(
            [[x, y] for fill, x, y in page.evaluate("() => discs") if fill == colour.lower()]
        )
        assert np.linalg.norm(discs - expected, axis=1).min() < 1, (time, expected)
        assert (
            np.linalg.norm(np.array(player(page, f"pixelOf({MARKER!r}, {label!r})")) - expected) < 1
        )


def _pixel(page: Page, box: list[float], at: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """[px] from the canvas's corner: the box in the middle, as large as it can be, y up."""
    size = page.locator("section.animation canvas").evaluate(
        "(c) => [c.clientWidth, c.clientHeight]"
    )
    low, high = np.array(box[:2]), np.array(box[2:])
    scale = min(np.array(size) / (high - low))
    return np.array(size) / 2 + scale * (at - (low + high) / 2) * [1, -1]


# Links


FIGURES = {"stop torque": "Stop torques", "joint force": "Joint forces", "energy": "Energy"}


def test_every_cell_leads_to_its_plot(page: Page) -> None:
    """Visible and drawn where it is followed; the others of one plot have its address."""
    followed: set[str] = set()
    for model, label, cells in overview(page):
        for heading, (_, href) in cells.items():
            if heading in ("verdict", "further", "engine") or not href:
                continue
            figure = page.locator(href)
            assert figure.get_attribute("data-group") == model, (model, label, heading)
            assert figure.locator(".title").text_content() == FIGURES.get(heading, "Distances")
            if href not in followed:
                followed.add(href)
                page.click(f"table a[href='{href}'] >> nth=0")
                page.wait_for_function(
                    "(id) => document.querySelectorAll(`${id} .panel svg path`).length > 0",
                    arg=href,
                )
                box = figure.bounding_box()
                assert box is not None and -1 <= box["y"] < DESKTOP["height"] / 2
    assert len(followed) >= 7


def test_verdicts_lead_to_what_is_said_of_the_run_and_open_it(page: Page) -> None:
    rows = overview(page)
    assert len(rows) == len(pages.comparison().results.runs)
    for model, label, cells in rows:
        href = cells["verdict"][1]
        page.evaluate("(href) => document.querySelector(`table a[href='${href}']`).click()", href)
        target = page.locator(href)
        assert target.bounding_box() is not None, (model, label)
        assert label in (target.text_content() or "")
        if target.evaluate("(e) => e.tagName") == "DETAILS":
            assert target.evaluate("(e) => e.open")


def overview(page: Page) -> list[tuple[str, str, dict[str, tuple[str, str | None]]]]:
    """Rows of the table of all runs: machine, engine, and by column its text and link."""
    table = page.locator(
        "table", has=page.locator("caption", has_text="Largest errors of every run")
    )
    heads, rows = table.evaluate(
        """(table) => {
          const href = (cell) => cell.querySelector("a")?.getAttribute("href") ?? null;
          const heads = [...[...table.tHead.rows].at(-1).cells].map((cell) => cell.textContent.trim());
          const cells = (row) => [...row.cells].map((cell) => [cell.textContent.trim(), href(cell)]);
          const rows = [...table.tBodies[0].rows].map(cells);
          return [heads, rows];
        }"""
    )
    titles, model, found = [head.partition(" [")[0] for head in heads], "", []
    for row in rows:
        if len(row) == 1:
            model = row[0][0].removesuffix(" machine")
        else:
            found.append(
                (
                    model,
                    row[0][0],
                    {title: tuple(cell) for title, cell in zip(titles, row, strict=True)},
                )
            )
    return found


# Plots


def test_pointing_at_a_line_gives_numbers_with_units(page: Page) -> None:
    figure = page.locator("#fixed-stop-torques")
    figure.scroll_into_view_if_needed()
    page.wait_for_function("() => document.querySelector('#fixed-stop-torques .panel svg')")
    box = figure.locator(".panel svg").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.3 * box["height"])
    tip = page.locator("#fixed-stop-torques .panel").first.locator("[aria-label=tip]")
    page.wait_for_function(
        "() => document.querySelector('#fixed-stop-torques .panel [aria-label=tip]')?.textContent"
    )
    said = re.search(r"t ([-+.\de]+) s\W*([-+.\de]+) N m", tip.text_content() or "")
    assert said, tip.text_content()
    time, torque = map(float, said.groups())
    found = (
        pages.comparison()
        .solutions[MODEL]
        .trajectory(np.array([time]))
        .stop_torque("hanger rest")[0]
    )
    assert torque == pytest.approx(
        found, rel=0.02
    )  # whichever line is nearest: all agree that well there


def test_a_drag_zooms_its_group_and_a_button_shows_the_whole_again(page: Page) -> None:
    page.evaluate(
        "() => { dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint')); }"
    )
    whole = _ticks(page)
    figure = page.locator("#fixed-distances")
    figure.scroll_into_view_if_needed()
    box = figure.locator(".panel svg").first.bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.4 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], y, steps=2)
    page.mouse.up()
    zoomed = _ticks(page)
    for group, ticks in zoomed.items():
        changed = [a != b for a, b in zip(ticks, whole[group], strict=True)]
        assert all(changed) if group == "fixed" else not any(changed), group
    figure.locator(".whole").click()
    assert _ticks(page) == whole


def _ticks(page: Page) -> dict[str, list[str]]:
    """Labels of the axes along, of all plots of each group."""
    return page.evaluate(
        """() => { const found = {};
        for (const f of document.querySelectorAll("figure.plot")) for (const svg of f.querySelectorAll(".panel svg"))
          (found[f.dataset.group] ??= []).push(svg.querySelector('[aria-label="x-axis tick label"]').textContent);
        return found; }"""
    )


def test_a_legend_hides_its_series_in_all_plots_of_the_group(page: Page) -> None:
    page.evaluate(
        "() => { dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint')); }"
    )
    key = page.locator("#fixed-distances .legend button", has_text="pymunk default")
    drawn, own = page.evaluate(LINES), page.evaluate(OWN, "pymunk default")
    assert sum(own) > 5
    key.click()
    assert key.get_attribute("aria-pressed") == "false"
    assert page.evaluate(LINES) == [a - b for a, b in zip(drawn, own, strict=True)]
    key.click()
    assert page.evaluate(LINES) == drawn


LINES = """() => [...document.querySelectorAll("figure[data-group=fixed] .panel")]
  .map((panel) => panel.querySelectorAll("[aria-label=line]").length)"""
"""Lines in each plot of the group."""
OWN = """(name) => [...document.querySelectorAll("figure[data-group=fixed]")]
  .flatMap((figure) => figure.panels.map((plot) => plot.series.filter((s) => s.name === name).length))"""
"""Lines of that name among its data."""


# Numbers

NAMES = {
    "position": "position_max",
    "release": "release_time",
    "launch time": "launch_time",
    "launch speed": "launch_speed",
    "stop torque": "stop_torque_max",
    "joint force": "joint_reaction_relative",
    "energy": "energy_drift energy_drift_kinetic",
}


def test_numbers_of_the_overview_are_those_of_the_results(page: Page) -> None:
    results, compared = json.loads(pages.comparison().results.to_json()), 0
    runs = {(run["model"], f"{run['engine']} {run['preset']}"): run for run in results["runs"]}
    shown = overview(page)
    assert {(model, label) for model, label, _ in shown} == set(runs)
    for model, label, cells in shown:
        run = runs[model, label]
        assert run["outcome"] in cells["verdict"][0]
        for heading, names in NAMES.items():
            seen = [
                m for m in run["metrics"] if m["name"] in names.split() and m.get("observed", True)
            ]
            values = [m["value"] for m in seen if m["name"] == seen[0]["name"]]
            text = re.sub(r"^[✓✗○!]\s*", "", cells[heading][0]).partition(" ")[0]
            if text not in ("–", ""):
                compared += 1
                assert float(text) == pytest.approx(max(map(abs, values)), rel=0.051, abs=0), (
                    model,
                    label,
                    heading,
                )
            else:
                assert None in values or not values
        if run["wall_time"] is not None:
            assert float(cells["wall"][0]) == pytest.approx(run["wall_time"], abs=0.0051)
    assert compared > 30


CELLS = (
    "(body) => [...body.rows].map((row) => [...row.cells].map((cell) => cell.textContent.trim()))"
)


def test_numbers_of_every_metric_are_those_of_the_results(page: Page) -> None:
    results = json.loads(pages.comparison().results.to_json())
    assert any(run["metrics"] for run in results["runs"])
    for run in results["runs"]:
        anchor = f"{run['model']}-metrics-{run['engine']}-{run['preset']}"
        if not run["metrics"]:
            assert page.locator(f"#{anchor}").count() == 0
            continue
        rows = page.locator(f"#{anchor} tbody").evaluate(
            "(b) => [...b.rows].map((r) => [...r.cells].map((c) => c.textContent.trim()))"
        )
        assert len(rows) == len(run["metrics"])
        for (label, value, unit, tolerance, *_), metric in zip(rows, run["metrics"], strict=True):
            subject = f" ({metric['subject']})" if metric.get("subject") else ""
            assert (label, unit) == (metric["name"] + subject, metric["unit"])
            if metric["value"] is not None:
                assert float(re.sub(r"^[✓✗○!]\s*", "", value)) == pytest.approx(
                    metric["value"], rel=5.1e-7, abs=0
                )
            if metric.get("tolerance") is not None:
                assert float(tolerance) == pytest.approx(metric["tolerance"], rel=0.051, abs=0)


# Work and precision


def test_the_chosen_quantity_is_drawn_against_cost_and_steps_and_no_other(page: Page) -> None:
    figure = page.locator("#work-precision")
    figure.scroll_into_view_if_needed()
    choices = figure.locator(".choose select")
    names = choices.locator("option").all_inner_texts()
    assert {"position", "energy", "reaction"} <= set(names)
    for name in ("energy", names[0]):
        choices.select_option(name)
        shown = figure.locator(".panels > div:visible")
        assert {shown.nth(i).get_attribute("data-choice") for i in range(shown.count())} == {name}
        axes = [shown.nth(i).locator("svg").text_content() or "" for i in range(shown.count())]
        assert all(name in text for text in axes)
        assert any("processor time" in text for text in axes)
        assert any("steps" in text for text in axes)


def test_a_zoom_of_cost_leaves_the_steps_as_they_are(page: Page) -> None:
    figure = page.locator("#work-precision")
    figure.scroll_into_view_if_needed()
    drawings = figure.locator(".panels > div:visible svg")
    texts = [drawings.nth(i).text_content() for i in range(2)]
    box = drawings.nth(0).bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.4 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], y)
    page.mouse.up()
    after = [drawings.nth(i).text_content() for i in range(2)]
    assert after[0] != texts[0] and after[1] == texts[1]
    figure.locator("button.whole").click()
    assert [drawings.nth(i).text_content() for i in range(2)] == texts
